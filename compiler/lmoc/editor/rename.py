"""Renaming: the places that change, if everything goes on to mean what it meant.

A name is not changed where something would mean something else, or nothing. Whether that is so is seen from the texts
as they would be: every name of them has to be declared where it was declared before. A piece of a text that has neither
the old name nor the new one goes on to mean what it meant if those that have one do, since its names are looked up by
way of what these mean.
"""

from __future__ import annotations

import os
import re
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

from lmoc.editor.analysis import scopes_in
from lmoc.editor.answers import Answers
from lmoc.editor.names import Occurrence, element
from lmoc.editor.navigation import LIBRARY
from lmoc.editor.pieces import Piece, read
from lmoc.messages.source import Source, Span
from lmoc.semantics.classes.elements import RESERVED
from lmoc.semantics.classes.place import Member
from lmoc.semantics.classes.scope import Scope
from lmoc.semantics.mistakes.wrong import Wrong
from lmoc.sources.files import PACKAGE, holding
from lmoc.syntax import tree
from lmoc.syntax.node import walk

_NAME = re.compile(r"[A-Za-z_]\w*|'(?:[^'\\\n]|\\.)+'", re.A)
Place = tuple[str, int]
Written = list[tuple[object, ...]]


class RenameRefused(Exception):
    """A name that cannot be changed, or not to this one; the message says why."""


def renamable(found: Occurrence | None, source: Source) -> tuple[Occurrence, Span]:
    """Return a name in a text, and its declaration.

    Raises
    ------
    RenameRefused
        It cannot be changed, or not from here.
    """
    if found is None or found.declared is None:
        raise RenameRefused("there is no name of this text here")
    if found.declared.source.name.startswith(LIBRARY):
        raise RenameRefused("this name belongs to the library")
    if source.text[found.start : found.end] != found.declared.text:
        raise RenameRefused(f"this is another name of '{found.declared.text}'")
    declared = found.meaning.component if isinstance(found.meaning, Member) else None
    declared = found.meaning.definition if isinstance(found.meaning, Scope) else declared
    if declared is not None and (declared.inner or declared.outer):
        raise RenameRefused(f"'{declared.name}' is inner or outer: also parts of the library find it by its name")
    return found, found.declared


def rename(
    own: Answers, offset: int, new: str, others: Callable[[Sequence[str]], Iterable[Answers]], keywords: frozenset[str]
) -> list[Span]:
    """Return the places that change their name.

    Parameters
    ----------
    others : gives the other texts in which one of some names occurs

    Raises
    ------
    RenameRefused
    """
    found, declared = renamable(*own.at(offset))
    if not _NAME.fullmatch(new) or new in keywords:
        raise RenameRefused(f"'{new}' is not a name: letters, digits and _, or anything in single quotes")
    if new in RESERVED:
        raise RenameRefused(f"'{new}' has a meaning everywhere")
    old, place = declared.text, own.place(declared)
    if new == old:
        return []
    owner = found.meaning.scope if isinstance(found.meaning, Member) else getattr(found.meaning, "parent", None)
    definition = getattr(owner, "definition", None)
    texts = [own, *others([old, new, *([definition.name] if definition is not None else [])])]
    spans = [s for text in texts for s in text.places(*place, (old,)) if s.text == old]
    _refuse_what_is_found_by_name(place, old, spans, texts)
    if definition is not None:
        _refuse_clashes(own.place(definition.name_span), new, texts)
    _refuse_other_meanings(texts, spans, old, new)
    return spans


def _refuse_what_is_found_by_name(place: Place, old: str, spans: Sequence[Span], texts: Sequence[Answers]) -> None:
    """Refuse where a file's name, or another declaration, has to be the same."""
    if place not in ((s.source.name, s.start) for s in spans):
        raise RenameRefused(f"it is declared in '{place[0]}', which is in no folder of the workspace")
    for text in texts:
        for item in walk(tuple(c for p in text.reading.pieces if old in p.words for c in p.file.classes)):
            if isinstance(item, tree.Class | tree.Component) and item.redeclare and item.name == old:
                raise RenameRefused(f"'{old}' is redeclared: {text.reading.here(item.name_span)}")
        file, name = text.reading.file, text.reading.source.name
        stem = Path(name).stem
        elsewhere = file.within or any(s.source.name != place[0] for s in spans)
        if place in {text.place(c.name_span) for c in file.classes} and (stem == PACKAGE or stem == old and elsewhere):
            raise RenameRefused(f"the class is found by the name of its file or folder: '{name}'")


def _refuse_clashes(owner: Place, new: str, texts: Sequence[Answers]) -> None:
    """Refuse where a class that has the element has another one of the new name."""
    for text in texts:
        reached = text.reading.reached_by(*owner)
        for scope in scopes_in(text.root):
            if id(scope.definition.span.source) not in reached:
                continue
            try:
                lineage = scope.lineage()
            except Wrong:
                continue
            has = (text.place(s.definition.name_span) for s in lineage if s.definition is not None)
            if owner in has and element(scope, new) is not None:
                raise RenameRefused(f"there is a '{new}' in '{scope.full_name}'")


def _refuse_other_meanings(texts: Sequence[Answers], spans: Sequence[Span], old: str, new: str) -> None:
    """Refuse where a name would be declared elsewhere."""
    starts: dict[str, list[int]] = {text.reading.source.name: [] for text in texts}
    for s in sorted(spans, key=lambda s: s.start):
        starts[s.source.name].append(s.start)

    def moved(file: str, start: int) -> int:
        return start + (len(new) - len(old)) * bisect_left(starts.get(file, []), start)

    after = {name: _with_name(text.reading.source, starts[name], len(old), new)
             for text in texts for name in (text.reading.source.name,)}  # fmt: skip
    with holding({os.path.abspath(name): text for name, text in after.items()}):
        for k, before in enumerate(texts):
            name = before.reading.source.name
            changed = Answers(read(name, after[name], before.reading.pieces))
            if not _same_meanings(before, changed, {old, new}, moved, alone=k == 0):
                where = f" in {Path(name).name}" if k else ""
                raise RenameRefused(f"with the name '{new}', something{where} would mean something else than before")


def _with_name(source: Source, starts: Sequence[int], length: int, new: str) -> str:
    """A text with a name in the place of others."""
    kept, done = [], 0
    for start in starts:
        kept += [source.text[done:start], new]
        done = start + length
    return "".join([*kept, source.text[done:]])


def _same_meanings(
    before: Answers, after: Answers, names: set[str], moved: Callable[[str, int], int], alone: bool
) -> bool:
    """Whether the names of a text are declared where they were.

    Parameters
    ----------
    alone : where declarations in the text itself are the same, those in other texts are
    """
    pairs = [*zip(before.reading.pieces, after.reading.pieces, strict=False)]
    if len(after.reading.pieces) != len(before.reading.pieces):
        return False
    uses, new_uses = before.reading.uses, after.reading.uses
    asked = [k for k, pair in enumerate(pairs) if _has(names, pair)
             and (not alone or pair[0] is not pair[1] or uses[k] != new_uses[k])]  # fmt: skip
    return all([*_written(before, k, moved)] == [*_written(after, k, lambda _, start: start)] for k in asked)


def _has(names: set[str], pieces: Iterable[Piece]) -> bool:
    return any(not names.isdisjoint(p.words) for p in pieces)


def _written(text: Answers, k: int, moved: Callable[[str, int], int]) -> Iterator[tuple[object, ...]]:
    """Each name of a piece with where it is declared, at places after some names have become longer."""
    source = text.reading.pieces[k].source
    for o in text.occurrences(k):
        file, start = text.place(Span(source, o.start, o.end))
        declared = None if o.declared is None else text.place(o.declared)
        own = moved(file, start), moved(file, start + o.end - o.start)
        yield *own, o.role, type(o.meaning), declared and (declared[0], moved(*declared))
