"""A flat model with events as its equations are written, for derivations: one set of smooth or switched formulas."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lmoc.expression import dag
from lmoc.expression.dag import Expr, const
from lmoc.ir.events import Events
from lmoc.ir.flat import Assignments, FlatDAE, Group, Kind
from lmoc.ir.reduced import DiscreteStep
from lmoc.support.records import dataclass


@dataclass(frozen=True, eq=False)
class Written:
    """A model without events.

    Attributes
    ----------
    flat : FlatDAE
    values : (flat.count,) of its parameters and constants
    remembered : discrete variables in its equations that depend on the past, and are constants here
    """

    flat: FlatDAE
    values: np.ndarray
    remembered: tuple[int, ...] = ()


def as_written(
    flat: FlatDAE, values: np.ndarray, steps: Sequence[DiscreteStep], held: np.ndarray | None = None
) -> Written:
    """Return the model without events.

    Relations stand in the equations as they are written, ``if x > 0 then …``, and so do discrete variables that follow
    from the present alone: ``Boolean contact = x > 0``. Those that depend on the past, by `pre` or a `when`, are
    constants: they keep what they have at the start, or the values given.

    Parameters
    ----------
    values : (flat.count,) parameter values
    steps : how discrete variables are computed, in their order
    held : (flat.count,) values of all variables at one place of a run
    """
    events = flat.events
    if events is None:
        return Written(flat, values)
    present = _of_the_present(flat, events, steps)
    used = _used(flat, events, steps, present)
    present &= used
    formulas = _formulas(steps, present)
    constant = events.discrete
    numbers = _numbers(flat, events, values, held)
    blocks = tuple(
        b if b.kind != Kind.DISCRETE or not b.size
        else replace(b, kind=_kind_of_held(b.quantity))
        for b in flat.blocks
    )  # fmt: skip
    empty = np.zeros((len(constant), 0), int)
    binding = (Assignments(constant, const(np.nan), empty, None, numbers[constant]),) if len(constant) else ()
    result = replace(
        flat,
        blocks=blocks,
        groups=tuple(g for group in events.written for g in _with_formulas(group, formulas)),
        bindings=(*binding, *flat.bindings),
        events=None,
    )
    known = values.copy()
    known[constant] = numbers[constant]
    flags = (events.initial, events.terminal)
    remembered = (
        () if held is not None else tuple(v for v in constant.tolist() if used[v] and not present[v] and v not in flags)
    )
    return Written(result, known, remembered)


def _kind_of_held(quantity: str) -> Kind:
    """A number stays a symbol in formulas; what chooses a branch, or counts, has its value."""
    return Kind.PARAMETER if quantity == "Real" else Kind.CONSTANT


def _numbers(flat: FlatDAE, events: Events, values: np.ndarray, held: np.ndarray | None) -> np.ndarray:
    """(flat.count,) the values with which discrete variables start, or those given."""
    numbers = np.zeros(flat.count)
    if held is not None:
        numbers[events.discrete] = held[events.discrete]
        return numbers
    for a in flat.starts:
        own = np.isin(a.target, events.discrete)
        if own.any():
            numbers[a.target[own]] = np.broadcast_to(a.values(values), a.target.shape)[own]
    now, before = events.before
    numbers[before] = numbers[now]
    return numbers


def _columns(shape: Expr) -> list[int]:
    return sorted({leaf.value[0] for leaf in dag.slots(shape)})


def _of_the_present(flat: FlatDAE, events: Events, steps: Sequence[DiscreteStep]) -> np.ndarray:
    """(flat.count,) mask of discrete variables that follow from values of the same instant, whole blocks."""
    present = np.zeros(flat.count, bool)
    for step in steps:
        present[step.target] = True
    blocks = [np.arange(b.offset, b.offset + b.size) for b in flat.blocks if b.kind == Kind.DISCRETE and b.size]
    past = np.zeros(flat.count, bool)
    past[events.discrete] = True
    while True:
        before = int(present.sum())
        for own in blocks:
            present[own] = present[own].all()
        for step in steps:
            table = step.slots[:, _columns(step.value)]
            present[step.target] &= ~(past[table] & ~present[table]).any(axis=1)
        if int(present.sum()) == before:
            return present


def _used(flat: FlatDAE, events: Events, steps: Sequence[DiscreteStep], present: np.ndarray) -> np.ndarray:
    """(flat.count,) mask of variables that continuous equations use, also through discrete ones of the present."""
    used = np.zeros(flat.count, bool)
    for group in events.written:
        columns = sorted({*_columns(group.left), *_columns(group.right)})
        used[group.slots[:, columns]] = True
    for step in reversed(steps):
        rows = used[step.target] & present[step.target]
        used[step.slots[rows][:, _columns(step.value)]] = True
    return _whole(flat, used)


def _whole(flat: FlatDAE, mask: np.ndarray) -> np.ndarray:
    """The mask, with all elements of a discrete array where there is one of them."""
    for b in flat.blocks:
        if b.kind == Kind.DISCRETE and mask[b.offset : b.offset + b.size].any():
            mask[b.offset : b.offset + b.size] = True
    return mask


Formulas = dict[int, tuple[Expr, tuple[int, ...]]]  # of a discrete variable: a shape, and the variables in its slots


def _formulas(steps: Sequence[DiscreteStep], present: np.ndarray) -> Formulas:
    """What each discrete variable of the present is, in continuous variables, parameters and what is held."""
    found: Formulas = {}
    for step in steps:
        value = step.value
        if step.op == "floor":
            value = dag.function("floor", value)
        elif step.op:
            value = dag.function(step.op, value, dag.ZERO)
        for target, row in zip(step.target.tolist(), step.slots.tolist(), strict=True):
            if present[target]:
                (shape,), variables = _inlined((value,), row, found)
                found[target] = shape, variables
    return found


def _inlined(shapes: Sequence[Expr], row: Sequence[int], formulas: Formulas) -> tuple[list[Expr], tuple[int, ...]]:
    """Shapes with formulas in place of discrete variables, and the variables in their slots."""
    column: dict[int, int] = {}

    def slot(variable: int, order: int) -> Expr:
        return dag.slot(column.setdefault(variable, len(column)), order)

    new: dict[Expr, Expr] = {}
    for shape in shapes:
        for leaf in dag.slots(shape):
            k, order = leaf.value
            if row[k] in formulas:
                own, variables = formulas[row[k]]
                new[leaf] = dag.substitute(own, {n: slot(variables[n.value[0]], n.value[1]) for n in dag.slots(own)})
            else:
                new[leaf] = slot(row[k], order)
    return [dag.substitute(shape, new) for shape in shapes], tuple(column)


def _with_formulas(group: Group, formulas: Formulas) -> list[Group]:
    """The equations of a group with formulas in place of discrete variables: rows of one form stay together."""
    columns = sorted({*_columns(group.left), *_columns(group.right)})
    if not any(v in formulas for v in np.unique(group.slots[:, columns]).tolist()):
        return [group]
    rows: dict[tuple[Expr, Expr], list[tuple[int, ...]]] = {}
    for row in group.slots.tolist():
        (left, right), variables = _inlined((group.left, group.right), row, formulas)
        rows.setdefault((left, right), []).append(variables)
    return [replace(group, left=a, right=b, slots=np.array(table)) for (a, b), table in rows.items()]
