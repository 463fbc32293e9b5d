"""Variables are computed from states by slices of the program, which the runs of one scene share."""

from pathlib import Path

import numpy as np
import pytest

import lmoc
from lmoc.ir.program import Solve, walk
from lmoc.numerics.failures.diagnosis import moving_risks

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
    pendulum = lmoc.compile(MODELS / "planar" / "double_pendulum.lmo")
    for dae, watched in ((pendulum, False), (lmoc.compile_text(BESIDE), True)):
        found = moving_risks(dae.simulate(points=11).trajectory.pieces[0].observer.plan)
        unknowns = [step.unknowns.ravel() for step in walk(found.program) if isinstance(step, Solve)]
        assert bool(unknowns and np.isin(found.registers, np.concatenate(unknowns)).any()) == watched
