"""What can stand at a place, and the parameters of the bracket around it."""

from __future__ import annotations

import re
from collections.abc import Iterator

from lmoc.editor import describe
from lmoc.editor.analysis import Analysis
from lmoc.editor.context import Context, context
from lmoc.editor.names import element, follow, look_up, type_of
from lmoc.semantics.classes.hints import visible
from lmoc.semantics.classes.place import Member
from lmoc.semantics.classes.predefined import Builtin
from lmoc.semantics.classes.scope import Scope
from lmoc.semantics.mistakes.wrong import Wrong
from lmoc.semantics.nodes.instance import ATTRIBUTES
from lmoc.support.records import dataclass
from lmoc.syntax import tree
from lmoc.syntax.node import walk

_WORDS = (
    "model block connector type record package function equation algorithm initial extends import parameter constant "
    "input output flow inner outer partial replaceable redeclare final each protected public discrete when then "
    "elsewhen if elseif else for in loop while end connect annotation and or not true false within"
).split()


@dataclass(frozen=True)
class Proposal:
    """A name that can stand at a place.

    Attributes
    ----------
    kind : "component", "parameter", "port", "class", "package", "function", "type", "attribute", "keyword", "literal"
    text : what is inserted; empty: the name
    """

    name: str
    kind: str
    detail: str = ""
    documentation: str = ""
    text: str = ""


@dataclass(frozen=True)
class Signature:
    """What the bracket around a place takes.

    Attributes
    ----------
    label : ``Spring(k, L, d0)``
    parameters : (name, documentation) of each
    active : which of them is typed
    """

    label: str
    documentation: str
    parameters: tuple[tuple[str, str], ...]
    active: int


def proposals(analysis: Analysis, offset: int) -> list[Proposal]:
    """Return what can stand at a character, best first."""
    here = context(analysis.source.text, offset)
    scope = _scope(analysis, here, offset)
    if here.hidden or scope is None:
        return []
    if here.path:
        found = follow(scope, list(here.path))
        return list(_inside(found[-1])) if len(found) == len(here.path) else []
    modified = _modified(scope, here)
    if modified is not None and not _behind_equals(analysis.source.text, offset, here):
        return list(_modifiable(modified))
    if here.inside and here.inside[-1][1] == "connect":
        return list(_connectors(scope))
    before = analysis.source.text[: offset - len(here.word)].rstrip()
    return [*_indices(scope, offset), *_visible(scope, _wanted(before))]


def signature(analysis: Analysis, offset: int) -> Signature | None:
    """Return what the innermost bracket around a character takes; None where it is none of a part or a function."""
    here = context(analysis.source.text, offset)
    scope = _scope(analysis, here, offset)
    if here.hidden or scope is None or not here.inside:
        return None
    modified = _modified(scope, here)
    if isinstance(modified, Scope):
        return _of_parameters(modified, list(describe.parameters(modified)), here, analysis.source.text[:offset])
    name = here.inside[-1][1]
    found = follow(scope, name.split(".")) if name else []
    if found and isinstance(found[-1], Scope) and found[-1].kind == "function":
        takes = [m for m in describe.elements(found[-1]) if isinstance(m, Member) and m.component.causality == "input"]
        return _of_parameters(found[-1], takes, here, "")
    if name in describe.FUNCTIONS:
        label, _, text = describe.FUNCTIONS[name].partition(": ")
        taken = [p.strip() for p in label.partition("(")[2].rstrip(")").split(",") if p.strip()]
        return Signature(label, text, tuple((p, "") for p in taken), here.argument)
    return None


def _of_parameters(scope: Scope, members: list[Member], here: Context, before: str) -> Signature:
    names = [m.component.name for m in members]
    typed = re.search(r"(\w+)(?:\s*\([^()]*\))?\s*=[^,()]*$", before)
    active = names.index(typed[1]) if typed and typed[1] in names else here.argument
    shown = tuple((m.component.name, f"{describe.one_line(m)} — {m.component.description}") for m in members)
    return Signature(f"{scope.name}({', '.join(names)})", describe.description(scope), shown, active)


def _scope(analysis: Analysis, here: Context, offset: int) -> Scope | None:
    """The class around a place; while it cannot be understood, the one that has its name."""
    found = analysis.class_at(offset)
    if found is not None or not here.class_name:
        return found or analysis.root
    named = look_up(analysis.root, here.class_name)
    return named if isinstance(named, Scope) else analysis.root


def _modified(scope: Scope, here: Context) -> Scope | Builtin | None:
    """The class of what the brackets around a place modify."""
    current: Scope | Builtin | None = None
    for k, (type_, name) in enumerate(here.inside):
        if not name:
            return None
        if k == 0 or current is None:
            word = type_ if type_ and type_ not in _WORDS else name
            found = follow(scope, word.split("."))
            known = len(found) == word.count(".") + 1
            current = _plain(found[-1]) if known and (type_ or isinstance(found[-1], Scope | Builtin)) else None
            if current is None or isinstance(current, Scope) and current.kind == "function":
                return None
        else:
            inner = element(current, name)
            current = type_of(inner) if isinstance(inner, Member) else inner
    return current


def _plain(found: Member | Scope | Builtin) -> Scope | Builtin | None:
    from lmoc.semantics.classes.resolve import resolve

    if isinstance(found, Member):
        return type_of(found)
    try:
        return resolve(found).base
    except Wrong:
        return None


def _behind_equals(text: str, offset: int, here: Context) -> bool:
    """Return whether a value is typed, not the name of what gets one."""
    before = text[: offset - len(here.word)].rstrip()
    return bool(before) and before[-1] not in "(,"


def _inside(meaning: Member | Scope | Builtin) -> Iterator[Proposal]:
    if isinstance(meaning, Builtin):
        yield from (Proposal(name, "literal") for name in meaning.literals)
        return
    scope = type_of(meaning) if isinstance(meaning, Member) else meaning
    if isinstance(scope, Builtin) or scope is None:
        return
    for found in describe.elements(scope):
        hidden = isinstance(found, Member) and (found.protected or not isinstance(meaning, Member))
        if not hidden and isinstance(found, Member) == isinstance(meaning, Member):
            yield _proposal(found)
    if not isinstance(meaning, Member):
        seen = {p.name for p in map(_proposal, (e for e in describe.elements(scope) if isinstance(e, Scope)))}
        yield from (Proposal(name, "class") for name in scope.names() if name not in seen)


def _modifiable(of: Scope | Builtin) -> Iterator[Proposal]:
    if isinstance(of, Builtin):
        yield from (Proposal(name, "attribute", text=f"{name} = ") for name in sorted(ATTRIBUTES))
        return
    own = list(describe.parameters(of))
    for member in own:
        value = f"{member.component.name} = "
        yield Proposal(
            member.component.name, "parameter", describe.one_line(member), member.component.description, value
        )
    for found in describe.elements(of):
        if isinstance(found, Member) and not found.protected and found not in own:
            yield _proposal(found)


def _connectors(scope: Scope) -> Iterator[Proposal]:
    for found in describe.elements(scope):
        cls = type_of(found) if isinstance(found, Member) else None
        if isinstance(cls, Scope) and cls.kind == "connector":
            yield _proposal(found)
        elif isinstance(cls, Scope):
            for port in describe.ports(cls):
                name = f"{found.component.name}.{port.component.name}"
                yield Proposal(name, "port", describe.one_line(port), port.component.description)


def _wanted(before: str) -> str:
    """What is typed behind a text: a "value", a "base" class, or anything else."""
    if before and before[-1] in "=+-*/^<>,([{:":
        return "value"
    word = re.search(r"\w*$", before)
    if word is None or word[0] in ("extends", "constrainedby"):
        return "base"
    return "value" if word[0] in ("then", "else", "if", "elseif", "and", "or", "not", "in", "when", "elsewhen") else ""


def _can_stand(found: object, wanted: str) -> bool:
    """Return whether a class can: models are no values, and partial ones are no types of parts."""
    if not isinstance(found, Scope) or found.definition is None:
        return True
    if wanted == "value":
        return found.kind in ("function", "package", "type", "record")
    return wanted == "base" or not found.definition.partial


def _indices(scope: Scope, offset: int) -> Iterator[Proposal]:
    """The indices of the loops around a place."""
    for node in walk(scope.definition) if scope.definition is not None else ():
        if isinstance(node, tree.For | tree.ForStatement | tree.Comprehension):
            around = node.span.start <= offset <= node.span.end
            yield from (Proposal(i.name, "component", "index") for i in node.indices if around)


def _visible(scope: Scope, wanted: str) -> Iterator[Proposal]:
    seen: set[str] = set()
    try:
        names = list(visible(scope))
    except Wrong:
        names = []
    for name in names:
        if name not in seen:
            seen.add(name)
            found = look_up(scope, name) if not _in_folder(scope, name) else None
            if isinstance(found, Member | Scope):
                yield from [_proposal(found)] * _can_stand(found, wanted)
            else:
                yield Proposal(name, "type" if found else "class")
    yield from (Proposal(name, "function", text, text=f"{name}(") for name, text in describe.FUNCTIONS.items())
    yield from (Proposal(word, "keyword") for word in _WORDS)


def _in_folder(scope: Scope, name: str) -> bool:
    """Return whether a class would have to be read from a file only to be named."""
    place: Scope | None = scope
    while place is not None:
        if name in place.local or place.complete and name in place.table:
            return False
        place = place.parent
    return True


def _proposal(found: Member | Scope) -> Proposal:
    if isinstance(found, Scope):
        kind = found.kind if found.kind in ("function", "package", "type") else "class"
        return Proposal(found.name, kind, describe.one_line(found), describe.description(found))
    cls = type_of(found)
    port = isinstance(cls, Scope) and cls.kind == "connector"
    kind = "port" if port else "parameter" if found.component.variability == "parameter" else "component"
    return Proposal(found.component.name, kind, describe.one_line(found), found.component.description)
