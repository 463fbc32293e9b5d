"""Expandable connectors: they have what is connected to them (Modelica specification, 9.1.3).

Before the equations are translated, all connects are read: an element that a connect names and that a bus does not
have yet becomes one like the other end of the connect; connected buses have the same elements; what a bus declares
and nothing names is absent. A signal of a bus comes from inside of its part where something there gives it, else from
outside.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import field, replace

from lmoc.ir.flat import Kind
from lmoc.semantics.mistakes.wrong import Wrong
from lmoc.semantics.nodes.instance import NOTHING, Absent, Instance, InstanceNode, Variable
from lmoc.semantics.values.context import Context, Model
from lmoc.semantics.values.reference import Slice, find_start, locate, step
from lmoc.support.records import dataclass
from lmoc.syntax import tree
from lmoc.syntax.node import walk

Noted = tuple[Context, tree.Connect]


@dataclass(frozen=True, eq=False)
class _Missing:
    """An element that a bus does not have yet, and the subscripts with which it is named."""

    bus: Instance
    part: tree.RefPart


@dataclass(frozen=True, eq=False)
class _Like:
    """What a new element is like: a connector, its dimensions."""

    node: Instance | Variable
    dims: tuple[int, ...]


@dataclass
class _Wanted:
    """A new element: where, like what, and how long along each subscript."""

    bus: Instance
    part: tree.RefPart
    like: _Like
    lengths: tuple[int, ...] = field(default=())


def buses(root: Instance) -> list[Instance]:
    """Return the expandable connectors of a model."""
    return [i for i in root.instances() if i.expandable]


class Expansion:
    """Gives the expandable connectors of a model their elements."""

    def __init__(self, model: Model, connects: Sequence[Noted]):
        self._model = model
        self._connects = connects
        self._present: dict[int, dict[str, None]] = {}  # of each bus: the elements that something names

    def run(self) -> None:
        """Add elements until all connects and all connected buses have theirs, and take away what nothing names."""
        for bus in buses(self._model.root):
            self._named_in_its_class(bus)
        while self._add_missing() or self._equalize():
            pass
        for bus in buses(self._model.root):
            self._take_away(bus)
        self._direct()

    # ------------------------------------------------------------------------ elements

    def _names(self, bus: Instance) -> dict[str, None]:
        return self._present.setdefault(id(bus), {})

    def _named_in_its_class(self, bus: Instance) -> None:
        """Elements that equations and values of the class around a bus speak of are present."""
        for scope in bus.parent.cls.lineage() if bus.parent is not None else ():
            for ref in walk((scope.definition,)):
                if not isinstance(ref, tree.Ref) or ref.parts[0].name != bus.name:
                    continue
                node: InstanceNode = bus
                for part in ref.parts[1:]:
                    if not isinstance(node, Instance) or not node.expandable or part.name not in node.children:
                        break
                    self._names(node)[part.name] = None
                    node = node.children[part.name]

    def _ends(self, noted: Noted) -> list[InstanceNode | _Missing | _Like | None]:
        context, connect = noted
        return [self._end(context, ref) for ref in (connect.left, connect.right)]

    def _end(self, context: Context, ref: tree.Ref) -> _Missing | _Like | None:
        """What a connect names; None where it is wrong, or absent: that is said where the connect is translated."""
        try:
            node = find_start(context, ref)
            for part in ref.parts[1:]:
                if isinstance(node, Instance) and node.expandable:
                    if part.name not in node.children:
                        return _Missing(node, part) if part is ref.parts[-1] else None
                    self._names(node)[part.name] = None
                node = step(context, node, part) if isinstance(node, InstanceNode) else None
            if not isinstance(node, Instance | Variable):
                return None
            located = locate(context, ref, find_start(context, ref))
        except Wrong:
            return None
        return _Like(node, tuple(a.length for a in located.axes if isinstance(a, Slice)))

    def _add_missing(self) -> bool:
        """Add what one end of a connect names and the other end is; return whether there was something."""
        wanted: dict[tuple[int, str], _Wanted] = {}
        for noted in self._connects:
            ends = self._ends(noted)
            for one, other in (ends, ends[::-1]):
                if isinstance(one, _Missing) and isinstance(other, _Like):
                    key = id(one.bus), one.part.name
                    new = wanted.setdefault(key, _Wanted(one.bus, one.part, other))
                    new.lengths = _longer(new.lengths, self._subscripts(noted[0], one.part))
        for new in wanted.values():
            self._add(new.bus, new.part.name, new.like, new.lengths)
        return bool(wanted)

    def _subscripts(self, context: Context, part: tree.RefPart) -> tuple[int, ...]:
        found = []
        for one in part.subscripts:
            if isinstance(one, tree.Colon):
                raise Wrong("E0216", f"the size of '{part.name}' is open: nothing else says how long it is", part.span)
            numbers = context.known(context.value(one), one.span, "a subscript")
            found.append(int(max(numbers.reshape(-1)) if hasattr(numbers, "reshape") else numbers))
        return tuple(found)

    def _add(self, bus: Instance, name: str, like: _Like, lengths: tuple[int, ...] = ()) -> None:
        source = like.node
        component = replace(
            source.component, name=name, dimensions=(), modification=None, condition=None, causality="", inner=False,
            outer=False,
        )  # fmt: skip
        dims = *lengths, *like.dims
        made: Instance | Variable
        self._model.parts.spend(1, component.span)
        if isinstance(source, Variable):
            made = Variable(name, bus, dims, component, source.scope, False, source.type, NOTHING)
            made.kind = source.kind if source.kind in (Kind.UNKNOWN, Kind.DISCRETE) else _kind(source)
            made.connector = True
        else:
            same = source.modifier if not (source.total or bus.total) else NOTHING
            made = Instance(name, bus, dims, component, source.scope, False, source.cls, source.kind, same)
        bus.children[name] = made
        self._names(bus)[name] = None
        if isinstance(made, Instance):
            self._model.populate(made)

    def _equalize(self) -> bool:
        """Give connected buses the same elements; return whether one was missing."""
        changed = False
        for noted in self._connects:
            one, other = self._ends(noted)
            if isinstance(one, _Like) and isinstance(other, _Like):
                changed |= self._alike(one.node, other.node)
        return changed

    def _alike(self, one: InstanceNode, other: InstanceNode) -> bool:
        if not (isinstance(one, Instance) and isinstance(other, Instance) and one.expandable and other.expandable):
            return False
        changed = False
        for a, b in ((one, other), (other, one)):
            for name in [n for n in self._names(a) if n not in self._names(b)]:
                changed = True
                if name in b.children:
                    self._names(b)[name] = None
                elif isinstance(child := a.children[name], Instance | Variable):
                    self._add(b, name, _Like(child, child.dims))
        for name in self._names(one):
            changed |= self._alike(one.children[name], other.children[name])
        return changed

    def _take_away(self, bus: Instance) -> None:
        """What nothing names is absent."""
        named = self._names(bus)
        for name, child in bus.children.items():
            known = isinstance(child, Variable) and child.known
            if name not in named and not known and isinstance(child, Instance | Variable):
                bus.children[name] = Absent(name, bus, (), child.component, child.scope)

    # ------------------------------------------------------------------------ directions

    def _direct(self) -> None:
        """Signals of a bus are inputs of its part, unless something inside gives them, or there is no outside."""
        pairs = [pair for noted in self._connects for pair in self._signal_pairs(noted)]
        for bus in buses(self._model.root):
            part = bus.owner
            for child in bus.children.values():
                if isinstance(child, Variable) and not child.known:
                    inside = part.parent is None or child.hidden
                    child.causality = "output" if inside else "input"
        fed: set[int] = set()  # identities of the signals of nodes that something inside gives
        changed = True
        while changed:
            changed = False
            for around, one, other in pairs:
                for a, b in ((one, other), (other, one)):
                    if not _of_bus(a, around) or id(a) in fed:
                        continue
                    if a.hidden and (id(b) in fed or _gives(b, around) and not _of_bus(b, around)):
                        fed.add(id(a))
                        changed = True
                    elif a.causality == "input" and (id(b) in fed or _gives(b, around)):
                        a.causality, changed = "output", True

    def _signal_pairs(self, noted: Noted) -> Iterator[tuple[Instance, Variable, Variable]]:
        one, other = self._ends(noted)
        if isinstance(one, _Like) and isinstance(other, _Like):
            yield from _pairs(noted[0].node, one.node, other.node)


def _pairs(around: Instance, one: InstanceNode, other: InstanceNode) -> Iterator[tuple[Instance, Variable, Variable]]:
    """The signals of two connected ends, of which one is a bus or in one."""
    if isinstance(one, Variable) and isinstance(other, Variable):
        yield around, one, other
    elif isinstance(one, Instance) and isinstance(other, Instance) and one.expandable and other.expandable:
        for name, child in one.children.items():
            if name in other.children:
                yield from _pairs(around, child, other.children[name])


def _of_bus(signal: Variable, around: Instance) -> bool:
    """Return whether a signal is an element of a bus of the part itself."""
    return signal.parent.owner is around and signal.parent.expandable


def _gives(signal: Variable, around: Instance) -> bool:
    """Return whether a signal comes from here: an output of a part inside, or an input of the part itself."""
    return signal.causality == ("input" if signal.parent.owner is around else "output")


def _longer(one: tuple[int, ...], other: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(map(max, one, other)) if one else other


def _kind(source: Variable) -> Kind:
    return Kind.UNKNOWN if source.type.name == "Real" else Kind.DISCRETE
