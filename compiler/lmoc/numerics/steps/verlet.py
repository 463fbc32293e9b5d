"""Störmer–Verlet (leapfrog) with steps of equal length: explicit and symplectic, for separable scenes.

The states must fall into two groups, so that the derivatives of each depend on time and on the other group alone:
positions and velocities where no force depends on a velocity. Hairer, Lubich, Wanner, Geometric numerical integration
illustrated by the Störmer–Verlet method, Acta Numerica 12 (2003).
"""

from __future__ import annotations

import numpy as np

from lmoc.numerics.problem.base import Integration, Problem, Properties
from lmoc.numerics.problem.status import Unsuitable
from lmoc.numerics.problem.system import System
from lmoc.numerics.steps.fixed_step import FixedStep

PROPERTIES = Properties(
    "verlet", "Störmer–Verlet", "symplectic", "2", "3", "own",
    symplectic=True, lengths="fixed",
    needs="forces independent of velocities",
    good_for="large conservative scenes over very long times, at low accuracy",
)  # fmt: skip

_LOOKS = 3  # places at which an entry of the Jacobian must vanish to count as absent
_NEAR = 0.1  # of the size of the motion, how far apart they are


def begin(problem: Problem) -> Integration:
    """Return the method at the beginning of a problem.

    Raises
    ------
    Unsuitable
        The scene is not separable.
    """
    return Verlet(problem)


class Verlet(FixedStep):
    """The method at work: half a kick, a drift, half a kick."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem)
        n = problem.system.plan.state_count
        self.drifting = separated(problem.system, problem.t, problem.x, problem.atol / problem.rtol)
        self.kicked = np.append(~self.drifting, np.zeros(problem.system.n - n, bool))
        self.drifting = np.append(self.drifting, np.zeros(problem.system.n - n, bool))
        self.summed = np.arange(problem.system.n) >= n  # quadratures: nothing depends on them

    def advanced(self, t: float, x: np.ndarray, h: float) -> np.ndarray:
        slope, new = self.own_slope(), x.copy()
        new[self.kicked] += h / 2 * slope[self.kicked]
        middle = self.derivative(t + h / 2, new)
        new[self.drifting] += h * middle[self.drifting]
        last = self.derivative(t + h, new)
        new[self.kicked] += h / 2 * last[self.kicked]
        new[self.summed] += h * middle[self.summed]
        return new


def separated(system: System, t: float, x: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Return the mask of the states that drift, (states,): the derivatives of each group depend on the other alone.

    Parameters
    ----------
    size : (n,) of the motion

    Raises
    ------
    Unsuitable
        There are no such groups.
    """
    n = system.plan.state_count
    which, on = _dependences(system, t, x, size)
    neighbours = [[] for _ in range(n)]
    for i, j in zip(which.tolist(), on.tolist(), strict=True):
        neighbours[i].append(j)
        neighbours[j].append(i)
    group = np.zeros(n, int)  # 1 drifts, -1 is kicked
    for first in range(n):
        if group[first]:
            continue
        group[first], waiting = 1, [first]
        while waiting:
            i = waiting.pop()
            for j in neighbours[i]:
                if group[j] == group[i]:
                    raise _inseparable(system, i, j, bool(((which == i) & (on == j)).any()))
                if not group[j]:
                    group[j] = -group[i]
                    waiting.append(j)
    return group > 0


def _dependences(system: System, t: float, x: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return which state's derivative depends on which state: entries of the Jacobian that do not vanish everywhere."""
    n, (indptr, rows) = system.plan.state_count, system.pattern()
    columns = np.repeat(np.arange(system.n), np.diff(indptr))
    values, there = np.empty(len(rows)), np.zeros(len(rows), bool)
    random = np.random.default_rng(0)
    for look in range(_LOOKS):
        near = x + _NEAR * look * (size + np.abs(x)) * random.uniform(-1, 1, len(x))
        with np.errstate(all="ignore"):
            system.jacobian_values(t, near, values)
        there |= values != 0
    there &= (rows < n) & (columns < n)
    return rows[there], columns[there]


def _inseparable(system: System, i: int, j: int, forward: bool) -> Unsuitable:
    i, j = (i, j) if forward else (j, i)
    names = system.plan.reduced.state_names
    dependence = f"der({names[i]}) depends on {'itself' if i == j else names[j]}"
    reason = f"the scene is not separable into positions and velocities: {dependence}"
    return Unsuitable(reason, "midpoint and gauss are symplectic as well")
