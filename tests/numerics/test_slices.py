"""Variables are computed from states by slices of the program, which the runs of one scene share."""

from pathlib import Path

import numpy as np
import pytest
from oracles.models import compiled

import lmoc
from lmoc.ir.program import Solve, walk
from lmoc.numerics.failures.diagnosis import moving_risks
from lmoc.numerics.observe.solutions import Solutions

MODELS = Path(__file__).parents[2] / "models"
BESIDE = """model Beside
  parameter Real a = 2;
  Real x(start = 1, fixed = true), y[6];
equation
  der(x) = -x;
  for i in 1:6 loop
    sum(y) + a*i*y[i] + a*y[7 - i] = x*i;
  end for;
end Beside;"""


def test_runs_with_other_parameters_share_no_factors():
    """The matrix of the block is constant during a run, so that its inverse is kept, but only for the same run."""
    dae = lmoc.compile_text(BESIDE)
    runs = {a: dae.simulate(parameters={"a": a}, points=11) for a in (2.0, 3.0)}
    assert any(isinstance(step, Solve) and step.constant for step in walk(dae.reduced.observe))
    for a in (2.0, 3.0, 2.0, 2.0, 3.0):
        matrix = np.ones((6, 6)) + a * np.diag(np.arange(1, 7)) + a * np.fliplr(np.eye(6))
        y = np.linalg.solve(matrix, np.arange(1, 7))
        assert runs[a]["y"] == pytest.approx(np.outer(runs[a]["x"], y), rel=1e-9)


def test_what_is_read_can_be_changed():
    """States are handed out as copies."""
    run = lmoc.compile_text(BESIDE).simulate(points=11)
    run["x"][:] = 7.0
    assert run["x"][0] == 1.0 and run["x"][-1] == pytest.approx(np.exp(-10), rel=1e-3)


def test_a_block_that_the_motion_needs_is_not_looked_at_again():
    """Where it had no solution the run would have stopped; one beside the motion is."""
    pendulum = compiled("planar/double_pendulum")
    for dae, watched in ((pendulum, False), (lmoc.compile_text(BESIDE), True)):
        found = moving_risks(dae.simulate(points=11).trajectory.segments[0].observer.plan)
        unknowns = [step.unknowns.ravel() for step in walk(found.program) if isinstance(step, Solve)]
        assert bool(unknowns and np.isin(found.registers, np.concatenate(unknowns)).any()) == watched


def test_variables_behind_closed_loops_do_not_depend_on_the_order_in_which_they_are_read():
    """The solutions of loops that one variable needs are kept for the next one."""
    dae = compiled("classic/andrews")
    names = ["Theta", "gamma", "phi", "delta", "Omega", "epsilon"]
    forwards, backwards, alone = (dae.simulate(points=201) for _ in range(3))
    one = {name: forwards[name] for name in names}
    two = {name: backwards[name] for name in reversed(names)}
    every = alone.values(np.concatenate([alone.flat.find(name) for name in names]))
    for k, name in enumerate(names):
        assert one[name] == pytest.approx(two[name], abs=1e-12) and one[name] == pytest.approx(every[:, k], abs=1e-12)
    x = 0.028 * np.cos(one["Theta"] + forwards["beta"]) - 0.007 * np.cos(forwards["beta"])
    assert x + 0.035 * np.sin(one["gamma"]) == pytest.approx(np.full(201, 0.03635), abs=1e-12)


def test_solutions_belong_to_the_arrays_that_they_were_kept_with():
    times, states, registers = np.arange(3.0), np.zeros((3, 1)), np.array([4, 7])
    kept, guesses = Solutions(), np.zeros((3, 2))
    kept.keep(times, states, registers[:1], np.full((3, 1), 5.0))
    assert kept.fill(times, states, registers, guesses).tolist() == [True, False] and guesses[0].tolist() == [5.0, 0.0]
    assert not kept.fill(times.copy(), states, registers, guesses).any()
