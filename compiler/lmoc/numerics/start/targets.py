"""Values that variables shall have at the start: the model's own and the caller's."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lmoc.ir.flat import FlatDAE, Kind
from lmoc.ir.names import hint_for
from lmoc.messages.diagnostics import Report
from lmoc.numerics.plan.plan import Plan
from lmoc.support.records import dataclass


@dataclass(frozen=True, eq=False)
class Targets:
    """Values that variables of the flat model shall have at the start."""

    variable: np.ndarray
    value: np.ndarray
    hard: np.ndarray  # fixed, or given by the caller
    given: np.ndarray  # by the caller: nothing in the model says so

    def __len__(self) -> int:
        return len(self.variable)


class _OwnStarts:
    """The model's own start values, kept for the parameter values that they were computed with last."""

    def __init__(self, plan: Plan) -> None:
        self.flat = plan.reduced.flat
        self._given: bytes | None = None
        self._found = np.zeros(0), np.zeros(0, bool)
        self._targets: Targets | None = None

    def targets(self, values: np.ndarray) -> Targets:
        """Return them as targets, made once for the same parameter values."""
        start, hard = self._at(values)
        if self._targets is None:
            chosen = _chosen(self.flat, start)
            self._targets = Targets(chosen, start[chosen], hard[chosen], np.zeros(len(chosen), bool))
        return self._targets

    def at(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the values (count,), NaN where there is none, and a mask of those that hold exactly."""
        start, hard = self._at(values)
        return start.copy(), hard.copy()

    def _at(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        flat, given = self.flat, values.tobytes()
        if given != self._given:
            self._given, self._found, self._targets = given, own_starts(flat, values), None
        return self._found


def own_starts(flat: FlatDAE, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the model's own start values, NaN where there is none, and a mask of those that hold exactly.

    Parameters
    ----------
    values : parameters of the model as it is written, or with those that a reduction has added; (…, runs) of many runs
    """
    shape = flat.count, *values.shape[1:]
    start, hard = np.full(shape, np.nan), np.zeros(shape, bool)
    for a in flat.starts:
        start[a.target] = a.values(values)
    for a in flat.fixed:
        hard[a.target] = a.values(values) != 0
    start[hard & np.isnan(start)] = 0.0
    return start, hard


def targets(plan: Plan, values: np.ndarray, initial: Mapping[str, float], report: Report) -> Targets:
    """Fixed and start values of unknowns, with those of the caller in place of the model's own.

    Parameters
    ----------
    values : of the parameters of its flat model
    initial : {name: value}; the name of an array takes one value or as many as it has variables
    """
    if not initial:
        return plan.once(_OwnStarts).targets(values)
    flat = plan.reduced.flat
    start, hard = plan.once(_OwnStarts).at(values)
    given = np.zeros(flat.count, bool)
    for name, value in initial.items():
        variables = flat.find(name)
        if variables is None:
            hint = hint_for(flat, name, lambda b: b.kind == Kind.UNKNOWN)
            report.error("E0622", f"there is no variable '{name}' to initialize", hint=hint)
        elif flat.events is not None and flat.kind[variables[0]] == Kind.DISCRETE:
            past = [step.target for step in plan.reduced.started]
            determined = flat.events.before[0][np.isin(flat.events.before[1], np.concatenate([variables[:0], *past]))]
            if np.isin(variables, determined).any():
                report.error("E0534", f"'{name}' has an initial equation, which gives its value at the start")
        elif flat.kind[variables[0]] != Kind.UNKNOWN:
            hint = f"it is a parameter: --set {name}={value:g}, or parameters={{'{name}': {value:g}}}"
            hint = hint if flat.kind[variables[0]] == Kind.PARAMETER else ""
            report.error("E0534", f"'{name}' is not a variable that can be given an initial value", hint=hint)
        else:
            start[variables], hard[variables], given[variables] = value, True, True
    chosen = _chosen(flat, start)
    return Targets(chosen, start[chosen], hard[chosen], given[chosen])


def _chosen(flat: FlatDAE, start: np.ndarray) -> np.ndarray:
    """Return the unknowns that have a start value."""
    return np.flatnonzero(np.isfinite(start) & (flat.kind == Kind.UNKNOWN))
