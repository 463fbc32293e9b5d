"""Nonlinear and linear equations behind a motion, when its variables are read."""

import numpy as np
import pytest

import lmoc
from lmoc.ir.program import Solve, walk
from lmoc.numerics.coordinates.change import block_unknowns
from lmoc.numerics.failures.diagnosis import unsolved

ROOT = """model Root
  Real x(start = 4, fixed = true), f;
equation
  der(x) = -f;
  f + 0.1*f^2 = x;
end Root;"""


@pytest.fixture(scope="module")
def root():
    return lmoc.compile_text(ROOT).simulate(stop=1.0, points=11)


def branch(x):
    return 5.0 * (np.sqrt(1.0 + 0.4 * x) - 1.0)


def test_reading_goes_on_from_the_solution_that_the_motion_begins_with(root):
    observer = root.trajectory.segments[0].observer
    unknowns = observer.plan.once(block_unknowns)
    assert len(unknowns) == 1 and np.abs(observer.base[unknowns]) == pytest.approx(branch(4.0), rel=1e-12)
    assert root["f"] == pytest.approx(branch(root["x"]), rel=1e-10)


def test_equations_of_the_motion_that_cannot_be_solved_again_are_told(root):
    """Below x = -2.5 there is no f."""
    observer, times = root.trajectory.segments[0].observer, np.linspace(0.0, 1.0, 50)
    assert unsolved(observer, times, np.linspace(4.0, -2.0, 50)[:, None]) is None
    sentence, _, time = unsolved(observer, times, np.linspace(4.0, -4.0, 50)[:, None])
    assert "have no solution" in sentence and time == pytest.approx(6.5 / 8.0, abs=0.03)


BRANCHES = """model Branches
  Real x(start = 1, fixed = true), a, f, g;
equation
  der(x) = a;
  a + f + g = -x;
  f = if x > 0.5 then 2*a - 0.1*g else 3*a + 0.2*g;
  g = (if x > 0.5 then 1 else 2)*a + 0.5*f;
end Branches;"""


def test_equations_that_are_linear_in_each_branch_are_solved_as_linear_ones():
    """Against the matrices of both branches."""
    dae = lmoc.compile_text(BRANCHES)
    run = dae.simulate(stop=8.0, points=161)
    plan = run.trajectory.segments[0].observer.plan
    blocks = [s for s in walk(plan.program) if isinstance(s, Solve)]
    assert all(block.linear for block in blocks)
    upper = np.array([[1, 1, 1], [-2, 1, 0.1], [-1, -0.5, 1]])
    lower = np.array([[1, 1, 1], [-3, 1, -0.2], [-2, -0.5, 1]])
    fast, slow = (-np.linalg.solve(m, [-1.0, 0.0, 0.0])[0] for m in (upper, lower))
    change = np.log(2) / fast
    exact = np.where(run.time < change, np.exp(-fast * run.time), 0.5 * np.exp(-slow * (run.time - change)))
    assert run["x"] == pytest.approx(exact, rel=1e-5)
    now = np.where(run["x"][:, None, None] > 0.5, upper, lower)
    right = np.stack([-run["x"], 0 * run["x"], 0 * run["x"]], axis=1)[..., None]
    solved = np.linalg.solve(now, right)[..., 0]
    away = np.abs(run["x"] - 0.5) > 1e-6
    for k, name in enumerate("afg"):
        assert run[name][away] == pytest.approx(solved[away, k], abs=1e-9)
