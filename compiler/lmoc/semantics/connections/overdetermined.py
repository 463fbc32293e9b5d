"""Overdetermined connectors: records whose fields depend on each other, such as orientations (9.4).

Such a record has a function `equalityConstraint`. Where connects form a loop, equating all of its fields would be more
equations than unknowns; one connect of the loop gives the residues of that function instead.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import prod

import numpy as np

from lmoc.messages.source import Span
from lmoc.semantics.classes.scope import Scope
from lmoc.semantics.connections.spanning import Forest, Impossible, forest
from lmoc.semantics.drafts.draft import ConnectDraft, GroupDraft, RootDraft, equality
from lmoc.semantics.mistakes.wrong import Wrong
from lmoc.semantics.nodes.instance import Instance, InstanceNode
from lmoc.semantics.values.context import Context, Model
from lmoc.semantics.values.formals import declared_in, sizes
from lmoc.semantics.values.functions import apply
from lmoc.semantics.values.reference import Located, element_index, find_start, locate, located_value
from lmoc.semantics.values.rows import Index
from lmoc.semantics.values.value import number, stack
from lmoc.support.records import dataclass
from lmoc.syntax import tree

GRAPH_STATEMENTS = ("Connections.root", "Connections.potentialRoot", "Connections.branch")
Element = tuple[Instance, int]  # a record, and which element of its array


def constraint_of(node: InstanceNode) -> Scope | None:
    """Return the function `equalityConstraint` of a record; None where it has none."""
    if not isinstance(node, Instance) or node.kind != "record":
        return None
    found = node.cls.table.get("equalityConstraint")
    return found if isinstance(found, Scope) and found.kind == "function" else None


def overdetermined_record(context: Context, e: tree.Expression, call: tree.Call) -> tuple[Instance, Index]:
    """Return the record of a connector that an argument of ``Connections.…`` names, and which elements of its array."""
    start = find_start(context, e) if isinstance(e, tree.Ref) else None
    located = locate(context, e, start) if isinstance(start, InstanceNode) else None
    node = None if located is None else located.node
    known = isinstance(node, Instance) and constraint_of(node) is not None and node.inside_connector
    if located is None or not isinstance(node, Instance) or not known:
        raise Wrong("E0301", f"'{call.function}' takes a record of a connector that has an equalityConstraint", e.span)
    if located.dims:
        raise Wrong("E0301", f"'{call.function}' takes one record, not an array of them", e.span)
    return node, element_index(context, located)


def residues(model: Model, node: Instance) -> int:
    """Return how many equations it takes to say that two overdetermined records are equal."""
    function = constraint_of(node)
    outputs = [v for v in declared_in(function).values() if v.role == "output"]
    place = Context(model, None, function)
    return sum(prod(n or 0 for n in sizes(place, variable, function)) for variable in outputs)


@dataclass(frozen=True, eq=False)
class Graph:
    """The records that are connected, their trees, and the connects that belong to none.

    Attributes
    ----------
    number : of each record, by its identity and element
    partners : for each record those that a branch joins it to
    broken : (number of the draft, left, right) of connects that give residues
    left_out : (number of the draft, left record) of connects that say nothing further, or give residues: the elements
    """

    number: dict[tuple[int, int], int]
    trees: Forest
    partners: dict[int, list[int]]
    broken: tuple[tuple[int, Element, Element], ...]
    left_out: dict[tuple[int, int], set[int]]


def graph(connects: Sequence[ConnectDraft], statements: Sequence[RootDraft]) -> Graph:
    """Return the graph of a model and its trees.

    Raises
    ------
    Wrong
        E0316, E0317
    """
    number: dict[tuple[int, int], int] = {}
    elements: list[Element] = []

    def node(element: Element) -> int:
        key = (id(element[0]), element[1])
        if key not in number:
            number[key] = len(elements)
            elements.append(element)
        return number[key]

    pairs = [(k, at, left, right) for k, draft in enumerate(connects) for at, left, right in _joined(draft)]
    edges = [(node(left), node(right)) for _, _, left, right in pairs]
    branches, roots, potential, spans = [], [], [], {}
    for one in statements:
        for row in range(len(one.left_index)):
            a = node((one.left, int(one.left_index[row])))
            if one.kind == "branch":
                spans["circle", len(branches)] = one.span
                branches.append((a, node((one.right, int(one.right_index[row])))))
            elif one.kind == "root":
                spans["roots", len(roots)] = one.span
                roots.append(a)
            else:
                potential.append((one.priority, a))
    try:
        trees = forest(len(elements), branches, edges, roots, potential)
    except Impossible as found:
        place = spans.get((found.why, found.number))
        raise _impossible(found, elements, place or _first_connect(connects, pairs, edges, found.number)) from None
    partners: dict[int, list[int]] = {}
    for a, b in branches:
        partners.setdefault(a, []).append(b)
        partners.setdefault(b, []).append(a)
    left_out: dict[tuple[int, int], set[int]] = {}
    for k in trees.broken:
        left_out.setdefault((pairs[k][0], id(pairs[k][2][0])), set()).add(pairs[k][1])
    broken = tuple((pairs[k][0], *pairs[k][2:]) for k in trees.broken if k not in trees.redundant)
    return Graph(number, trees, partners, broken, left_out)


def _first_connect(connects: Sequence[ConnectDraft], pairs, edges, node: int) -> Span | None:
    return next((connects[pair[0]].span for pair, edge in zip(pairs, edges) if node in edge), None)


def _impossible(found: Impossible, elements: list[Element], span: Span | None) -> Wrong:
    if found.why == "circle":
        return Wrong("E0317", "the branches between these records form a circle", span,
                     hint="one of them has to be left out: a circle of parts is closed by a connect")  # fmt: skip
    if found.why == "roots":
        return Wrong("E0317", "branches join this root and another one", span,
                     hint="Connections.potentialRoot(…) is one that need not be")  # fmt: skip
    record = elements[found.number][0]
    return Wrong("E0316", f"nothing that '{record.label}' is connected to can be a root", span or record.span,
                 expected="Connections.root(…) or Connections.potentialRoot(…) in one of the parts",
                 hint="connect one of them to the world")  # fmt: skip


def _joined(draft: ConnectDraft) -> Iterator[tuple[int, Element, Element]]:
    """The overdetermined records that a connect joins, each pair with its position in the rows of the draft."""
    if not isinstance(draft.left, Instance) or not isinstance(draft.right, Instance):
        return
    others = dict(_records(draft.right))
    for path, record in _records(draft.left):
        other = others.get(path)
        if other is None:
            continue  # they are different connectors, which is said with the connect
        inner = prod(record.total[len(draft.left.total) :])
        ends = zip(draft.left_index.tolist(), draft.right_index.tolist())
        for row, (a, b) in enumerate(ends):
            for j in range(inner):
                yield row * inner + j, (record, a * inner + j), (other, b * inner + j)


def _records(end: Instance, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Instance]]:
    for name, child in end.children.items():
        if isinstance(child, Instance):
            if constraint_of(child) is not None:
                yield (*path, name), child
            else:
                yield from _records(child, (*path, name))


def residue_groups(model: Model, found: Graph, connects: Sequence[ConnectDraft]) -> Iterator[GroupDraft]:
    """The equations ``equalityConstraint(a, b) = 0`` of the broken connects."""
    for k, left, right in found.broken:
        draft = connects[k]
        context = Context(model, model.root, draft.node.cls, quiet=1)
        function = constraint_of(left[0])
        sides = [located_value(context, _located(*one), draft.span) for one in (left, right)]
        name = tree.Ref((tree.RefPart(function.name, (), draft.span),), False, draft.span)
        (residue,) = apply(context, function, sides, tree.Call(name, (), (), draft.span))
        zero = number(0.0)
        for size in reversed(residue.dims):
            zero = stack([zero] * size, zero.dims)
        yield from equality(context, residue, zero, draft.span, draft.node, "connection")


def _located(record: Instance, element: int) -> Located:
    """One element of an array of records."""
    axes = tuple(int(k) for k in np.unravel_index(element, record.total)) if record.total else ()
    return Located(record, axes, 0, False)
