"""The meaning of every name in a text: declaration, type, function, part, property of a modification.

Names are looked up as the compiler does (`semantics.classes.scope`), without making instances. What has no meaning,
since it is wrong or not there yet, is left out.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from lmoc.editor.analysis import Analysis
from lmoc.messages.source import Span
from lmoc.semantics.classes.place import Member
from lmoc.semantics.classes.predefined import Builtin
from lmoc.semantics.classes.scope import Scope
from lmoc.semantics.mistakes.wrong import Wrong
from lmoc.support.records import dataclass
from lmoc.syntax import tree
from lmoc.syntax.node import Node, walk

_IDENT = re.compile(r"[^\W\d]\w*|'(?:[^'\\\n]|\\.)+'")
_BEFORE_VALUE = re.compile(rf"({_IDENT.pattern})\s*=\s*\(*\s*\Z")
_CONDITIONS = ("visible", "enable")
Meaning = Member | Scope | Builtin | tree.ForIndex
Local = dict[str, tuple[tree.ForIndex, Span]]


@dataclass(frozen=True, eq=False)
class Occurrence:
    """A name in the text.

    Attributes
    ----------
    start, end : its characters
    meaning : the component, the class, the predefined type or the index of a loop
    declared : where its declaration stands; None for what is predefined
    role : "declaration", "type", "value", "function", "modifier", "import" or "end"
    """

    start: int
    end: int
    meaning: Meaning
    declared: Span | None
    role: str


def occurrences(analysis: Analysis, around: int | None = None) -> list[Occurrence]:
    """Return all names of a text that mean something, or of its class around a character, in their order."""
    found: list[Occurrence] = []
    for definition in analysis.classes(around):
        scope = analysis.scopes.get(definition.name_span.start)
        if scope is not None:
            found += _Names(scope, []).of_class()
    return sorted({(o.start, o.end): o for o in found}.values(), key=lambda o: o.start)


def at(found: list[Occurrence], offset: int) -> Occurrence | None:
    """Return the name at a character, or just before it."""
    inside = [o for o in found if o.start <= offset <= o.end]
    return max(inside, key=lambda o: o.start) if inside else None


def declaration(meaning: Meaning) -> Span | None:
    """Return where a name is declared."""
    if isinstance(meaning, Member):
        return meaning.component.name_span
    if isinstance(meaning, Scope):
        return meaning.definition.name_span if meaning.definition else None
    return None


def type_of(member: Member) -> Scope | Builtin | None:
    """Return the class of a component; None where it has no meaning."""
    try:
        return member.scope.type_of(member.component).base
    except Wrong:
        return None


def element(scope: Scope | Builtin | None, name: str) -> Member | Scope | None:
    """Return an element of a class; None where there is none."""
    if not isinstance(scope, Scope):
        return None
    try:
        return scope.element(name)
    except Wrong:
        return None


def look_up(scope: Scope, name: str) -> Member | Scope | Builtin | None:
    """Return what a name means inside of a class; None where it means nothing."""
    try:
        return scope.find(name)
    except Wrong:
        return None


def follow(scope: Scope, names: list[str], absolute: bool = False) -> list[Member | Scope | Builtin]:
    """Return what each part of a dotted name means, as far as it means something."""
    first = look_up(scope.root if absolute else scope, names[0]) if names else None
    found: list[Member | Scope | Builtin] = [] if first is None else [first]
    for name in names[1:] if found else ():
        last = found[-1]
        inner = element(type_of(last) if isinstance(last, Member) else last, name)
        if inner is None:
            break
        found.append(inner)
    return found


class _Names:
    """Collects names that are looked up in one class."""

    def __init__(self, scope: Scope, found: list[Occurrence]) -> None:
        self.scope, self.found = scope, found

    def of_class(self) -> list[Occurrence]:
        """Those in the text of the class, without those of the classes inside of it."""
        d: tree.Class = self.scope.definition
        self._add(d.name_span, self.scope, "declaration")
        self._end()
        for item in d.elements:
            if isinstance(item, tree.Component):
                self._component(item)
            elif isinstance(item, tree.Extends):
                self._reference(item.base, {}, "type")
                self._modification(item.modification, self._class(item.base))
            elif isinstance(item, tree.Import):
                self._import(item)
        if d.short is not None:
            self._short(d.short)
        if d.constrained_by is not None:
            self._reference(d.constrained_by, {}, "type")
        body = (d.equations, d.initial_equations, d.statements, d.initial_statements)
        self._walk(body, {})
        self._annotation(d.annotation)
        return self.found

    def _add(self, span: Span, meaning: Meaning, role: str) -> None:
        declared = span if isinstance(meaning, tree.ForIndex) else declaration(meaning)
        self.found.append(Occurrence(span.start, span.end, meaning, declared, role))

    def _end(self) -> None:
        """The name behind ``end``, which is that of the class."""
        d: tree.Class = self.scope.definition
        last = re.search(rf"\bend\s+({_IDENT.pattern})\s*;?\s*$", d.span.text)
        if last is not None and last[1] == d.name_span.text:
            start = d.span.start + last.start(1)
            self._add(Span(d.span.source, start, start + len(last[1])), self.scope, "end")

    def _class(self, ref: tree.Ref) -> Scope | Builtin | None:
        found = follow(self.scope, [p.name for p in ref.parts], ref.absolute)
        if len(found) < len(ref.parts) or isinstance(found[-1], Member):
            return None
        return _followed(found[-1])

    def _component(self, c: tree.Component) -> None:
        own = self.scope.local.get(c.name)
        meaning = element(self.scope, c.name)
        if isinstance(meaning, Member) and meaning.component is c and own is None:
            self._add(c.name_span, meaning, "declaration")
        self._reference(c.type, {}, "type")
        self._walk((c.dimensions, c.condition), {})
        self._modification(c.modification, self._class(c.type))
        if c.constrained_by is not None:
            self._reference(c.constrained_by, {}, "type")
            self._modification(c.constraint, self._class(c.constrained_by))
        self._annotation(c.annotation)

    def _annotation(self, annotation: tree.Modification | None) -> None:
        """The names in conditions of pictures and dialogs; other words of annotations are nobody's names."""
        for node in walk((annotation,)):
            if isinstance(node, tree.Call):
                self._walk([value for name, value in node.named if name in _CONDITIONS], {})
            elif isinstance(node, tree.ElementModification) and node.name[-1] in _CONDITIONS and node.modification:
                self._walk(node.modification.value, {})

    def _short(self, short: tree.ShortClass) -> None:
        around = _Names(self.scope.parent, self.found)
        around._reference(short.base, {}, "type")
        around._modification(short.modification, around._class(short.base))

    def _import(self, item: tree.Import) -> None:
        places = [m for m in _IDENT.finditer(item.span.text) if m[0] != "import"]
        names = [*item.path, *item.names]
        given = places[1:] if item.alias else places
        for k, place in enumerate(given[: len(names)]):
            path = [*item.path[: k + 1]] if k < len(item.path) else [*item.path, names[k]]
            found = follow(self.scope.root, path)
            if len(found) == len(path) and place[0] == names[k]:
                start = item.span.start + place.start()
                span = Span(item.span.source, start, start + len(place[0]))
                self._add(span, found[-1], "import")

    def _modification(self, modification: tree.Modification | None, of: Scope | Builtin | None) -> None:
        """Names of what is modified belong to the class of the part, values to the class around."""
        if modification is None:
            return
        self._walk(modification.value, {})
        for argument in modification.arguments:
            if isinstance(argument, tree.Redeclaration):
                self._redeclaration(argument, of)
                continue
            inside = of
            for name, span in zip(argument.name, _name_spans(argument), strict=False):
                found = element(inside, name)
                if found is None:
                    inside = None
                    break
                self._add(span, found, "modifier")
                inside = type_of(found) if isinstance(found, Member) else found
            self._modification(argument.modification, inside)

    def _redeclaration(self, argument: tree.Redeclaration, of: Scope | Builtin | None) -> None:
        item = argument.element
        old = element(of, item.name)
        if old is not None:
            self._add(item.name_span, old, "modifier")
        if isinstance(item, tree.Component):
            self._reference(item.type, {}, "type")
            self._modification(item.modification, self._class(item.type))
        elif item.short is not None:
            self._reference(item.short.base, {}, "type")
            self._modification(item.short.modification, self._class(item.short.base))

    def _reference(self, ref: tree.Ref, local: Local, role: str) -> None:
        names = [p.name for p in ref.parts]
        if names and names[0] in local and not ref.absolute:
            index, declared = local[names[0]]
            first = ref.parts[0].span
            self.found.append(Occurrence(first.start, first.start + len(names[0]), index, declared, role))
            return
        for part, meaning in zip(ref.parts, follow(self.scope, names, ref.absolute)):
            span = Span(part.span.source, part.span.start, part.span.start + _written(part))
            self._add(span, meaning, role if isinstance(meaning, Member) or role != "value" else "type")

    def _named(self, call: tree.Call, local: Local) -> None:
        """The names of the arguments of a call, which are inputs of the function or elements of the record."""
        names = [p.name for p in call.function.parts]
        found = [] if not call.named or names[0] in local else follow(self.scope, names, call.function.absolute)
        of = found[-1] if len(found) == len(names) else None
        for name, value in call.named:
            own = _BEFORE_VALUE.search(call.span.source.text, call.span.start, value.span.start)
            meant = element(_followed(of), name) if isinstance(of, Scope) else None
            if own is not None and meant is not None:
                self._add(Span(call.span.source, *own.span(1)), meant, "modifier")

    def _walk(self, item: object, local: Local) -> None:
        """Names in expressions, equations and statements; no recursion, since sums can be long."""
        pending: list[tuple[object, Local]] = [(item, local)]
        while pending:
            item, local = pending.pop()
            if isinstance(item, tuple | list):
                pending += [(i, local) for i in item]
            elif isinstance(item, tree.Ref):
                self._reference(item, local, "value")
                pending += [(p.subscripts, local) for p in item.parts]
            elif isinstance(item, tree.Call):
                self._reference(item.function, local, "function")
                self._named(item, local)
                pending += [(item.arguments, local), ([e for _, e in item.named], local)]
            elif isinstance(item, tree.For | tree.ForStatement | tree.Comprehension):
                pending += [(i.range, local) for i in item.indices]
                inner = {**local, **{i.name: (i, _index_span(i)) for i in item.indices}}
                for i in item.indices:
                    self._add(_index_span(i), i, "declaration")
                pending.append((item.element if isinstance(item, tree.Comprehension) else item.body, inner))
            elif isinstance(item, Node):
                pending += [(getattr(item, name), local) for name in item.__slots__ if name != "annotation"]


def _followed(found: Scope | Builtin) -> Scope | Builtin | None:
    """The class that a short definition stands for."""
    from lmoc.semantics.classes.resolve import resolve

    try:
        return resolve(found).base
    except Wrong:
        return None


def _written(part: tree.RefPart) -> int:
    """The characters of a name without its subscripts."""
    match = _IDENT.match(part.span.text)
    return match.end() if match else len(part.name)


def _index_span(index: tree.ForIndex) -> Span:
    return Span(index.span.source, index.span.start, index.span.start + len(index.name))


def _name_spans(argument: tree.ElementModification) -> Iterator[Span]:
    """The places of the names of what an argument modifies."""
    base = argument.span.start
    for match in _IDENT.finditer(argument.span.text):
        if match[0] not in ("each", "final"):
            yield Span(argument.span.source, base + match.start(), base + match.end())
