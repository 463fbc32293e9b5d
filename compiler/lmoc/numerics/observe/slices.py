"""The part of a program that some registers need, on renumbered registers: small however large the whole is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Protocol

import numpy as np

from lmoc.ir.program import Apply, Program, Solve, Step, Total, needed_steps, read, walk, written
from lmoc.numerics.evaluate.opened import open_blocks
from lmoc.numerics.limits import KEPT_NAMES, NUMBERS
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.signals.signals import Formula, Signal, sample
from lmoc.numerics.solve.follow import Follower
from lmoc.numerics.solve.interpreter import Interpreter
from lmoc.support.sizes import DENSE

if TYPE_CHECKING:
    from lmoc.numerics.solve.together import Together



class Evaluate(Protocol):
    """Values of registers at some times, as `Slice.bind` returns it."""

    def __call__(self, times: np.ndarray, states: np.ndarray, known: np.ndarray | None = None, /) -> np.ndarray: ...


class EvaluateTogether(Protocol):
    """Values of registers at some times, where they are good, and solutions, as `Slice.bind_together` returns it."""

    def __call__(
        self, times: np.ndarray, states: np.ndarray, guesses: np.ndarray, /
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]: ...


class Slice:
    """Values of registers of a plan as a function of time and states.

    Parameters
    ----------
    registers : which ones; of those that nothing fills the value is NaN
    program, count : what fills them among how many registers; without them those of the plan
    """

    def __init__(
        self, plan: Plan, registers: np.ndarray, program: Program | None = None, count: int | None = None
    ) -> None:
        count = plan.count if count is None else count
        program = needed_steps(plan.full_program, registers, count) if program is None else program
        touched = np.zeros(count, bool)
        touched[registers] = True
        for step in program:
            touched[read(step)] = touched[written(step)] = True
            _touch_guesses(step, touched)
        old = np.flatnonzero(touched)
        new = np.full(count, -1)
        new[old] = np.arange(len(old))
        self.registers = old
        self._program = tuple(renumber(step, new) for step in program)
        self.out = new[registers]
        self.state_columns = np.flatnonzero(touched[plan.states])
        self.state_registers = new[plan.states[self.state_columns]]
        used = np.flatnonzero(touched[plan.sampled])
        self.sampled = new[plan.sampled[used]]
        self.samplers = [plan.samplers[k] for k in used]
        blocks = [s.unknowns.ravel() for s in walk(self._program) if isinstance(s, Solve) and not s.linear]
        self.unknowns = np.concatenate([np.zeros(0, int), *blocks])
        self._togethers: dict[bytes, Together] = {}
        self._bound: np.ndarray | None = None  # the constants that the interpreter has been used with last

    @cached_property
    def _moving(self) -> tuple[np.ndarray, np.ndarray]:
        """Places among the registers that are states, and the columns of these."""
        column = np.full(len(self.registers), -1)
        column[self.state_registers] = self.state_columns
        moving = np.flatnonzero(column[self.out] >= 0)
        return moving, column[self.out[moving]]

    @property
    def implicit(self) -> bool:
        """Return whether it has nonlinear blocks."""
        return len(self.unknowns) > 0

    def bind_together(
        self, base: np.ndarray, signals: Mapping[int, Signal], solved: np.ndarray | None = None
    ) -> EvaluateTogether:
        """``(times, states, guesses (times, unknowns)) -> (times, registers)``, at which times that is good, and the
        solutions (times, unknowns).

        The guesses are for the unknowns of nonlinear blocks; where they lead to no solution nearby, nothing counts.

        Parameters
        ----------
        solved : (unknowns,) for which of them the guesses are the solutions
        """
        own = base[self.registers]
        together = self._together(np.zeros(len(self.unknowns), bool) if solved is None else solved)

        def evaluate(
            times: np.ndarray, states: np.ndarray, guesses: np.ndarray
        ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            result, good = np.empty((len(times), len(self.out))), np.empty(len(times), bool)
            solutions = np.empty(guesses.shape)
            together.reset()
            for part in self._chunks(len(times)):
                w = self._given(own, times[part], states[part], signals)
                w[self.unknowns] = guesses[part].T
                good[part] = together.fill(w, times[part])
                result[part], solutions[part] = w[self.out].T, w[self.unknowns].T
            return result, good, solutions

        return evaluate

    def _together(self, solved: np.ndarray) -> Together:
        """Return what fills the registers at many times, where the solutions of some blocks are given."""
        from lmoc.numerics.solve.together import Together

        key = solved.tobytes()
        if key not in self._togethers:
            given = np.zeros(len(self.registers), bool)
            given[self.unknowns[solved]] = True
            steps = open_blocks(self._program, lambda block: not block.linear and bool(given[block.unknowns].all()))[0]
            self._togethers[key] = Together(steps, len(self.registers))
        return self._togethers[key]

    def _chunks(self, count: int) -> list[slice]:
        length = max(1, NUMBERS // max(1, len(self.registers)))
        return [slice(a, a + length) for a in range(0, count, length)]

    def _given(
        self, own: np.ndarray, times: np.ndarray, states: np.ndarray, signals: Mapping[int, Signal]
    ) -> np.ndarray:
        """(registers, times) with what is given at each time."""
        w = np.repeat(own[:, None], len(times), axis=1)
        w[self.state_registers] = states[:, self.state_columns].T
        for register, (variable, order) in zip(self.sampled, self.samplers, strict=True):
            w[register] = sample(signals[variable], order, times)
        return w

    def bind(self, base: np.ndarray, signals: Mapping[int, Signal]) -> Evaluate:
        """``(times, states (times, n)) -> (times, registers)`` for the parameter values and signals of a run.

        A third argument (times, unknowns) has the solutions of the nonlinear blocks where they are known, NaN
        elsewhere: there they are followed from one time to the next.
        """
        own = base[self.registers]
        if not self._program and not len(self.sampled):
            return self._copies(own[self.out])
        run = _follower(self._program, len(self.registers)) if self.implicit else self._interpreted(own)

        def evaluate(times: np.ndarray, states: np.ndarray, known: np.ndarray | None = None) -> np.ndarray:
            result = np.empty((len(times), len(self.out)))
            for part in self._chunks(len(times)):
                w = self._given(own, times[part], states[part], signals)
                if known is None:
                    run(w, times[part])
                else:
                    given = np.isfinite(known[part])
                    w[self.unknowns] = np.where(given, known[part], w[self.unknowns].T).T
                    _run_from(run, w, times[part], given.all(axis=1))
                result[part] = w[self.out].T
            return result

        return evaluate


    def across(self, base: np.ndarray, times: np.ndarray, states: np.ndarray) -> np.ndarray:
        """Return values (runs, times, registers) of many runs at the same times, with the bits of single runs.

        Parameters
        ----------
        base : (runs, registers of the plan) what does not change during a run
        states : (runs, times, n)
        """
        runs, count = states.shape[:2]
        if not self._program:
            moving, columns = self._moving
            if len(moving) == len(self.out):
                return states[:, :, columns]
        result = np.empty((runs, count, len(self.out)))
        own, length = base[:, self.registers], max(1, NUMBERS // max(1, count * len(self.registers)))
        for part in (slice(a, a + length) for a in range(0, runs, length)):
            some = own[part]
            w = np.repeat(some.T, count, axis=1)
            w[self.state_registers] = states[part].reshape(-1, states.shape[2])[:, self.state_columns].T
            self._bound = None
            self._interpreter.reset()
            self._interpreter.run(w, np.tile(times, len(some)))
            result[part] = w[self.out].T.reshape(len(some), count, -1)
        return result

    @cached_property
    def suits_runs(self) -> bool:
        """Return whether `across` has the bits of single runs: nothing is asked from Python, or solved at large."""
        return not len(self.sampled) and runs_alike(self._program)

    def _interpreted(self, own: np.ndarray) -> Callable[[np.ndarray, np.ndarray], None]:
        """``(w, times)`` fills w (registers, times) by the interpreter that all bindings share."""

        def run(w: np.ndarray, times: np.ndarray) -> None:
            if self._bound is not own:  # it keeps factors of another one's matrices
                self._interpreter.reset()
                self._bound = own
            self._interpreter.run(w, times)

        return run

    @cached_property
    def _interpreter(self) -> Interpreter:
        return Interpreter(self._program, len(self.registers))

    def _copies(self, constant: np.ndarray) -> Evaluate:
        """``(times, states) -> (times, registers)`` where nothing has to be computed: states, and what is constant."""
        moving, columns = self._moving

        def evaluate(times: np.ndarray, states: np.ndarray, known: np.ndarray | None = None) -> np.ndarray:
            if len(moving) == len(constant):
                return states[:, columns]
            result = np.repeat(constant[None], len(times), axis=0)
            result[:, moving] = states[:, columns]
            return result

        return evaluate


def _run_from(run: Follower, w: np.ndarray, times: np.ndarray, known: np.ndarray) -> None:
    """Fill w (registers, times), starting again at each time whose solutions are known."""
    edges = [0, *np.flatnonzero(known).tolist(), len(times)]
    for a, b in pairwise(edges):
        if a < b:
            if known[a]:
                run.begin_at(w[:, a])
            part = np.ascontiguousarray(w[:, a:b])
            run(part, times[a:b])
            w[:, a:b] = part


def slice_of(plan: Plan, registers: np.ndarray) -> Slice:
    """The slice for some registers, made once for a plan where it is small."""
    if len(registers) > KEPT_NAMES:
        return Slice(plan, registers)
    key = registers.tobytes()
    kept = plan.once(_kept)
    if key not in kept:
        kept[key] = Slice(plan, registers)
    return kept[key]


def _kept(_: Plan) -> dict[bytes, Slice]:
    """Return where the small slices of a plan are kept, by their registers."""
    return {}


def _follower(program: Program, count: int) -> Follower:
    """``(w, times)`` fills w (registers, times). Nonlinear blocks are followed from one time to the next."""
    return Interpreter(program, count).follower


def signal_values(signal: Signal, times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Any signal at many times; `values` are those of the parameters of the flat model."""
    if isinstance(signal, Formula):
        from lmoc.expression.evaluate import evaluate

        result = evaluate(signal.shape, lambda k, _: values[signal.variables[k]], times)
        return np.broadcast_to(np.asarray(result, float), times.shape)
    value = getattr(signal, "value", None)
    return np.full(times.shape, value) if isinstance(value, float) else sample(signal, 0, times)


def runs_alike(program: Program) -> bool:
    """Return whether the interpreter computes many runs at once as it does one: number by number.

    It keeps the factors of a constant matrix, which are those of one run.
    """
    blocks = [s for s in walk(program) if isinstance(s, Solve)]
    return all(b.linear and not b.constant and b.unknowns.shape[1] <= DENSE for b in blocks)


def _touch_guesses(step: Step, touched: np.ndarray) -> None:
    if isinstance(step, Solve):
        if step.guess is not None:
            touched[step.guess[step.guess >= 0]] = True
        for inner in step.inner:
            _touch_guesses(inner, touched)


def renumber(step: Step, new: np.ndarray) -> Step:
    """A step on other registers."""
    if isinstance(step, Apply):
        return Apply(step.shape, new[step.slots], new[step.out])
    if isinstance(step, Total):
        return replace(step, index=new[step.index], out=new[step.out])
    inner: Program = tuple(renumber(s, new) for s in step.inner)
    guess = None if step.guess is None else np.where(step.guess >= 0, new[step.guess], -1)
    return replace(step, inner=inner, unknowns=new[step.unknowns], residuals=new[step.residuals], guess=guess)
