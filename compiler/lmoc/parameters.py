"""Values by name, as a caller gives them and asks for them: parameters and starts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from lmoc.expression.dag import const
from lmoc.ir.flat import Assignments, FlatDAE, Kind
from lmoc.ir.names import Names, hint_for
from lmoc.messages.diagnostics import Report

Value = float | bool | Sequence[float] | np.ndarray
_EXTREME = 1e-12, 1e12  # magnitudes of numbers in SI units beyond which nothing mechanical is made
_NAMED = 3


class Parameters(Mapping):
    """Parameters by dotted name: their values, NaN where the model gives none. An array by its own name is an array."""

    def __init__(self, flat: FlatDAE, values: np.ndarray):
        self._flat = flat
        self._values = values
        self._names = Names(flat, np.flatnonzero(flat.kind == Kind.PARAMETER))

    def __getitem__(self, name: str) -> float | np.ndarray:
        found = self._flat.find(name) if isinstance(name, str) else None
        if found is None or self._flat.kind[found[0]] != Kind.PARAMETER:
            raise KeyError(name)
        values = self._values[found]
        return float(values[0]) if name in self._names else values

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def __repr__(self) -> str:
        if len(self) > 60:
            return f"<{len(self)} parameters>"
        return "{" + ", ".join(f"{name!r}: {value:g}" for name, value in self.items()) + "}"


def check_mappings(**given: object) -> None:
    """TypeError where something given by name is not a mapping."""
    for name, value in given.items():
        if value is not None and not isinstance(value, Mapping):
            raise TypeError(f"{name} must be a mapping of names to values, not {type(value).__name__}")


def check_initial(initial: Mapping[str, Value]) -> None:
    """Start values must be finite numbers (E0621); whether the model has the names is seen later."""
    report = Report()
    for name, value in initial.items():
        try:
            fits = bool(np.isfinite(np.asarray(value, float)).all())
        except (TypeError, ValueError):
            fits = False
        if not fits:
            found = f"{value!r:.80}"
            report.error("E0621", f"the start value of '{name}' does not fit", expected="a number", found=found)
    report.check()


def indexed(flat: FlatDAE, parameters: Mapping[str, Value]) -> dict[int, float]:
    """Parameter values by variable index; an array takes one value for all or one for each.

    Raises
    ------
    ModelError
        E0622 no such parameter, E0206 and E0210 a final or protected one, E0301 and E0621 a value that does not fit.
    """
    report, found = Report(), {}
    for name, value in parameters.items():
        variables = flat.find(name)
        if variables is None or flat.kind[variables[0]] != Kind.PARAMETER:
            what = "is not a parameter of" if variables is not None else "is not in"
            hint = hint_for(flat, name, lambda b: b.kind == Kind.PARAMETER)
            report.error("E0622", f"'{name}' {what} '{flat.name}'", hint=hint)
            continue
        block = flat.block_at(int(variables[0]))
        if block.final or block.protected:
            code, why = ("E0206", "final: its value follows from others") if block.final else ("E0210", "protected")
            report.error(code, f"'{name}' is {why}", block.span)
            continue
        try:
            numbers = np.broadcast_to(np.asarray(value, float).ravel(), len(variables))
        except (TypeError, ValueError):
            expected = "one number" if len(variables) == 1 else f"one number or {len(variables)}"
            report.error("E0621", f"the value of '{name}' does not fit", expected=expected, found=f"{value!r:.80}")
            continue
        from lmoc.semantics.nodes.overrides import other_type

        expected = other_type(block.quantity, numbers)
        if expected:
            report.error("E0301", f"'{name}' must be {expected}", block.span, found=f"{value!r:.80}")
        found.update(zip(variables.tolist(), numbers.tolist(), strict=True))
    report.check()
    return found


def extreme_values(flat: FlatDAE, values: np.ndarray, given: Mapping[str, Value]) -> str:
    """Return a sentence about parameters that are very large or very small, but not 0; empty where none are.

    Parameters
    ----------
    given : values in place of the model's own
    """
    least, most = _EXTREME
    parameters = np.flatnonzero(flat.kind == Kind.PARAMETER)
    size = np.abs(values[parameters])
    far = parameters[(size > most) | ((size > 0) & (size < least))]
    found = {flat.variable_name(int(v)): float(values[v]) for v in far[:100] if not flat.block_at(int(v)).protected}
    given = {name: v for name, v in given.items() if isinstance(v, (int, float))}
    found = {name: v for name, v in found.items() if name not in given}
    found |= {name: float(v) for name, v in given.items() if v and not least <= abs(v) <= most}
    own = dict(list(found.items())[:_NAMED])
    more = f" and {len(found) - _NAMED} more" if len(found) > _NAMED else ""
    return f"is {', '.join(f'{name} = {v:g}' for name, v in own.items())}{more} meant?" if own else ""


def starting_at(flat: FlatDAE, initial: Mapping[str, float]) -> FlatDAE:
    """The flat model with other values fixed at its start; names that it does not have are left out."""
    starts, fixed = list(flat.starts), list(flat.fixed)
    for name, value in initial.items():
        variables = flat.find(name)
        if variables is not None:
            numbers = np.broadcast_to(np.asarray(value, float).ravel(), len(variables))
            for made, own in ((starts, numbers), (fixed, np.ones(len(variables)))):
                made.append(Assignments(variables, const(np.nan), np.zeros((len(variables), 0), int), numbers=own))
    return replace(flat, starts=tuple(starts), fixed=tuple(fixed))
