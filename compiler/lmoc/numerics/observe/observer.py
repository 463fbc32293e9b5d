"""From states to variables: every variable of the flat model, computed on demand."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field

import numpy as np

from lmoc.engine.passage import places_beside
from lmoc.ir.flat import FlatDAE, Kind
from lmoc.messages.diagnostics import nearest
from lmoc.numerics.limits import KEPT_NAMES
from lmoc.numerics.observe.slices import Evaluate, Slice, signal_values, slice_of
from lmoc.numerics.observe.solutions import Solutions
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.signals.signals import Signal
from lmoc.support.distinct import distinct
from lmoc.support.records import dataclass


@dataclass(frozen=True, eq=False)
class Path:
    """Places of a motion.

    Attributes
    ----------
    times, states : s, (times, n)
    unknowns, solutions : registers of unknowns of nonlinear blocks, and their values (times, unknowns)
    aside : where a singular position lies on the way
    """

    times: np.ndarray
    states: np.ndarray
    unknowns: np.ndarray
    solutions: np.ndarray
    aside: Aside | None = None

    def of(self, registers: np.ndarray) -> np.ndarray:
        """Return the solutions (times, registers) of some unknowns; NaN for others."""
        column = {int(r): k for k, r in enumerate(self.unknowns.tolist())}
        at = np.array([column.get(r, len(column)) for r in registers.tolist()], int)
        return np.column_stack([self.solutions, np.full(len(self.times), np.nan)])[:, at]

    def between(self, values: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Return values (times, …) that are known at the places, at other times on straight lines between them."""
        if len(self.times) == 1:
            return np.repeat(values, len(times), axis=0)
        after = np.clip(np.searchsorted(self.times, times), 1, len(self.times) - 1)
        begin, length = self.times[after - 1], self.times[after] - self.times[after - 1]
        share = np.clip((times - begin) / np.where(length > 0, length, 1.0), 0.0, 1.0)[:, None]
        return (1.0 - share) * values[after - 1] + share * values[after]


@dataclass(frozen=True, eq=False)
class Aside:
    """A way over a singular position, where what follows from the states is 0/0: its values are the limit.

    Attributes
    ----------
    singular, width : s, the instant, and the length of the way
    at : times -> (states, solutions of the blocks)
    """

    singular: float
    width: float
    at: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]

    def around(self, values: Evaluate, evaluate: Evaluate, unknowns: np.ndarray, path: Path) -> Evaluate:
        """Return ``(times, states) -> values`` that interpolates next to the singular position.

        Parameters
        ----------
        values, evaluate : the same without that, along the path and from given solutions of `unknowns`
        """

        def found(times: np.ndarray, states: np.ndarray) -> np.ndarray:
            result = values(times, states)
            for k, time in enumerate(times.tolist()):
                beside, weights = places_beside(time, self.singular, self.width)
                if len(beside) > 1:
                    states_there, solutions = self.at(beside)
                    seeds = Path(beside, states_there, path.unknowns, solutions).of(unknowns) if len(unknowns) else None
                    result[k] = weights @ evaluate(beside, states_there, seeds)
            return result

        return found




@dataclass(eq=False, repr=False)
class Observer:
    """The data needed to compute variables from states: the plan, and the parameter values and signals of the run.

    Attributes
    ----------
    path : of the integrator's steps, along which nonlinear equations are followed: their solutions at the output times
        are then those of the motion, however far apart these are
    """

    plan: Plan
    values: np.ndarray
    base: np.ndarray
    signals: Mapping[int, Signal]
    path: Path | None = None
    solutions: Solutions = field(default_factory=Solutions)

    @property
    def flat(self) -> FlatDAE:
        return self.plan.reduced.flat

    def derivative(self, variable: int, order: int) -> int:
        """Return the register of a derivative of a variable, -1 where there is none.

        A variable may be a jet of another one: v = der(q).
        """
        reduced, table = self.plan.reduced, self.plan.reduced.registers
        own = np.flatnonzero((table.variable == variable) & (table.order == order))
        if len(own):
            return int(own[0])
        register = int(reduced.register_of[variable])
        integrated = [*reduced.states.tolist(), *reduced.quadratures.tolist()]
        rates = np.concatenate([reduced.derivatives, reduced.quadrature_derivatives])
        for _ in range(order):
            if register not in integrated:
                return -1
            register = int(rates[integrated.index(register)])
        return register

    def register(self, register: int, times: np.ndarray, states: np.ndarray) -> np.ndarray:
        """Return the values (times,) of one register."""
        return self.followed(slice_of(self.plan, np.array([register])))(times, states)[:, 0]

    def followed(
        self, part: Slice, base: np.ndarray | None = None, lasting: bool = False
    ) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
        """Return ``(times, states) -> values`` of a slice, nonlinear equations followed along the path.

        Parameters
        ----------
        base : registers that do not change, where the slice has more of them than the plan
        lasting : the places do not change any more, so that the solutions there are kept
        """
        base, path = self.base if base is None else base, self.path
        if path is None:
            return part.bind(base, self.signals)
        values = self._along(path, part, base, lasting) if part.implicit else part.bind(base, self.signals)
        if path.aside is None:
            return values
        return path.aside.around(values, part.bind(base, self.signals), part.registers[part.unknowns], path)

    def _along(self, path: Path, part: Slice, base: np.ndarray, lasting: bool) -> Evaluate:
        """Return a slice's values with nonlinear equations followed along a path; `lasting` as of `followed`."""
        own = part.registers[part.unknowns]
        known = path.of(own)
        whole = bool(np.isfinite(known).all())

        def values(times: np.ndarray, states: np.ndarray) -> np.ndarray:
            if not len(times) or not whole:
                return one_by_one(times, states)
            guesses = path.between(known, times)
            solved = self.solutions.fill(times, states, own, guesses) if lasting else np.zeros(len(own), bool)
            in_c = None if solved.all() else self._solved_in_c(path, own, times, states)
            if in_c is not None:
                guesses, solved = in_c, np.ones(len(own), bool)
                if lasting:
                    self.solutions.keep(times, states, own, in_c)
            found, good, solutions = part.bind_together(base, self.signals, solved)(times, states, guesses)
            if not good.all():
                found[~good] = one_by_one(times[~good], states[~good])
            elif lasting and not solved.all():
                self.solutions.keep(times, states, own, solutions)
            return found

        def one_by_one(times: np.ndarray, states: np.ndarray) -> np.ndarray:
            evaluate = part.bind(base, self.signals)
            if not len(times):
                return evaluate(times, states)
            before = np.flatnonzero(path.times <= times[-1])
            if whole:  # those just before an output time are enough
                before = distinct(np.maximum(np.searchsorted(path.times, times, "right") - 1, 0))
            every = np.concatenate([path.times[before], times])
            order = np.argsort(every, kind="stable")
            both = np.concatenate([path.states[before], states])[order]
            seeds = np.concatenate([known[before], np.full((len(times), len(own)), np.nan)])[order]
            found = evaluate(every[order], both, seeds)
            back = np.empty(len(order), int)
            back[order] = np.arange(len(order))
            return found[back[len(before) :]]

        return values

    def _solved_in_c(
        self, path: Path, unknowns: np.ndarray, times: np.ndarray, states: np.ndarray
    ) -> np.ndarray | None:
        """Return the solutions (times, unknowns) by the compiled program; None where it has none, or is not there."""
        from lmoc.numerics.evaluate.observed import Observed

        if len(self.plan.sampled):
            return None
        observed = self.plan.once(Observed)
        if not np.isin(unknowns, observed.unknowns).all():
            return None
        guesses = path.between(path.of(observed.unknowns), times)
        return observed(self.base, times, states, guesses, unknowns)

    def __call__(
        self, variables: np.ndarray, times: np.ndarray, states: np.ndarray, lasting: bool = False
    ) -> np.ndarray:
        """Values of variables of the flat model, (times, variables); NaN for what the model leaves open.

        Parameters
        ----------
        lasting : as in `followed`
        """
        return self.prepare(variables, lasting)(times, states)

    def is_implicit(self, variables: np.ndarray) -> bool:
        """Return whether variables follow from nonlinear blocks, whose solutions are followed along a path."""
        computed = sources(self.plan, variables)[2]
        return slice_of(self.plan, self.plan.reduced.register_of[variables[computed]]).implicit

    def prepare(self, variables: np.ndarray, lasting: bool = False):
        """``(times, states) -> (times, variables)`` for repeated use."""
        variables = np.asarray(variables, int)
        constant, inputs, computed = sources(self.plan, variables)
        part = self.followed(slice_of(self.plan, self.plan.reduced.register_of[variables[computed]]), lasting=lasting)
        if len(computed) == len(variables):
            return part

        def values(times: np.ndarray, states: np.ndarray) -> np.ndarray:
            result = np.full((len(times), len(variables)), np.nan)
            result[:, constant] = self.values[variables[constant]]
            for k in inputs:
                signal = self.signals.get(int(variables[k]))
                if signal is not None:
                    result[:, k] = signal_values(signal, times, self.values)
            if len(computed):
                result[:, computed] = part(times, states)
            return result

        return values


def sources(plan: Plan, variables: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return where the values of variables come from: a mask of constants, places of inputs and of what is computed."""
    if len(variables) > KEPT_NAMES:
        return _sorted_by_source(plan, variables)
    kept, key = plan.once(_kept), variables.tobytes()
    if key not in kept:
        kept[key] = _sorted_by_source(plan, variables)
    return kept[key]


def _kept(_: Plan) -> dict[bytes, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Return where the sources of a few variables are kept, by these."""
    return {}


def _sorted_by_source(plan: Plan, variables: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    reduced = plan.reduced
    kinds = reduced.flat.kind[variables]
    constant = (kinds == Kind.PARAMETER) | (kinds == Kind.CONSTANT)
    computed = np.flatnonzero(~constant & (kinds != Kind.INPUT) & (reduced.register_of[variables] >= 0))
    # what is not determined stays NaN, whatever one of its possible values the solution has taken
    computed = computed[~np.isin(variables[computed], reduced.undetermined)]
    return constant, np.flatnonzero(kinds == Kind.INPUT), computed


def find(flat: FlatDAE, name: str) -> np.ndarray:
    """Variables of a name; KeyError with a hint where there are none."""
    variables = flat.find(name)
    if variables is None:
        hint = nearest(name, [b.pattern for b in flat.blocks])
        raise KeyError(f"no variable '{name}' in '{flat.name}'" + (f"; {hint}" if hint else ""))
    return variables
