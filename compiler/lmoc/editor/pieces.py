"""A text in pieces that are understood one by one: after a key the piece around it is read again, and no other.

A piece is a part of the text (`lmoc.syntax.parts`) with a text and places of its own, so that it stays what it is where
something before it becomes longer. What follows from the text alone is the same whichever texts were read before: these
lend their pieces, nothing else.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterable, Iterator
from functools import cached_property
from itertools import accumulate

from lmoc.editor.analysis import Analysis, folders, opened
from lmoc.messages.diagnostics import Diagnostic
from lmoc.messages.source import Source, Span
from lmoc.semantics.classes.scope import Scope
from lmoc.sources.packages import own_folders
from lmoc.support.records import dataclass
from lmoc.syntax import tree
from lmoc.syntax.parse import Parsed, accepted, mended, refused
from lmoc.syntax.parts import Part, divided

_WORD = re.compile(r"[^\W\d]\w*|'(?:[^'\\\n]|\\.)+'")
_BODIES = ("equations", "initial_equations", "statements", "initial_statements")


@dataclass(frozen=True, eq=False)
class Piece:
    """Some classes of a text.

    Attributes
    ----------
    source : their text alone
    file : what could be understood of it
    diagnostics : what is wrong with its grammar
    right : whether the grammar accepts it
    """

    source: Source
    file: tree.File
    diagnostics: tuple[Diagnostic, ...]
    right: bool

    @cached_property
    def words(self) -> frozenset[str]:
        """All that can be a name in it."""
        return frozenset(_WORD.findall(self.source.text))

    @cached_property
    def blank(self) -> str:
        """Nothing that is as long as the text, line by line."""
        return re.sub(r"[^\n]", " ", self.source.text)

    @cached_property
    def _bodies(self) -> list[tuple[int, int]]:
        """Where equations and statements begin and end."""
        if not self.right:
            return []
        return sorted((item.span.start, item.span.end) for c in with_inner(self.file.classes)
                      for body in _BODIES for item in getattr(c, body))  # fmt: skip

    @cached_property
    def declarations(self) -> str:
        """The text without equations and statements: all that other classes can know of its classes."""
        kept, done = [], 0
        for start, end in self._bodies:
            kept.append(self.source.text[done:start])
            done = end
        return "".join([*kept, self.source.text[done:]])

    def in_declarations(self, place: int) -> int:
        """Return where a character stands in the declarations; less than 0, and different, where it does not."""
        gone = 0
        for start, end in self._bodies:
            if place < start:
                break
            if place < end:
                return -1 - place
            gone += end - start
        return place - gone

    def in_text(self, place: int) -> int:
        """Return where in the text a character of the declarations stands: `in_declarations` the other way round."""
        if place < 0:
            return -1 - place
        for start, end in self._bodies:
            if place < start:
                break
            place += end - start
        return place

    @cached_property
    def words_of_declarations(self) -> frozenset[str]:
        """All that can be a name in its declarations."""
        return frozenset(_WORD.findall(self.declarations))


@dataclass(frozen=True, eq=False)
class Reading:
    """A text in pieces.

    Attributes
    ----------
    source : the whole text
    pieces : those of which it consists, in their order
    """

    source: Source
    pieces: tuple[Piece, ...]

    @cached_property
    def starts(self) -> list[int]:
        """The character with which each piece begins, and the end of the text."""
        return [0, *accumulate(len(p.source.text) for p in self.pieces)]

    @cached_property
    def number(self) -> dict[int, int]:
        """Which piece has a text, by the identity of its source."""
        return {id(p.source): k for k, p in enumerate(self.pieces)}

    @cached_property
    def lines(self) -> list[int]:
        """The line, counted from 0, with which each piece begins."""
        return [0, *accumulate(p.source.text.count("\n") for p in self.pieces)]

    @cached_property
    def file(self) -> tree.File:
        """The classes of all pieces, each with places in the text of its piece."""
        classes = tuple(c for p in self.pieces for c in p.file.classes)
        return tree.File(self.pieces[0].file.within, classes, Span(self.source, 0, len(self.source.text)))

    def opened(self) -> Scope:
        """Return the scope of all classes, made anew: what is found in it is for one thread."""
        return opened(self.source.name, self.file)

    def analysis(self, k: int, root: Scope) -> Analysis:
        """Return what is known of a piece among the classes of the whole text."""
        return Analysis(self.pieces[k].source, self.file, root)

    def at(self, place: int) -> int:
        """Return the piece in which a character stands, or behind which the text ends."""
        return min(max(0, bisect_right(self.starts, place) - 1), len(self.pieces) - 1)

    def here(self, span: Span) -> Span | None:
        """Return where something that stands in a piece stands in the text; None where it is in another text."""
        k = self.number.get(id(span.source))
        return None if k is None else Span(self.source, span.start + self.starts[k], span.end + self.starts[k])

    def reached_by(self, file: str, start: int) -> set[int]:
        """The identities of the texts of pieces to which it can matter what is declared there."""
        j = self.at(start) if file == self.source.name else None
        return {id(p.source) for k, p in enumerate(self.pieces) if j is None or j == k or j in self.used[k]}

    @cached_property
    def uses(self) -> list[tuple[str, ...]]:
        """For each piece the declarations on which the meaning of its names can depend: equal ones, equal meanings."""
        everything = tuple(p.source.text for p in self.pieces)
        return [everything if self._reached_by_declarations[k] is None
                else tuple(self.pieces[j].declarations for j in used) for k, used in enumerate(self.used)]  # fmt: skip

    @cached_property
    def used(self) -> list[list[int]]:
        """For each piece those whose declarations these are, in the same order."""
        return [[*range(len(self.pieces))] if r is None else sorted(r) for r in self._reached_by_declarations]

    @cached_property
    def _reached_by_declarations(self) -> list[frozenset[int] | None]:
        return self._reached([p.words_of_declarations for p in self.pieces])

    @cached_property
    def needs(self) -> list[frozenset[int] | None]:
        """For each piece those of which its models can be made, itself included; None where that is not known."""
        reached = self._reached([p.words for p in self.pieces])
        return [None if r is None else r | {k} for k, r in enumerate(reached)]

    def _reached(self, onward: list[frozenset[str]]) -> list[frozenset[int] | None]:
        """For each piece those that matter to it; None for all of them.

        A name means an element of a class, or a class that is looked up from there. So the classes that matter are
        those whose names occur in the piece, in the text of these (of which `onward` has the words), and so on. Classes
        of other files see all of this one.
        """
        if self.file.within or any(own_folders(self.file, c) for c in self.file.classes[:1]):
            return [None] * len(self.pieces)
        named: dict[str, list[int]] = {}
        for k, p in enumerate(self.pieces):
            for c in p.file.classes:
                named.setdefault(c.name, []).append(k)
        elsewhere = self._elsewhere() - named.keys()
        further = [_pieces_of(words, named) for words in onward]
        found: list[frozenset[int] | None] = []
        for p in self.pieces:
            reached = _followed(_pieces_of(p.words, named), further)
            open_ended = any(not elsewhere.isdisjoint(w) for w in (p.words, *(onward[j] for j in reached)))
            found.append(None if open_ended else frozenset(reached))
        return found

    def _elsewhere(self) -> set[str]:
        """The names in this text of classes that are in files of its folder, or may be."""
        words = frozenset().union(*(p.words for p in self.pieces))
        return {name for f in folders(self.source.name, self.file) for name in words.intersection(f.names())
                if f.may_define(name)}  # fmt: skip


def _pieces_of(words: frozenset[str], named: dict[str, list[int]]) -> list[int]:
    return [k for word in named.keys() & words for k in named[word]]


def _followed(first: Iterable[int], onward: list[list[int]]) -> set[int]:
    reached: set[int] = set()
    pending = [*first]
    while pending:
        k = pending.pop()
        if k not in reached:
            reached.add(k)
            pending += onward[k]
    return reached


def with_inner(classes: Iterable[tree.Class]) -> Iterator[tree.Class]:
    """Yield some classes, each with those inside of it."""
    for definition in classes:
        yield definition
        yield from with_inner(e for e in definition.elements if isinstance(e, tree.Class))


def read(path: str, text: str, before: Iterable[Piece] = ()) -> Reading:
    """Return a text in its pieces.

    Parameters
    ----------
    path : of its file
    before : pieces of an older text, which are taken where they have the same text
    """
    lent: dict[str, list[Piece]] = {}
    for piece in before:
        lent.setdefault(piece.source.text, []).append(piece)
    source = Source(path, text)
    return Reading(source, tuple(_pieces(source, lent)))


def _pieces(source: Source, lent: dict[str, list[Piece]]) -> list[Piece]:
    """The pieces of a text: its parts, but in one those from the first to the last that is wrong by itself."""
    parts = divided(source.text)
    found = [_right(source, part, lent) for part in parts]
    wrong = [k for k, piece in enumerate(found) if piece is None]
    if not wrong:
        return [p for p in found if p is not None]
    first, last = wrong[0], wrong[-1]
    middle = Part(parts[first].start, parts[last].end)
    piece = _right(source, middle, lent) if last > first else None
    whole = Part(0, len(source.text))
    if piece is None and middle != whole and not refused(source, middle):
        read_as_one = _right(source, whole, lent)
        if read_as_one is not None:
            return [read_as_one]
    if piece is None:
        piece = _lent(source.text[middle.start : middle.end], lent, right=False) or _repaired(source, middle)
    return [p for p in (*found[:first], piece, *found[last + 1 :]) if p is not None]


def _lent(text: str, lent: dict[str, list[Piece]], right: bool) -> Piece | None:
    """A piece of an older text; each is used once, since its places are those of one piece."""
    kept = lent.get(text)
    return kept.pop() if kept and kept[-1].right == right else None


def _right(source: Source, part: Part, lent: dict[str, list[Piece]]) -> Piece | None:
    """A part as it stands, if the grammar accepts it."""
    text = source.text[part.start : part.end]
    if lent.get(text):
        return _lent(text, lent, right=True)
    own = Source(source.name, text)
    return _piece(own, accepted(own, Part(0, len(text))), right=True)


def _repaired(source: Source, part: Part) -> Piece | None:
    own = Source(source.name, source.text[part.start : part.end])
    return _piece(own, mended(own, Part(0, len(own.text))), right=False)


def _piece(source: Source, parsed: Parsed | None, right: bool) -> Piece | None:
    return None if parsed is None else Piece(source, parsed.file, parsed.diagnostics, right)
