"""A text in pieces that are understood one by one: after a key the piece around it is read again, and no other.

A piece is a part of the text (`lmoc.syntax.parts`) with a text and places of its own, so that it stays what it is where
something before it becomes longer. Classes inside of a package are pieces of their own; the text of its piece has empty
ones in their places. What follows from the text alone is the same whichever texts were read before: these lend their
pieces, nothing else.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterable, Iterator
from functools import cached_property
from typing import NamedTuple

from lmoc.editor.analysis import Analysis, folders, opened
from lmoc.messages.diagnostics import Diagnostic
from lmoc.messages.source import Source, Span
from lmoc.semantics.classes.scope import Scope
from lmoc.sources.packages import own_folders
from lmoc.support.records import dataclass
from lmoc.syntax import tree
from lmoc.syntax.parse import Parsed, accepted, cut_out, filled, mended, mended_inside, refused, right_inside
from lmoc.syntax.parts import Inside, Part, divided, inside

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
    stubs : where there are empty classes in it, in the places of those of the pieces that follow
    """

    source: Source
    file: tree.File
    diagnostics: tuple[Diagnostic, ...]
    right: bool
    stubs: tuple[tuple[int, int], ...] = ()

    @cached_property
    def words(self) -> frozenset[str]:
        """All that can be a name in it."""
        return frozenset(_WORD.findall(_left(self.source.text, self.stubs)))

    @cached_property
    def _bodies(self) -> list[tuple[int, int]]:
        """Where equations, statements and the classes of other pieces begin and end."""
        if not self.right:
            return []
        found = ((item.span.start, item.span.end) for c in with_inner(self.file.classes)
                 for body in _BODIES for item in getattr(c, body))  # fmt: skip
        return sorted((*found, *self.stubs))

    @cached_property
    def declarations(self) -> str:
        """The text without equations and statements: all that other classes can know of its classes."""
        return _left(self.source.text, self._bodies)

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


class Stretch(NamedTuple):
    """A stretch of a text that is of one piece, whole lines of it.

    Attributes
    ----------
    piece : which one
    start, end : of it in the text of the piece
    first : its first line there
    at : the character of the whole text with which it begins
    lines : what is to be added to a line of the piece
    last : the line of the whole text behind it
    """

    piece: int
    start: int
    end: int
    first: int
    at: int
    lines: int
    last: int


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
    def stretches(self) -> tuple[Stretch, ...]:
        """The text from its beginning to its end, each stretch being of one piece."""
        found: list[Stretch] = []
        k = 0

        def add(k: int, start: int, end: int) -> None:
            at, line = (found[-1].at + found[-1].end - found[-1].start, found[-1].last) if found else (0, 0)
            text = self.pieces[k].source.text
            first = text.count("\n", 0, start)
            found.append(Stretch(k, start, end, first, at, line - first, line + text.count("\n", start, end)))

        while k < len(self.pieces):
            around, done = k, 0
            for start, end in self.pieces[around].stubs:
                add(around, done, start)
                k, done = k + 1, end
                add(k, 0, len(self.pieces[k].source.text))
            add(around, done, len(self.pieces[around].source.text))
            k += 1
        return tuple(found)

    @cached_property
    def _starts(self) -> list[int]:
        return [s.at for s in self.stretches]

    @cached_property
    def of_piece(self) -> list[list[Stretch]]:
        """For each piece its stretches."""
        found: list[list[Stretch]] = [[] for _ in self.pieces]
        for s in self.stretches:
            found[s.piece].append(s)
        return found

    @cached_property
    def around(self) -> list[int | None]:
        """For each piece that of the package in which it is."""
        found: list[int | None] = [None] * len(self.pieces)
        for k, p in enumerate(self.pieces):
            found[k + 1 : k + 1 + len(p.stubs)] = [k] * len(p.stubs)
        return found

    @cached_property
    def inner(self) -> dict[tuple[int, int], int]:
        """The pieces of classes inside of packages, by the piece of the package and the line of the empty class."""
        return {(k, s.first - 1): k + n for k, own in enumerate(self.of_piece) for n, s in enumerate(own[1:], 1)}

    @cached_property
    def number(self) -> dict[int, int]:
        """Which piece has a text, by the identity of its source."""
        return {id(p.source): k for k, p in enumerate(self.pieces)}

    @cached_property
    def file(self) -> tree.File:
        """The classes of all pieces, each with places in the text of its piece."""
        classes: list[tree.Class] = []
        for k, p in enumerate(self.pieces):
            if self.around[k] is None:
                inside = zip(p.stubs, self.pieces[k + 1 :])
                others = {start + q.file.classes[0].name_span.end: q.file.classes[0] for (start, _), q in inside}
                classes += filled(p.file.classes, others) if others else p.file.classes
        return tree.File(self.pieces[0].file.within, tuple(classes), Span(self.source, 0, len(self.source.text)))

    def opened(self) -> Scope:
        """Return the scope of all classes, made anew: what is found in it is for one thread."""
        return opened(self.source.name, self.file)

    def analysis(self, k: int, root: Scope) -> Analysis:
        """Return what is known of a piece among the classes of the whole text."""
        return Analysis(self.pieces[k].source, self.pieces[k].file, root)

    def at(self, place: int) -> tuple[int, int]:
        """Return the piece in which a character stands, or behind which the text ends, and where in its text."""
        s = self.stretches[self.stretch(place)]
        return s.piece, place - s.at + s.start

    def stretch(self, place: int) -> int:
        """Return which stretch of the text has a character."""
        return max(0, bisect_right(self._starts, place) - 1)

    def whole(self, k: int, place: int) -> int:
        """Return where in the text a character of a piece stands."""
        own = self.of_piece[k]
        s = own[bisect_right(own, place, key=lambda s: s.start) - 1] if len(own) > 1 else own[0]
        return place - s.start + s.at

    def here(self, span: Span) -> Span | None:
        """Return where something that stands in a piece stands in the text; None where it is in another text."""
        k = self.number.get(id(span.source))
        if k is None:
            return None
        end = self.whole(k, span.end - 1) + 1 if span.end > span.start else self.whole(k, span.end)
        return Span(self.source, self.whole(k, span.start), end)

    def reached_by(self, file: str, start: int) -> set[int]:
        """The identities of the texts of pieces to which it can matter what is declared there."""
        j = self.at(start)[0] if file == self.source.name else None
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
        those whose names occur in the piece, and the packages around it, those in the text of these (of which `onward`
        has the words), and so on. Classes of other files see all of this one.
        """
        if self.file.within or any(own_folders(self.file, c) for c in self.file.classes[:1]):
            return [None] * len(self.pieces)
        named: dict[str, list[int]] = {}
        for k, p in enumerate(self.pieces):
            for c in p.file.classes:
                named.setdefault(c.name, []).append(k)
        elsewhere = self._elsewhere() - {c.name for c in self.file.classes}
        packages = [[] if k is None else [k] for k in self.around]
        further = [_pieces_of(words, named) + own for words, own in zip(onward, packages)]
        found: list[frozenset[int] | None] = []
        for p, own in zip(self.pieces, packages):
            reached = _followed(_pieces_of(p.words, named) + own, further)
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


def _left(text: str, gone: Iterable[tuple[int, int]]) -> str:
    """A text without some stretches."""
    kept, done = [], 0
    for start, end in gone:
        kept.append(text[done:start])
        done = end
    return "".join([*kept, text[done:]])


Stubs = tuple[tuple[int, int], ...]
Lent = dict[tuple[str, Stubs], list[Piece]]


def read(path: str, text: str, before: Iterable[Piece] = ()) -> Reading:
    """Return a text in its pieces.

    Parameters
    ----------
    path : of its file
    before : pieces of an older text, which are taken where they have the same text
    """
    lent: Lent = {}
    for piece in before:
        lent.setdefault((piece.source.text, piece.stubs), []).append(piece)
    source = Source(path, text)
    return Reading(source, tuple(_pieces(source, lent)))


def _pieces(source: Source, lent: Lent) -> list[Piece]:
    """The pieces of a text: its parts, but in one those from the first to the last that is wrong by itself."""
    parts = divided(source.text)
    found = [_of_part(source, part, lent) for part in parts]
    wrong = [k for k, pieces in enumerate(found) if not pieces or not all(p.right for p in pieces)]
    if len(wrong) > 1 or wrong and not found[wrong[0]]:
        first, last = wrong[0], wrong[-1]
        middle, whole = Part(parts[first].start, parts[last].end), Part(0, len(source.text))
        piece = _right(source, middle, lent) if last > first else None
        if piece is None and middle != whole and not refused(source, middle):
            read_as_one = _right(source, whole, lent)
            if read_as_one is not None:
                return [read_as_one]
        found[first : last + 1] = [[piece or _repaired(source, middle, lent)]]
    return [p for pieces in found for p in pieces]


def _of_part(source: Source, part: Part, lent: Lent) -> list[Piece]:
    """A part as it stands, but that one class inside of a package can be wrong; nothing where it is wrong elsewhere."""
    pieces = _package(source, part, lent)
    if pieces:
        return pieces
    piece = _right(source, part, lent)
    return [] if piece is None else [piece]


def _package(source: Source, part: Part, lent: Lent) -> list[Piece]:
    """A package, and the classes inside of it; nothing where these cannot be read by themselves."""
    cuts = inside(source.text, part)
    found, kept, stubs, heads, length, done = [], [], [], [], 0, part.start
    for cut in cuts:
        piece = _inner(source, cut, lent)
        if piece is None or not piece.right and not all(p.right for p in found):
            return []
        found.append(piece)
        head, foot = source.text[cut.start : cut.head], source.text[cut.foot : cut.end].lstrip(" \t")
        kept += [source.text[done : cut.start], f"{head} {foot}"]
        start = length + cut.start - done
        length = start + len(kept[-1])
        stubs.append((start, length))
        heads.append(start + len(head))
        done = cut.end
    own = Source(source.name, "".join([*kept, source.text[done : part.end]]))
    around = _right(own, Part(0, len(own.text)), lent, tuple(stubs)) if cuts else None
    return [around, *found] if around is not None and cut_out(around.file.classes, heads) else []


def _inner(source: Source, cut: Inside, lent: Lent) -> Piece | None:
    """A class inside of a package, which may be wrong; None where that matters to what is around it."""
    own, head = Source(source.name, source.text[cut.start : cut.end], goes_on=True), cut.head - cut.start
    whole = Part(0, len(own.text))
    piece = _right(own, whole, lent) or _lent_wrong(own, lent)
    piece = piece or _piece(own, mended_inside(own, whole, head), right=False)
    return piece if piece is not None and right_inside(piece.file, piece.diagnostics, head) else None


def _lent(text: str, lent: Lent, right: bool, stubs: Stubs = ()) -> Piece | None:
    """A piece of an older text; each is used once, since its places are those of one piece."""
    kept = lent.get((text, stubs))
    return kept.pop() if kept and kept[-1].right == right else None


def _lent_wrong(source: Source, lent: Lent) -> Piece | None:
    """One that is wrong, of which it matters whether the text goes on behind it."""
    kept = _lent(source.text, lent, right=False)
    return kept if kept is not None and kept.source.goes_on == source.goes_on else None


def _right(source: Source, part: Part, lent: Lent, stubs: Stubs = ()) -> Piece | None:
    """A part as it stands, if the grammar accepts it."""
    text = source.text[part.start : part.end]
    if lent.get((text, stubs)):
        return _lent(text, lent, True, stubs)
    own = Source(source.name, text)
    return _piece(own, accepted(own, Part(0, len(text))), True, stubs)


def _repaired(source: Source, part: Part, lent: Lent) -> Piece:
    own = Source(source.name, source.text[part.start : part.end], goes_on=part.end < len(source.text))
    kept = _lent_wrong(own, lent)
    if kept is not None:
        return kept
    parsed = mended(own, Part(0, len(own.text)))
    return Piece(own, parsed.file, parsed.diagnostics, right=False)


def _piece(source: Source, parsed: Parsed | None, right: bool, stubs: Stubs = ()) -> Piece | None:
    return None if parsed is None else Piece(source, parsed.file, parsed.diagnostics, right, stubs)
