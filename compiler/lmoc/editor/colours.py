"""What each name of a text is, for editors that colour by meaning (LSP 3.17, "Semantic Tokens")."""

from __future__ import annotations

from lmoc.editor.names import Occurrence, type_of
from lmoc.messages.source import Source
from lmoc.semantics.classes.place import Member
from lmoc.semantics.classes.predefined import Builtin
from lmoc.semantics.classes.scope import Scope

TYPES = ("namespace", "type", "class", "interface", "struct", "parameter", "variable", "property", "function")
MODIFIERS = ("declaration", "readonly", "defaultLibrary")


def encoded(source: Source, names: list[Occurrence]) -> list[int]:
    """Return the names as the protocol packs them: line, character, length, type and modifiers, each from the last."""
    from lmoc.editor.positions import position

    data: list[int] = []
    line = character = 0
    for o in names:
        start, end = position(source, o.start), position(source, o.end)
        if start.line != end.line or o.start == o.end:
            continue
        ahead = start.character - (character if start.line == line else 0)
        data += [start.line - line, ahead, end.character - start.character, TYPES.index(_type(o)), _modifiers(o)]
        line, character = start.line, start.character
    return data


def edits(before: list[int], data: list[int]) -> list[tuple[int, int, list[int]]]:
    """Return what turns one answer into another: start, how many numbers go, and those that come instead."""
    if before == data:
        return []
    shorter = min(len(before), len(data))
    start = next((k for k in range(shorter) if before[k] != data[k]), shorter)
    behind = next((k for k in range(shorter - start) if before[-1 - k] != data[-1 - k]), shorter - start)
    return [(start, len(before) - behind - start, data[start : len(data) - behind])]


def _type(o: Occurrence) -> str:
    meaning = o.meaning
    if isinstance(meaning, Member):
        if o.role == "modifier":
            return "property"
        cls = type_of(meaning)
        if isinstance(cls, Scope) and cls.kind == "connector":
            return "property"
        return "parameter" if meaning.component.variability in ("parameter", "constant") else "variable"
    if isinstance(meaning, Scope):
        kinds = {"package": "namespace", "type": "type", "connector": "interface", "record": "struct"}
        return "function" if meaning.kind == "function" else kinds.get(meaning.kind, "class")
    return "type" if isinstance(meaning, Builtin) else "variable"


def _modifiers(o: Occurrence) -> int:
    found = 1 if o.role == "declaration" else 0
    if isinstance(o.meaning, Member) and o.meaning.component.variability in ("parameter", "constant"):
        found |= 2
    library = isinstance(o.meaning, Builtin) or isinstance(o.meaning, Scope) and o.meaning.library
    return found | (4 if library else 0)
