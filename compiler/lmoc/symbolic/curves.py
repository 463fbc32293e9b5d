"""Curves through many points as a person writes them: ``h(φ)`` by its name, no case for each of its pieces."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from lmoc.expression.dag import TIME, postorder, slots
from lmoc.expression.to_sympy import lower_with
from lmoc.ir.flat import FlatDAE, Group, Kind
from lmoc.ir.prepared import Prepared
from lmoc.ir.reduced import Reduced
from lmoc.messages.diagnostics import ModelError

if TYPE_CHECKING:
    import sympy

MOST_CASES = 60  # conditions in one equation: a table of 12 points has as many, and its equation fills a page
LEAST_CASES = 8  # of a curve that is called by its name: a table of two points has as many

Curves = Mapping[str, tuple[str, str]]  # as `Prepared.curves`
Reduce = Callable[[FlatDAE, np.ndarray, Sequence[str] | None], Reduced]


def cases(group: Group) -> int:
    """Return the number of conditions in an equation."""
    return sum(node.op == "if" for side in (group.left, group.right) for node in postorder(side))


def with_named_curves(prepared: Prepared, reduce: Reduce) -> Prepared:
    """Return a scene whose long curves are signals; as it is where it has none.

    An equation that holds for any signal holds for the curve; `curve_rates.along` says what its rates are.

    Parameters
    ----------
    reduce : from a flat model, parameter values and requested states (None for the scene's) to its reduction
    """
    flat = prepared.flat
    over = {v: x for g in flat.groups if cases(g) >= LEAST_CASES for v, x in _curves(flat, g)}
    signals = [k for k, b in enumerate(flat.blocks) if {*range(b.offset, b.offset + b.size)} <= over.keys()]
    if not signals or sum(flat.blocks[k].size for k in signals) < len(over):
        return prepared  # some elements of an array alone cannot be signals
    blocks = [replace(b, kind=Kind.INPUT) if k in signals else b for k, b in enumerate(flat.blocks)]
    kind = flat.kind.copy()
    kind[list(over)] = Kind.INPUT
    kept = (g for g in flat.groups if cases(g) < LEAST_CASES or not all(v in over for v, _ in _curves(flat, g)))
    named = replace(flat, blocks=tuple(blocks), groups=tuple(part for g in kept for part in _by_kind(g, kind)))
    slope_of = _slopes(flat, over)
    curves = {
        flat.variable_name(v): (flat.variable_name(x), flat.variable_name(slope_of[v]) if v in slope_of else "")
        for v, x in over.items()
    }
    try:
        reduced = reduce(named, prepared.values, None)
    except ModelError:  # the curves are all that ties down what they go over, as the place along a track
        return prepared
    return replace(prepared, flat=named, reduced=reduced, curves=curves)


def _curves(flat: FlatDAE, group: Group) -> Iterator[tuple[int, int]]:
    """Yield (variable, what it is a curve over) of the rows of a group ``v = f(x)``."""
    moving = {s.value for s in slots(group.right) if flat.kind[group.slots[0, s.value[0]]] >= Kind.INPUT}
    if group.left.op != "slot" or group.left.value[1] != 0 or len(moving) != 1 or TIME in postorder(group.right):
        return  # what moves by itself, too, has other rates
    ((argument, order),) = moving
    column = group.left.value[0]
    if order == 0 and flat.kind[group.slots[0, column]] == Kind.UNKNOWN:
        yield from zip(group.slots[:, column].tolist(), group.slots[:, argument].tolist(), strict=True)


def _by_kind(group: Group, kind: np.ndarray) -> Iterator[Group]:
    """Yield groups each of whose columns holds variables of one kind."""
    _, of_row = np.unique(kind[group.slots], axis=0, return_inverse=True)
    for k in range(of_row.max(initial=-1) + 1):
        yield replace(group, slots=group.slots[of_row.ravel() == k])


def _slopes(flat: FlatDAE, over: Mapping[int, int]) -> dict[int, int]:
    """Return {curve: curve that is its slope}: with the pieces' coefficients as symbols, they are polynomials."""
    import sympy as sp

    pieces: dict[tuple, sympy.Dummy] = {}
    x = sp.Dummy("x")
    form = {v: _on_a_piece(flat, g, row, over[v], x, pieces) for v, g, row in _rows_of(flat, over)}
    return {
        v: w
        for v in form
        for w in form
        if v != w and over[v] == over[w] and sp.expand(sp.diff(form[v], x) - form[w]) == 0 and form[w] != 0
    }


def _rows_of(flat: FlatDAE, over: Mapping[int, int]) -> Iterator[tuple[int, Group, int]]:
    for g in flat.groups:
        if cases(g) >= LEAST_CASES:
            yield from ((v, g, row) for row, (v, _) in enumerate(_curves(flat, g)) if v in over)


def _on_a_piece(flat: FlatDAE, group: Group, row: int, argument: int, x: sympy.Dummy, pieces: dict) -> sympy.Expr:
    """Return a curve where it does not pass from one piece to the next: what depends on the piece is a symbol."""
    import sympy as sp

    def column(k: int, _: int) -> sympy.Expr:
        variable = int(group.slots[row, k])
        return x if variable == argument else sp.Symbol(flat.variable_name(variable))

    def constant(*key: object) -> sympy.Dummy:
        return pieces.setdefault(key, sp.Dummy())

    def choice(condition: sympy.Basic, yes: sympy.Expr, no: sympy.Expr) -> sympy.Expr:
        moving = x in yes.free_symbols | no.free_symbols
        return sp.Piecewise((yes, condition), (no, True)) if moving else constant(condition, yes, no)

    def modulo(value: sympy.Expr, period: sympy.Expr) -> sympy.Expr:
        return value - period * constant("turns", value, period)

    return lower_with(group.right, column, {"if": choice, "mod": modulo})
