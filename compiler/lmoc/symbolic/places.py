"""Points about which a scene is made linear: given by names, by a moment of a run, or the equilibrium."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from numbers import Real
from typing import TYPE_CHECKING, Any

import numpy as np

from lmoc.ir.flat import Kind
from lmoc.ir.prepared import Prepared
from lmoc.messages.diagnostics import Diagnostic, ModelError, nearest
from lmoc.support.records import dataclass
from lmoc.symbolic.values import exactly, no_value

if TYPE_CHECKING:
    import sympy

    from lmoc.symbolic.equilibria import Equilibrium

Point = Mapping[str, Any]
HOW_TO_CHOOSE = "say where, as `--at name=value` or `at={name: value}`"
LINEAR, START = "to linearize about", "to start from"
HINTS = {
    LINEAR: f"choose one, `--equilibrium 1` or in Python `at=dae.equilibria()[0]`; or {HOW_TO_CHOOSE}",
    START: "choose one, in Python `initial=dae.equilibria()[0]`; or fix states, as `--init name=value`",
}

_LISTED = 12  # names listed where none of them is like the one given


@dataclass(frozen=True)
class Moment:
    """A point of a run.

    Attributes
    ----------
    time : s
    values : {name: number} of states and inputs
    """

    time: float
    values: Mapping[str, float]


def no_place(message: str, **more: str) -> ModelError:
    """Return the error for a point that there is not, E0663."""
    return ModelError([Diagnostic("E0663", message, **more)])


def check_names(given: Point, known: Sequence[str]) -> None:
    """Raise E0661 for a name that is not among the states and inputs."""
    for name in given:
        if name not in known:
            few = f"there are {', '.join(known)}" if 0 < len(known) <= _LISTED else ""
            hint = nearest(name, known) or few
            raise ModelError([Diagnostic("E0661", f"'{name}' is neither a state nor an input", hint=hint)])


def with_inputs(at: Point | None, inputs: Point) -> dict[str, Any]:
    """Return a point with the inputs that an equilibrium was found for."""
    own = {u.name: value for u, value in getattr(at, "inputs", {}).items()}
    return {**(at or {}), **own, **inputs}


def at_moment(moment: Moment, inputs: Point) -> dict[str, float]:
    """Return states and inputs at a moment of a run, whose own inputs act."""
    if inputs:
        hint = "leave the values of the inputs out, or say where by a point {state: value}"
        raise no_place("at a time of the run its own inputs act", hint=hint)
    return dict(moment.values)


def numbers(prepared: Prepared, point: Point) -> dict[str, float]:
    """Return a point as numbers: expressions in parameters by their values, a free state of a family as zero.

    Raises
    ------
    ModelError
        E0661 for a symbol that is no parameter, E0662 for one without a value.
    """
    return {name: number(prepared, value, set(point)) for name, value in point.items()}


def number(prepared: Prepared, value: object, free: set[str]) -> float:
    """Return a number or an expression in parameters as a number; the names in `free` count as zero."""
    if isinstance(value, Real):
        return float(value)
    import sympy as sp

    expression = exactly(value)
    known = {s: sp.S.Zero for s in expression.free_symbols if s.name in free}
    for s in expression.free_symbols - known.keys():
        found = prepared.flat.find(s.name)
        if found is None or len(found) != 1:
            raise ModelError([Diagnostic("E0661", f"there is no parameter '{s.name}'")])
        if np.isnan(prepared.values[found[0]]):
            raise no_value([s.name], inputs=prepared.flat.kind[found[0]] == Kind.INPUT)
        known[s] = sp.Float(float(prepared.values[found[0]]), 17)
    return float(expression.subs(known))


def only(found: Sequence[Equilibrium], purpose: str = LINEAR) -> Equilibrium:
    """Return the one equilibrium there is, a family being one.

    Parameters
    ----------
    purpose : `LINEAR` or `START`, for the message

    Raises
    ------
    ModelError
        E0663 where there is none, or several.
    """
    if len(found) == 1:
        return found[0]
    if not found:
        raise no_place(f"there is no equilibrium {purpose}", hint=HOW_TO_CHOOSE if purpose == LINEAR else "")
    shown = "; ".join(f"({i}) {in_words(e)}" for i, e in enumerate(found, 1))
    raise no_place(f"there is not one equilibrium {purpose} but {len(found)}", found=shown, hint=HINTS[purpose])


def in_words(e: Equilibrium) -> str:
    """Return the coordinates of an equilibrium that are not zero, in words."""
    values = {n: f"{float(v):.6g}" if v.is_Float else str(v) for n, v in e.items()}
    free = [s.name for s in e.free]
    ranges = {} if e.laws is None else e.laws.range
    parts = [f"{n} = {v}" for n, v in values.items() if v != "0" and n not in free]
    parts += [f"{n} from {ranges[n][0]:.6g} to {ranges[n][1]:.6g}" if n in ranges else f"{n} any" for n in free]
    parts += [] if e.laws is None else [f"{name} {word}" for name, word in list(e.laws.modes.items())[:6]]
    return ", ".join(parts) or "all states 0"


def values_by_symbol(point: Point) -> dict[sympy.Symbol, sympy.Expr]:
    """Return {Symbol: exact value} of a point."""
    import sympy as sp

    return {sp.Symbol(name): exactly(value) for name, value in point.items()}
