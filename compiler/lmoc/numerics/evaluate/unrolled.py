"""Small systems with nonlinear blocks where there is no C compiler: one casadi function with Newton's iterations in it.

A few iterations from the last solution are written out one after the other. The function says whether they have
converged to a solution near the last one; where they have not, the segmented evaluation takes the trouble.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lmoc.ir.program import Program, Solve, program_rows, written
from lmoc.numerics.evaluate.casadi_system import Buffered, can_lower, eliminate, lower_linear, lower_steps, shared
from lmoc.numerics.evaluate.follow import SHORTEST
from lmoc.numerics.evaluate.lowered_derivatives import LoweredJacobian
from lmoc.numerics.evaluate.newton import Newton
from lmoc.numerics.evaluate.segments import SegmentedProgram, can_segment, outside
from lmoc.numerics.evaluate.stepper import NumpyStepper, Stepper
from lmoc.numerics.evaluate.unrolled_stepper import UnrolledStepper, steps_of
from lmoc.numerics.evaluate.vector_system import Runner
from lmoc.numerics.plan import Plan
from lmoc.numerics.signals.signals import Signal

_ITERATIONS = 6
_LARGEST = 16  # unknowns of a block whose elimination is written out
_ROWS = 1500  # of a program whose blocks are
_EXACT, _FAST = 1e-13, 1e-2  # the last correction is this small, or this small beside the one before and below …
_SMALL = 1e-9  # … this, after which the error is of its square
_NEAR, _LOOSE = 0.25, 1e-8  # as in `newton`


def can_unroll(program: Program) -> bool:
    """Return whether everything can be written out."""
    return can_segment(program) and program_rows(program) <= _ROWS and all(map(_is_small, program))


def _is_small(step) -> bool:
    return not isinstance(step, Solve) or step.unknowns.shape[1] <= _LARGEST and can_lower(step.inner)


class UnrolledSystem(LoweredJacobian):
    """All derivatives are one casadi function of the states and the last solutions."""

    description = "casadi, unrolled"

    def __init__(self, plan: Plan) -> None:
        super().__init__(plan)
        steps = [s for s in plan.program if isinstance(s, Solve) and not s.linear]
        self._blocks = [s.unknowns for s in steps]
        self._unknowns = np.concatenate([np.zeros(0, int), *(u.ravel() for u in self._blocks)])
        guesses = [np.full(s.unknowns.size, -1) if s.guess is None else s.guess.ravel() for s in steps]
        self._guesses = np.concatenate([np.zeros(0, int), *guesses])
        none = np.zeros(0, int)
        self._reads = outside(plan.program, none, plan.count)
        inside = [written(s) for s in plan.program]
        self._writes = np.unique(np.concatenate([none, *inside]))
        self._time, self._values, self._z = np.zeros(1), np.zeros(len(self._reads)), np.zeros(len(self._unknowns))
        function = _function(plan.program, plan.count, self._reads, self._unknowns, self._writes)
        self._call = Buffered(function, (self._time, self._values, self._z))
        self._steps: tuple | None = None  # functions of the stepper
        self._solved: tuple[np.ndarray, float] | None = None  # registers and time of the last solution
        self._marked: tuple[tuple[np.ndarray, float], np.ndarray] | None = None  # and of one to go back to

    def _runner(self) -> Runner:
        return _Late(self.plan)

    def stepper(self) -> Stepper:
        if self.samplers:
            return NumpyStepper(self)
        if self._steps is None:
            self._steps = steps_of(self._call.function, self._reads, self._writes, self.plan)
        return UnrolledStepper(self, *self._steps)

    def stands_at(self, t: float, x: np.ndarray, solution: np.ndarray) -> None:
        """Take a solution that has been found elsewhere as the last one."""
        self.w[self.inputs] = x
        self._solved, self._z[:] = (self.w[self._reads], t), solution

    @property
    def last_solution(self) -> np.ndarray:
        """Return the unknowns of the nonlinear blocks, as solved last."""
        return self._z

    @property
    def read_values(self) -> np.ndarray:
        """Return the values of all registers that the program reads."""
        return self.w[self._reads]

    def prepare(self, base: np.ndarray, signals: Mapping[int, Signal]) -> None:
        super().prepare(base, signals)
        self._solved = self._marked = None
        guess = np.where(self._guesses >= 0, self.w[self._guesses], 0.0)
        seeds = self.w[self._unknowns]
        self._z[:] = np.where(np.isfinite(seeds), seeds, np.where(np.isfinite(guess), guess, 0.0))

    def mark(self) -> None:
        super().mark()
        if self._solved is not None:
            self._marked = self._solved, self._z.copy()

    def go_back(self) -> None:
        super().go_back()
        if self._marked is not None:
            self._solved, self._z[:] = self._marked

    def _run(self, t: float, x: np.ndarray) -> None:
        w = self.w
        w[self.inputs] = x
        if self.samplers:
            self.sample(t, self._u)
            w[self.plan.sampled] = self._u
        given = w[self._reads]
        if self._step(t, given) or self._approach(t, given):
            w[self._writes] = self._call.results[0]
            self._solved = given, t
        else:
            self._follow_slowly(t)

    def _step(self, t: float, given: np.ndarray) -> bool:
        """Seek the solution near the last one; whether it was found. At the start any solution will do."""
        self._time[0] = t
        self._values[:] = given
        self._call()
        _, z, (good, converged) = self._call.results
        if good == 1.0 or (self._solved is None and converged == 1.0):
            self._z[:] = z
            return True
        return False

    def _approach(self, t: float, given: np.ndarray) -> bool:
        """Go the way from the last solution in shorter steps, as `follow` does; whether it leads all the way."""
        if self._solved is None:
            return False
        (old, old_time), kept, reached, length = self._solved, self._z.copy(), 0.0, 0.5
        while reached < 1.0 and length >= SHORTEST:
            goal = min(1.0, reached + length)
            between = given if goal == 1.0 else np.where(old == given, given, (1.0 - goal) * old + goal * given)
            if self._step((1.0 - goal) * old_time + goal * t, between):
                reached, length = goal, 2.0 * length
            else:
                length /= 2.0
        if reached < 1.0:
            self._z[:] = kept
        return reached == 1.0

    def _follow_slowly(self, t: float) -> None:
        """Let the segmented evaluation go the way from the last solution."""
        follower, w, position = self.follower, self.w, 0
        newtons: list[Newton] = self.interpreter.newtons
        if self._solved is not None:
            before = w.copy()
            before[self._reads] = self._solved[0]
            follower.before = before, self._solved[1]
        for newton, block in zip(newtons, self._blocks, strict=True):
            newton.last = self._z[position : position + block.size].reshape(block.shape).copy()
            position += block.size
        follower.go(w, t)
        if np.isfinite(w[self._unknowns]).all():
            self._z[:] = w[self._unknowns]
            self._solved = w[self._reads], t


class _Late:
    """The segmented program, made when it is needed."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._made: SegmentedProgram | None = None

    @property
    def _segments(self) -> SegmentedProgram:
        if self._made is None:
            self._made = SegmentedProgram(self._plan.program, self._plan.count)
        return self._made

    @property
    def newtons(self) -> list[Newton]:
        return self._segments.nonlinear_newtons

    def run(self, w: np.ndarray, time: float) -> None:
        self._segments.run(w, time)

    def reset(self) -> None:
        if self._made is not None:
            self._made.reset()


def _function(program: Program, count: int, reads: np.ndarray, unknowns: np.ndarray, writes: np.ndarray):
    """``(t, registers read, last solutions) -> (registers written, solutions, (good, converged))``."""
    import casadi as ca

    t, values, last = ca.SX.sym("t"), ca.SX.sym("w", len(reads)), ca.SX.sym("z", len(unknowns))
    w: list = [None] * count
    for register, symbol in zip(reads.tolist(), ca.vertsplit(values) if len(reads) else [], strict=True):
        w[register] = symbol
    start = dict(zip(unknowns.tolist(), ca.vertsplit(last) if len(unknowns) else [], strict=True))
    converged, near = ca.SX(1), ca.SX(1)
    for step in program:
        if not isinstance(step, Solve):
            lower_steps((step,), w, t)
        elif step.linear:
            lower_linear(step, w, t)
        else:
            for instance in _iterate(step, w, t, start):
                converged, near = ca.logic_and(converged, instance[0]), ca.logic_and(near, instance[1])
    out = ca.densify(ca.vertcat(ca.SX(0, 1), *[w[r] for r in writes.tolist()]))
    solution = ca.densify(ca.vertcat(ca.SX(0, 1), *[w[r] for r in unknowns.tolist()]))
    good = ca.densify(ca.vertcat(ca.logic_and(converged, near), converged))
    return ca.Function("unrolled", [t, values, last], shared([out, solution, good]))


def _iterate(step: Solve, w: list, t, start: dict) -> list[tuple]:
    """Write out Newton's iterations of a block; its solution and what lies between stand in w afterwards.

    Returns for each instance the two of `_conditions`.
    """
    import casadi as ca

    unknowns = step.unknowns.ravel().tolist()
    reads = outside(step.inner, step.unknowns.ravel(), len(w))
    function = block_function(step, reads, len(w))
    values = ca.vertcat(ca.SX(0, 1), *[w[r] for r in reads.tolist()])
    first = found = ca.vertcat(*[start[k] for k in unknowns])
    changes, target = [], None
    for _ in range(_ITERATIONS):
        parts = function(t, found, values)
        changes.append(ca.vertcat(*[ca.vertcat(*eliminate(a, -r)) for r, a in zip(parts[::2], parts[1::2])]))
        found = found + changes[-1]
        target = found if target is None else target
    for register, value in zip(unknowns, ca.vertsplit(found), strict=True):
        w[register] = value
    lower_steps(step.inner, w, t)
    size = step.unknowns.shape[1]
    instances = [range(k, k + size) for k in range(0, len(unknowns), size)]
    return [_conditions(own, first, target, found, changes) for own in instances]


def block_function(step: Solve, reads: np.ndarray, count: int):
    """``(t, unknowns, registers read) -> (residuals, their Jacobian)`` of one instance after the other."""
    import casadi as ca

    t, u, values = ca.SX.sym("t"), ca.SX.sym("u", step.unknowns.size), ca.SX.sym("w", len(reads))
    w: list = [None] * count
    for registers, symbols in ((step.unknowns.ravel(), u), (reads, values)):
        for register, symbol in zip(registers.tolist(), ca.vertsplit(symbols) if len(registers) else [], strict=True):
            w[register] = symbol
    lower_steps(step.inner, w, t)
    parts = []
    for own, residual in zip(step.unknowns.tolist(), step.residuals.tolist(), strict=True):
        r = ca.vertcat(*[w[k] for k in residual])
        parts += [r, ca.densify(ca.jacobian(r, ca.vertcat(*[w[k] for k in own])))]
    return ca.Function("block", [t, u, values], parts)


def _conditions(own: range, first, target, found, changes) -> tuple:
    """Return whether an instance has converged, and to where its first step has pointed."""
    import casadi as ca

    def largest(x):
        return ca.mmax(ca.fabs(ca.vertcat(*[x[k] for k in own])))

    size = 1 + largest(found)
    last, before = largest(changes[-1]), largest(changes[-2])
    fast = ca.logic_and(last <= _SMALL * size, last <= _FAST * before)
    converged = ca.logic_or(last <= _EXACT * size, fast)
    way, missed = largest(found - first), largest(found - target)
    near = ca.logic_and(way <= _NEAR * size, missed <= _NEAR * way + _LOOSE * size)
    return converged, near
