"""What is connected to what, as far as expressions ask for it: cardinality, isRoot, rooted (3.7.4.3 and 9.4).

The answers decide which equations there are. So they come from a reading of all connects before the equations
are translated, which is made when something first asks.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from lmoc.semantics.connections.expandable import Expansion, Noted, buses
from lmoc.semantics.connections.overdetermined import Graph, graph, overdetermined_record
from lmoc.semantics.drafts.draft import ConnectDraft, Drafts, RootDraft
from lmoc.semantics.equations import EquationSection
from lmoc.semantics.mistakes.wrong import Wrong
from lmoc.semantics.nodes.instance import Instance, InstanceNode, Variable
from lmoc.semantics.values.builtins import builtin
from lmoc.semantics.values.context import Context, Model
from lmoc.semantics.values.reference import element_index, find_start, locate
from lmoc.semantics.values.rows import Index
from lmoc.semantics.values.value import Value
from lmoc.syntax import tree


class Topology:
    """The connects of a model whose parts are made."""

    def __init__(self, model: Model):
        self._model = model
        self._open = False
        self._drafts: Drafts | None = None
        self._graph: Graph | None = None
        self._counts: Counter[tuple[int, int]] | None = None

    def _read(self, call: tree.Call) -> Drafts:
        """All connects, roots and branches."""
        if self._open:
            raise Wrong("E0211", f"'{call.function}' cannot decide about connects: it depends on them", call.span)
        if self._drafts is None:
            self._open = True
            try:
                self._drafts = _connects(self._model)
            finally:
                self._open = False
        return self._drafts

    def check(self, drafts: Drafts) -> None:
        """Refuse connects that depend on what connects there are (9.4.1): the answers given would be wrong."""
        if self._drafts is None:
            return
        read = set(_places(self._drafts))
        for one, place in zip(_statements(drafts), _places(drafts), strict=True):
            if place not in read:
                raise Wrong("E0211", "this depends on what is connected, by cardinality, isRoot or rooted", one.span,
                            expected="a condition that parameters decide")  # fmt: skip

    def graph(self, call: tree.Call) -> Graph:
        """Return the trees of overdetermined connectors."""
        if self._graph is None:
            drafts = self._read(call)
            self._graph = graph(drafts.connects, drafts.roots)
        return self._graph

    def counts(self, call: tree.Call) -> Counter[tuple[int, int]]:
        """Return how many connects name each connector: an element of a node's array."""
        if self._counts is None:
            connects = self._read(call).connects
            self._counts = Counter()
            for draft in connects:
                for end, index in ((draft.left, draft.left_index), (draft.right, draft.right_index)):
                    self._counts.update((id(end), int(k)) for k in index)
        return self._counts


def expand(model: Model) -> None:
    """Give expandable connectors their elements."""
    if buses(model.root):
        noted: list[Noted] = []
        _connects(model, noted)
        Expansion(model, noted).run()


def _connects(model: Model, noted: list[Noted] | None = None) -> Drafts:
    """Read what says how parts are connected; `noted` takes the connects, which are not translated then."""
    sums, drafts = model.long_sums, Drafts()
    before = len(sums.sums), len(sums.variables)
    try:
        for instance in model.root.instances():
            for scope in instance.cls.lineage():
                section = EquationSection(drafts, instance)
                section.topology_only, section.noted = True, noted
                context = Context(model, instance, scope)
                for equation in scope.definition.equations:
                    section.add(context, equation)
    finally:
        del sums.sums[before[0] :], sums.variables[before[1] :]
    return drafts


def _topology(context: Context, call: tree.Call) -> Topology:
    if context.model.topology is None:
        raise Wrong("E0230", f"'{call.function}' is available in equations, not in declarations", call.span)
    return context.model.topology


def _of_elements(context: Context, index: Index, numbers: list[float], type_: str) -> Value:
    """A number for each of the elements that the rows mean."""
    array = np.array(numbers, float).reshape(np.shape(index))
    return Value(context.leaves.slot(None, array if array.ndim else float(array)), (), type_)


def _elements(index: Index) -> list[int]:
    return [int(k) for k in np.ravel(index)]


def _statements(drafts: Drafts) -> list[ConnectDraft | RootDraft]:
    return [*drafts.connects, *drafts.roots]


def _places(drafts: Drafts) -> list[tuple[int, int, int]]:
    """Return source, place and rows of each statement about what is connected."""
    return [(id(s.span.source), s.span.start, len(s.left_index)) for s in _statements(drafts)]


@builtin("cardinality")
def _cardinality(context: Context, call: tree.Call) -> Value:
    """The number of connects in which a connector stands (3.7.4.3)."""
    if len(call.arguments) != 1 or call.named or not isinstance(call.arguments[0], tree.Ref):
        raise Wrong("E0217", "'cardinality' takes a connector", call.span)
    ref = call.arguments[0]
    start = find_start(context, ref)
    located = locate(context, ref, start) if isinstance(start, InstanceNode) else None
    node = None if located is None else located.node
    if located is None or not isinstance(node, Instance | Variable) or not node.connector or located.dims:
        raise Wrong("E0301", "'cardinality' takes a connector", ref.span)
    counts, index = _topology(context, call).counts(call), element_index(context, located)
    return _of_elements(context, index, [counts[id(node), k] for k in _elements(index)], "Integer")


@builtin("Connections.isRoot")
def _is_root(context: Context, call: tree.Call) -> Value:
    node, index, found = _in_graph(context, call)
    chosen = [found.number.get((id(node), k)) in found.trees.roots for k in _elements(index)]
    return _of_elements(context, index, chosen, "Boolean")


@builtin("Connections.rooted", "rooted")
def _rooted(context: Context, call: tree.Call) -> Value:
    """Whether a record is nearer to the root than the one that a branch joins it to."""
    node, index, found = _in_graph(context, call)
    nearer = []
    for k in _elements(index):
        own = found.number.get((id(node), k), -1)
        others = found.partners.get(own, [])
        if len(others) != 1:
            raise Wrong("E0301", "'Connections.rooted' takes a record in one branch", call.span,
                        found=f"it is in {len(others)}")  # fmt: skip
        nearer.append(found.trees.depth[own] < found.trees.depth[others[0]])
    return _of_elements(context, index, nearer, "Boolean")


def _in_graph(context: Context, call: tree.Call) -> tuple[Instance, Index, Graph]:
    if len(call.arguments) != 1 or call.named:
        raise Wrong("E0217", f"'{call.function}' takes a record", call.span)
    node, index = overdetermined_record(context, call.arguments[0], call)
    return node, index, _topology(context, call).graph(call)
