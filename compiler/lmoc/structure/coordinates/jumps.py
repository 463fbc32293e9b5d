"""What jumps while its arguments do not, as an angle that begins again after each turn: ``phi = mod(theta, 2*pi)``.

Of such an equation phi follows from theta, theta from phi only until the next jump: phi is no coordinate.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lmoc.expression.dag import Expr, depends_on_time, nodes_outside_events, slots
from lmoc.structure.index.system import EquationBatch, EquationSystem
from lmoc.structure.linear.coefficients import INPUT, UNKNOWN, Kinds

_BENDS = frozenset(("abs", "min", "max"))
_STEPS = frozenset(("sign", "floor", "ceil", "integer", "mod", "rem", "div_integer", "xor"))


def deciding(shape: Expr, kinds: Kinds) -> Iterator[Expr]:
    """Yield what decides, outside of `event`, on a value that may jump: unknowns are in it."""
    for node in nodes_outside_events(shape):
        if node.op == "if" or node.op in _STEPS:
            own = node.args[:1] if node.op == "if" else node.args
            yield from (a for a in own if any(kinds[leaf.value[0]] == UNKNOWN for leaf in slots(a)))


def bends(shape: Expr, kinds: Kinds) -> bool:
    """Return whether a function of time alone has a kink without an event: its second derivative lacks an impulse."""
    return any(
        node.op in _BENDS and depends_on_time(node) and all(kinds[leaf.value[0]] != UNKNOWN for leaf in slots(node))
        for node in nodes_outside_events(shape)
    )


def jumping(system: EquationSystem, c: np.ndarray) -> np.ndarray:
    """(columns,) what jumps in an equation that is differentiated, while other unknowns in it decide when.

    Parameters
    ----------
    c : (rows,) how often each equation is differentiated
    """
    found = np.zeros(len(system.variable), bool)
    smooth = np.zeros(len(system.variable), bool)
    arguments = _arguments_of_relations(system)
    for b in system.batches:
        if INPUT not in b.kinds and next(deciding(b.shape, b.kinds), None) is None:
            continue
        for row in np.flatnonzero(c[b.row] > 0).tolist():
            decides = _deciding_columns(system, b, row, arguments)
            own = {int(system.column[b.slots[row, leaf.value[0]]]) for leaf in b.unknown}
            if decides & own:
                smooth[list(decides & own)] = True
                found[list(own - decides)] = True
    return found & ~smooth


def _deciding_columns(system: EquationSystem, b: EquationBatch, row: int, arguments: dict[int, set[int]]) -> set[int]:
    inside = {leaf for part in deciding(b.shape, b.kinds) for leaf in slots(part)}
    columns = {int(system.column[b.slots[row, leaf.value[0]]]) for leaf in inside if b.kinds[leaf.value[0]] == UNKNOWN}
    held = (k for k, kind in enumerate(b.kinds) if kind == INPUT)
    return columns.union(*(arguments.get(int(b.slots[row, k]), set()) for k in held))


def _arguments_of_relations(system: EquationSystem) -> dict[int, set[int]]:
    """Return the columns that decide on the discrete variables of relations."""
    events = system.flat.events
    found: dict[int, set[int]] = {}
    for relation in () if events is None else events.relations:
        columns = system.column[system.normalized.root[relation.slots[:, [s.value[0] for s in slots(relation.zero)]]]]
        for target, own in zip(relation.target.tolist(), columns.tolist(), strict=True):
            found[target] = {k for k in own if k >= 0}
    return found
