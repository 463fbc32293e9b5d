"""The systems of the lecture notes against reference trajectories derived without this compiler."""

import json
from pathlib import Path

import numpy as np
import pytest
from oracles import models

import lmoc

ROOT = Path(__file__).parents[2]
NOTES = json.loads((ROOT / "tests/data/notes.json").read_text())
SOLVERS = {
    "dop853": {"rtol": 1e-8},
    "ida": {"rtol": 1e-10, "atol": 1e-13},
    "cvode": {"rtol": 1e-10, "atol": 1e-13},
}

every_system = pytest.mark.parametrize("name", NOTES)


def compiled(name: str) -> lmoc.DAE:
    return models.compiled(ROOT / "models/notes" / NOTES[name]["file"])


@pytest.mark.parametrize("solver", SOLVERS)
@every_system
def test_reference_is_reproduced(name, solver):
    truth = NOTES[name]
    run = compiled(name).simulate(times=truth["times"], solver=solver, **SOLVERS[solver])
    assert np.array_equal(run.time, truth["times"])
    for signal, reference in truth["reference"].items():
        error = np.abs(run[signal] - reference).max()
        assert error <= 1e-6 * np.abs(reference).max(), signal


@every_system
def test_states_are_minimal(name):
    assert len(compiled(name).states) == len(NOTES[name]["states"])


@every_system
def test_states_are_those_of_the_notes(name):
    """Each state is one of the coordinates of the notes or a velocity of one, whatever part it is named after."""
    truth, dae = NOTES[name], compiled(name)
    run = dae.simulate(times=truth["times"], rtol=1e-9)
    signals = [run[signal] for signal in truth["states"]]
    for state in dae.states:
        assert any(np.allclose(run[state], signal, rtol=0, atol=1e-9) for signal in signals), state


@every_system
def test_parameters_and_signals_are_named_as_in_the_notes(name):
    truth, dae = NOTES[name], compiled(name)
    assert {p: dae.parameters[p] for p in truth["parameters"]} == truth["parameters"]
    assert set(truth["reference"]) == set(dae.outputs)


@every_system
def test_energy_is_balanced(name):
    run = compiled(name).simulate()
    assert run.energy.balance < 100 * 1e-6


def test_every_model_is_covered():
    with_laws = {"fig6_slack_string.lmo", "ex08_slack_cable.lmo"}  # see test_law_models.py
    smooth = {truth["file"] for truth in NOTES.values()}
    assert smooth | with_laws == {p.name for p in (ROOT / "models/notes").glob("*.lmo")}
