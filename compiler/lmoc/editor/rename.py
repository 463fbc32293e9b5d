"""Renaming: the places that change, if everything goes on to mean what it meant.

A name is not changed where something would mean something else, or nothing. Whether that is so is seen from the texts
as they would be: every name of them has to be declared where it was declared before.
"""

from __future__ import annotations

import os
import re
from bisect import bisect_left
from collections.abc import Iterable, Sequence
from pathlib import Path

from lmoc.editor.analysis import analyse, place_of
from lmoc.editor.names import Occurrence, at, element
from lmoc.editor.navigation import LIBRARY, Known, known, references
from lmoc.messages.source import Span
from lmoc.semantics.classes.elements import RESERVED
from lmoc.semantics.classes.place import Member
from lmoc.semantics.classes.scope import Scope
from lmoc.semantics.mistakes.wrong import Wrong
from lmoc.sources.files import PACKAGE, holding
from lmoc.syntax import tree
from lmoc.syntax.node import walk

_NAME = re.compile(r"[A-Za-z_]\w*|'(?:[^'\\\n]|\\.)+'", re.A)
Written = list[tuple[object, ...]]


class RenameRefused(Exception):
    """A name that cannot be changed, or not to this one; the message says why."""


def renamable(own: Known, offset: int) -> Occurrence:
    """Return the name at a character.

    Raises
    ------
    RenameRefused
        It cannot be changed, or not from here.
    """
    found = at(own.names, offset)
    if found is None or found.declared is None:
        raise RenameRefused("there is no name of this text here")
    if found.declared.source.name.startswith(LIBRARY):
        raise RenameRefused("this name belongs to the library")
    if own.analysis.source.text[found.start : found.end] != found.declared.text:
        raise RenameRefused(f"this is another name of '{found.declared.text}'")
    declared = _declared(found)
    if declared is not None and (declared.inner or declared.outer):
        raise RenameRefused(f"'{declared.name}' is inner or outer: also parts of the library find it by its name")
    return found


def rename(own: Known, offset: int, new: str, others: Iterable[Known], keywords: frozenset[str]) -> list[Span]:
    """Return the places that change their name.

    Parameters
    ----------
    others : the other texts in which the old or the new name occurs

    Raises
    ------
    RenameRefused
    """
    found = renamable(own, offset)
    if not _NAME.fullmatch(new) or new in keywords:
        raise RenameRefused(f"'{new}' is not a name: letters, digits and _, or anything in single quotes")
    if new in RESERVED:
        raise RenameRefused(f"'{new}' has a meaning everywhere")
    texts = [own, *others]
    old = found.declared.text if found.declared else ""
    if new == old:
        return []
    spans = [s for s in references(own, offset, texts[1:]) if s.text == old]
    _refuse_what_is_found_by_name(found, old, spans, texts)
    _refuse_clashes(found, new, texts)
    for text, changed in zip(texts, _with_name(texts, spans, new), strict=True):
        if _written(changed, {}, 0) != _written(text, _starts(spans), len(new) - len(old)):
            where = f" in {Path(text.analysis.source.name).name}" if text is not own else ""
            raise RenameRefused(f"with the name '{new}', something{where} would mean something else than before")
    return spans


def _declared(found: Occurrence) -> tree.Component | tree.Class | None:
    if isinstance(found.meaning, Member):
        return found.meaning.component
    return found.meaning.definition if isinstance(found.meaning, Scope) else None


def _refuse_what_is_found_by_name(found: Occurrence, old: str, spans: Sequence[Span], texts: Sequence[Known]) -> None:
    """Refuse where a file's name, or another declaration, has to be the same."""
    assert found.declared is not None
    place = place_of(found.declared)
    if place not in map(place_of, spans):
        raise RenameRefused(f"it is declared in '{found.declared.source.name}', which is in no folder of the workspace")
    for text in texts:
        for item in walk(text.analysis.file.classes):
            if isinstance(item, tree.Class | tree.Component) and item.redeclare and item.name == old:
                raise RenameRefused(f"'{old}' is redeclared: {item.name_span}")
        tops = {place_of(c.name_span) for c in text.analysis.file.classes}
        stem = Path(text.analysis.source.name).stem
        elsewhere = text.analysis.file.within or any(s.source.name != place[0] for s in spans)
        if place in tops and (stem == PACKAGE or stem == old and elsewhere):
            raise RenameRefused(f"the class is found by the name of its file or folder: '{text.analysis.source.name}'")


def _refuse_clashes(found: Occurrence, new: str, texts: Sequence[Known]) -> None:
    """Refuse where a class that has the element has another one of the new name."""
    owner = found.meaning.scope if isinstance(found.meaning, Member) else getattr(found.meaning, "parent", None)
    definition = getattr(owner, "definition", None)
    for scope in (s for text in texts for s in text.analysis.scopes.values()) if definition is not None else ():
        try:
            lineage = scope.lineage()
        except Wrong:
            continue
        if any(_same(s.definition, definition) for s in lineage) and element(scope, new) is not None:
            raise RenameRefused(f"there is a '{new}' in '{scope.full_name}'")


def _same(a: tree.Class | None, b: tree.Class) -> bool:
    return a is not None and place_of(a.name_span) == place_of(b.name_span)


def _with_name(texts: Sequence[Known], spans: Sequence[Span], new: str) -> list[Known]:
    """The texts as they would be."""
    after = {}
    for text in texts:
        source, pieces, done = text.analysis.source, [], 0
        for s in sorted((s for s in spans if s.source.name == source.name), key=lambda s: s.start):
            pieces += [source.text[done : s.start], new]
            done = s.end
        after[source.name] = "".join([*pieces, source.text[done:]])
    with holding({os.path.abspath(name): text for name, text in after.items()}):
        return [known(analyse(text, name)) for name, text in after.items()]


def _starts(spans: Sequence[Span]) -> dict[str, list[int]]:
    found: dict[str, list[int]] = {}
    for s in sorted(spans, key=lambda s: s.start):
        found.setdefault(s.source.name, []).append(s.start)
    return found


def _written(text: Known, starts: dict[str, list[int]], longer: int) -> Written:
    """Each name with where it is declared, at places after some names have become longer."""

    def moved(source: str, place: int) -> int:
        return place + longer * bisect_left(starts.get(source, []), place)

    own = text.analysis.source.name
    found: Written = []
    for o in text.names:
        declared = o.declared and (o.declared.source.name, moved(o.declared.source.name, o.declared.start))
        found.append((moved(own, o.start), moved(own, o.end), o.role, type(o.meaning), declared))
    return found
