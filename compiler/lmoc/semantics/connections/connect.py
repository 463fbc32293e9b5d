"""Connection sets and the equations they give (Modelica specification, 9.1-9.3).

Sets are found for single variables: two connected connectors connect the variables of the same names. A flow variable
stands in at most two sets, as seen from outside its part and from inside; the two are different elements.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import prod

import numpy as np

from lmoc.expression import dag
from lmoc.ir.flat import Group, Kind, Sums
from lmoc.messages.diagnostics import Label, Report
from lmoc.messages.source import Span
from lmoc.semantics.connections.components import components
from lmoc.semantics.connections.signal_sources import SignalEdge, check_sources
from lmoc.semantics.drafts.draft import CheckDraft, ConnectDraft
from lmoc.semantics.mistakes.wrong import Wrong
from lmoc.semantics.nodes.instance import Absent, Broken, Instance, InstanceNode, Variable
from lmoc.semantics.values.unit_inference import unit_of
from lmoc.support.distinct import first_of_each, numbered
from lmoc.support.records import dataclass


@dataclass(frozen=True, eq=False)
class Edges:
    """Pairs of connected variables: indices of the flat model, and the `connect` that says so."""

    left: np.ndarray
    right: np.ndarray
    connect: np.ndarray

    @staticmethod
    def join(parts: list[tuple[np.ndarray, np.ndarray, int]]) -> Edges:
        """Edges of several connects, given as (left, right, number of the connect)."""
        if not parts:
            nothing = np.zeros(0, int)
            return Edges(nothing, nothing, nothing)
        left, right, number = zip(*parts)
        return Edges(np.concatenate(left), np.concatenate(right), np.repeat(number, [len(a) for a in left]).astype(int))


@dataclass(frozen=True, eq=False)
class Connections:
    """All connections of a model.

    Attributes
    ----------
    across : edges between variables that are equal
    through : edges between elements of flow sets: a variable's index, plus `count` where seen from inside its part
    equal : that parameters and constants of connected connectors have the same values (9.2)
    """

    connects: tuple[ConnectDraft, ...]
    across: Edges
    through: Edges
    count: int
    equal: tuple[CheckDraft, ...] = ()


def collect(
    connects: list[ConnectDraft], count: int, report: Report, left_out: Mapping[tuple[int, int], set[int]]
) -> Connections:
    """The edges of all connects; those that are wrong are reported and left out.

    Parameters
    ----------
    left_out : (number of the connect, identity of a record in its left connector) → rows in which the record's fields
        are not equal (`overdetermined.Graph`)
    """
    across, through, good, equal = [], [], [], []
    signals: list[SignalEdge] = []
    for k, draft in enumerate(connects):
        try:
            inside = [_seen_from_inside(end, draft) for end in (draft.left, draft.right)]
            for end, seen in zip((draft.left, draft.right), inside, strict=True):
                if seen:
                    _make_node(end)
            pairs = list(_pairs(draft.left, draft.right, draft))
        except Wrong as wrong:
            wrong.put_into(report)
            continue
        for a, b in pairs:
            left = _variables(a, draft.left, draft.left_index)
            right = _variables(b, draft.right, draft.right_index)
            if a.known or b.known:
                equal += _same_value(a, b, left - a.offset, right - b.offset, draft)
            elif a.flow:
                through.append((left + count * inside[0], right + count * inside[1], len(good)))
            else:
                kept = _kept(a, draft, left_out, k)
                across.append((left[kept], right[kept], len(good)))
            if a.causality or b.causality:
                gives = [_gives_signal(v, seen) for v, seen in zip((a, b), inside)]
                signals.append(SignalEdge(draft, (a, b), (left, right), tuple(gives)))
        good.append(draft)
    check_sources(signals, report)
    return Connections(tuple(good), Edges.join(across), Edges.join(through), count, tuple(equal))


def _kept(a: Variable, draft: ConnectDraft, left_out: Mapping[tuple[int, int], set[int]], k: int) -> slice | np.ndarray:
    """Those elements of a potential that are equal: not the fields of a record whose connect is broken."""
    record: InstanceNode = a
    while record is not draft.left and record.parent is not None:
        rows = left_out.get((k, id(record)))
        if rows is not None:
            count = len(draft.left_index) * prod(record.total[len(draft.left.total) :])
            kept = np.ones(count, bool)
            kept[sorted(rows)] = False
            return np.repeat(kept, prod(a.total[len(record.total) :]))
        record = record.parent
    return slice(None)


def _same_value(
    a: Variable, b: Variable, left: np.ndarray, right: np.ndarray, draft: ConnectDraft
) -> Iterator[CheckDraft]:
    """The assertion that a parameter of two connected connectors is the same in both."""
    if not (a.known and b.known):
        raise _mismatch(draft, f"'{a.name}' is a parameter in one of them only")
    if a.type.name == "String":
        return  # texts have no place in the flat model
    same = dag.function("eq", dag.slot(0), dag.slot(1))
    message = f"'{a.label}' and '{b.label}' differ, though their connectors are connected"
    yield CheckDraft(same, message, True, ((a, left), (b, right)), len(left), draft.span)


def _make_node(end: InstanceNode) -> None:
    """A protected connector that is connected is a node: nothing outside is connected to it, its flows there are 0."""
    for variable in end.variables() if isinstance(end, Instance) else (end,):
        if isinstance(variable, Variable) and variable.hidden:
            variable.is_node = True


def _variables(leaf: Variable, end: InstanceNode, elements: np.ndarray) -> np.ndarray:
    """Indices of a connector's variable in the given elements of the connector."""
    inner = prod(leaf.total[len(end.total) :])
    if inner == 1:
        return leaf.offset + elements
    return (leaf.offset + elements[:, None] * inner + np.arange(inner)).reshape(-1)


def _seen_from_inside(end: InstanceNode, draft: ConnectDraft) -> bool:
    """Return whether it is a connector of the class that contains the connect (an "outside connector", 9.1.2)."""
    top = _top(end)
    if top.parent is draft.node:
        return True
    around: Instance | None = draft.node
    if top.parent is not None and top.parent.parent is draft.node:
        return False
    while around is not None:  # brought here by an outer declaration: a port of an inner part, or an inner connector
        if top.parent is around:
            return True
        if top.parent is not None and top.parent.parent is around:
            return False
        around = around.parent
    raise Wrong(
        "E0313", f"'{end.label}' is too deep inside: a connect reaches the ports of parts, no further", draft.span
    )


def _top(end: InstanceNode) -> InstanceNode:
    """The connector that is a port or stands alone, of which an end is an element or which it is."""
    while end.parent is not None and end.parent.kind in ("connector", "record"):
        end = end.parent
    return end


def owner_of(end: InstanceNode) -> Instance:
    """The instance in whose class the connector of an end is declared."""
    return _top(end).parent


def _gives_signal(variable: Variable, inside: bool) -> bool:
    """Return whether a signal comes from here: the output of a part, or an input of the class around (9.3)."""
    return variable.causality == ("input" if inside else "output") and not (inside and variable.hidden)


def _pairs(a: InstanceNode, b: InstanceNode, draft: ConnectDraft) -> Iterator[tuple[Variable, Variable]]:
    """Variables of two connectors that belong together; the connectors must be structurally equal."""
    if isinstance(a, Broken) or isinstance(b, Broken):
        raise Wrong()
    if isinstance(a, Variable) != isinstance(b, Variable):
        raise _mismatch(draft, "one is a signal, the other has variables of its own")
    if isinstance(a, Variable):
        yield from _pair(a, b, draft)
        return
    names_a, names_b = ([n for n, c in e.children.items() if not isinstance(c, Absent)] for e in (a, b))
    if set(names_a) != set(names_b):
        only = sorted(set(names_a) ^ set(names_b))
        raise _mismatch(draft, f"only one of them has {', '.join(repr(n) for n in only)}")
    for name in names_a:
        yield from _pairs(a.children[name], b.children[name], draft)


def _pair(a: Variable, b: Variable, draft: ConnectDraft) -> Iterator[tuple[Variable, Variable]]:
    if a.flow != b.flow:
        raise _mismatch(draft, f"'{a.name}' is a flow in one of them only")
    inner = [v.total[len(e.total) :] for v, e in ((a, draft.left), (b, draft.right))]
    if inner[0] != inner[1]:
        raise _mismatch(draft, f"'{a.name}' differs in size")
    types = a.type, b.type
    if types[0].name != types[1].name and (not types[0].literals or types[0].literals != types[1].literals):
        raise _mismatch(draft, f"'{a.name}' is {types[0].name} in one of them, {types[1].name} in the other")
    units = unit_of(a), unit_of(b)
    if None not in units and not units[0].same_as(units[1]):
        raise Wrong("E0303", f"'{a.label}' and '{b.label}' have different units", draft.span,
                    expected=a.unit, found=b.unit)  # fmt: skip
    yield a, b


def _mismatch(draft: ConnectDraft, why: str) -> Wrong:
    def kind(end: InstanceNode) -> str:
        return end.cls.name if isinstance(end, Instance) else end.type.name

    left, right = draft.left, draft.right
    labels = tuple(Label(_place(e, draft), f"'{e.label}' is a {kind(e)}") for e in (left, right))
    return Wrong(
        "E0306", f"'{left.label}' and '{right.label}' are different kinds of connectors", draft.span,
        expected=kind(left), found=kind(right), hint=why, labels=labels,
    )  # fmt: skip


def _place(end: InstanceNode, draft: ConnectDraft) -> Span:
    """The declaration, in the class with the connect, of the part or connector that an end belongs to."""
    node = end
    while node.parent is not None and node.parent is not draft.node and node.parent.component is not None:
        node = node.parent
    return node.name_span or draft.span


# ------------------------------------------------------------------------ the sets


def equalities(connections: Connections, kinds: np.ndarray) -> list[Group]:
    """Potentials and signals: all members of a set equal the first one, or the first that changes at events only."""
    edges = connections.across
    if not len(edges.left):
        return []
    nodes, label, a, b = components(edges.left, edges.right)
    _, first = first_of_each(label)  # nodes ascend: the variable declared first
    discrete = np.flatnonzero(kinds[nodes] == Kind.DISCRETE)[::-1]  # of several the first counts, assigned last
    first[label[discrete]] = discrete
    root = nodes[first[label]]
    # a row belongs to the first connect that mentions its variable
    connect = np.empty(len(nodes), int)
    by_place = _first_of_place(connections.connects)[edges.connect]
    for ends in (b, a):
        connect[ends[::-1]] = by_place[::-1]
    rows = np.flatnonzero(nodes != root)
    if not len(rows):
        return []  # connected to themselves
    key = (connect[rows] * 8 + kinds[nodes[rows]]) * 8 + kinds[root[rows]]
    order = np.argsort(key, kind="stable")
    rows, key = rows[order], key[order]
    bounds = [0, *(np.flatnonzero(np.diff(key)) + 1).tolist(), len(rows)]
    groups = []
    for low, high in zip(bounds[:-1], bounds[1:]):
        members = rows[low:high]
        draft = connections.connects[int(connect[members[0]])]
        slots = np.column_stack([nodes[members], root[members]])
        groups.append(Group(dag.slot(0), dag.slot(1), slots, draft.span, draft.node.part, "connection"))
    return groups


def _first_of_place(connects: Sequence[ConnectDraft]) -> np.ndarray:
    """For each connect, the first one that stands at the same place (in a loop that was unrolled, say)."""
    seen: dict[tuple, int] = {}
    return np.array(
        [seen.setdefault((id(c.span.source), c.span.start, c.node.part), k) for k, c in enumerate(connects)]
    )


def balances(connections: Connections) -> tuple[Sums, np.ndarray]:
    """Flows: those of a set add up to zero, counted into the parts around.

    Returns
    -------
    sums : one row a set
    connected : the variables that are connected as seen from outside their part
    """
    edges, count = connections.through, connections.count
    if not len(edges.left):
        empty = np.zeros(0, int)
        return Sums(np.zeros(1, int), empty, np.zeros(0)), empty
    nodes, label, a, _ = components(edges.left, edges.right)
    order = np.argsort(label, kind="stable")
    members = nodes[order]
    inside = members >= count
    starts = np.concatenate([[0], np.flatnonzero(np.diff(label[order])) + 1, [len(order)]])
    of_set = np.full(label.max() + 1, np.iinfo(int).max)
    np.minimum.at(of_set, label[a], edges.connect)
    span_of = of_set[label[order[starts[:-1]]]]
    used, span_of = numbered(span_of)
    spans = tuple(connections.connects[int(k)].span for k in used)
    sums = Sums(starts, members - count * inside, np.where(inside, -1.0, 1.0), spans, span_of)
    return sums, members[~inside]


def unconnected(flows: list[Variable], connected: np.ndarray, count: int) -> list[tuple[Variable, np.ndarray]]:
    """Flow variables that nothing is connected to, with their positions: they are zero (9.2)."""
    free = np.ones(count, bool)
    free[connected] = False
    found = []
    for variable in flows:
        own = np.flatnonzero(free[variable.offset : variable.offset + variable.size])
        if len(own):
            found.append((variable, own))
    return found
