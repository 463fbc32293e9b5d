"""Classic problems of mechanical simulation, written as equations, against published or independent values."""

import json

import numpy as np
import pytest
from conftest import ROOT
from oracles import models

import lmoc

PROBLEMS = json.loads((ROOT / "tests/data/classic.json").read_text())


def compiled(name: str) -> lmoc.DAE:
    return models.compiled(f"classic/{name}")


def assert_reference(run, truth: dict, accuracy: float) -> None:
    for signal, values in truth["reference"].items():
        assert np.abs(run[signal] - values).max() <= accuracy * np.abs(values).max(), signal


@pytest.mark.parametrize("name", PROBLEMS)
def test_reference_is_reproduced(name):
    dae, truth = compiled(name), PROBLEMS[name]
    assert len(dae.states) == truth["states"]
    assert_reference(dae.simulate(times=truth["times"], rtol=1e-10), truth, 1e-6)


@pytest.mark.parametrize("name", PROBLEMS)
def test_default_options_carry_to_the_end(name):
    dae, truth = compiled(name), PROBLEMS[name]
    run = dae.simulate()
    values = {signal: [values[-1]] for signal, values in truth["reference"].items()}
    assert run.time[-1] == truth["times"][-1]
    for signal, [value] in values.items():
        scale = np.abs(truth["reference"][signal]).max()
        assert abs(run[signal][-1] - value) < 1e-3 * scale, signal


@pytest.mark.parametrize("points", [7, 11, 31])
def test_linkage_is_followed_between_output_times_that_lie_far_apart(points):
    """Two turns of the crank: both loops have other closures nearby, and angles that differ by whole turns."""
    dae = compiled("andrews")
    fine = dae.simulate(points=30 * (points - 1) + 1, rtol=1e-9)
    coarse = dae.simulate(points=points, rtol=1e-9)
    for angle in ("Theta", "gamma", "phi", "delta", "Omega", "epsilon"):
        assert np.abs(coarse[angle] - fine[angle][::30]).max() < 1e-5, angle


def test_linkage_takes_long_steps():
    """At a low accuracy DOP853 turns the crank by half a radian a step; the closures must not be left for others."""
    run = compiled("andrews").simulate(rtol=1e-4)
    assert run.stats["solver"] == "dop853"
    assert abs(run["Theta"][-1] - PROBLEMS["andrews"]["reference"]["Theta"][-1]) < 0.05
