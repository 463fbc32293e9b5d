"""What an editor asks of a whole text, answered piece by piece: what has not changed is not asked again.

The answers of a piece count lines from its beginning, so that they hold wherever it stands. They are asked again when
its text has changed, or declarations that the meaning of its names can depend on (`Reading.uses`).
"""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import pairwise

from lsprotocol import types as lsp

from lmoc.editor import colours, hints, outline
from lmoc.editor.analysis import Analysis
from lmoc.editor.names import Occurrence, at, occurrences
from lmoc.editor.pieces import Piece, Reading
from lmoc.editor.positions import position, span_range
from lmoc.messages.diagnostics import Report
from lmoc.messages.source import Source, Span
from lmoc.semantics.classes.scope import Scope
from lmoc.support.records import dataclass
from lmoc.syntax.format import joined, written
from lmoc.syntax.layout import formatted


@dataclass(frozen=True, eq=False)
class Names:
    """What the names of a piece mean.

    Attributes
    ----------
    tokens : for each stretch line, character, length, type and modifiers of each, from the one before it
    units : where a unit is shown, and which
    models : the place of the name of each class, and its full name
    runnable : of those that can be run
    """

    tokens: list[list[int]]
    units: tuple[tuple[lsp.Position, str], ...]
    models: tuple[tuple[lsp.Range, str], ...]
    runnable: tuple[tuple[lsp.Range, str], ...]


@dataclass(frozen=True)
class Named:
    """A name in a piece, and its declaration.

    Attributes
    ----------
    start, end : its characters in the piece
    where : the file of the declaration; or among the pieces that matter to this one (`Reading.used`), OWN for itself
    place : where it stands there; in a piece, in its declarations (`Piece.in_declarations`)
    text : what it is called there
    """

    start: int
    end: int
    where: str | int
    place: int
    text: str


OWN = -1


@dataclass(frozen=True, eq=False)
class Layout:
    """What follows from the text of a piece alone."""

    symbols: tuple[outline.Symbol, ...]
    folds: tuple[tuple[int, int, bool], ...]


class Answers:
    """The answers to all questions about a text as a whole.

    Parameters
    ----------
    reading : Reading
    before : the answers of an older text, from which those are taken that hold
    among_the_same : whether the older one stood among the same other texts
    """

    def __init__(self, reading: Reading, before: Answers | None = None, among_the_same: bool = True) -> None:
        self.reading = reading
        self._layouts: dict[Piece, Layout] = {} if before is None else before._layouts
        self._formatted: dict[Piece, tuple[list[str], bool]] = {} if before is None else before._formatted
        self._names: dict[Piece, tuple[tuple[str, ...], Names]] = {}
        self._named: dict[Piece, tuple[tuple[str, ...], list[Named]]] = {}
        if before is not None and among_the_same:
            self._names, self._named = before._names, before._named
        self._occurrences: dict[int, list[Occurrence]] = {}
        alive = set(reading.pieces)
        for kept in (self._layouts, self._formatted, self._names, self._named):
            for piece in [p for p in kept if p not in alive]:
                del kept[piece]

    @cached_property
    def root(self) -> Scope:
        """The scope of all classes of the text."""
        return self.reading.opened()

    def _analysis(self, k: int) -> Analysis:
        return self.reading.analysis(k, self.root)

    # ------------------------------------------------------------------ of the text alone

    def _layout(self, k: int) -> Layout:
        piece = self.reading.pieces[k]
        if piece not in self._layouts:
            analysis = Analysis(piece.source, piece.file, _NOWHERE)
            folds = ((span_range(span), comment) for span, comment in outline.folds(analysis))
            lines = tuple((r.start.line, r.end.line, comment) for r, comment in folds if r.end.line > r.start.line)
            self._layouts[piece] = Layout(tuple(outline.symbols(analysis)), lines)
        return self._layouts[piece]

    def symbols(self) -> Iterator[outline.Symbol]:
        """Yield the outline."""
        for k, package in enumerate(self.reading.around):
            if package is None:
                yield from (self._symbol(k, s) for s in self._layout(k).symbols)

    def _symbol(self, k: int, s: outline.Symbol) -> outline.Symbol:
        """A symbol of a piece as it stands in the text; of a class that is another piece, what that one says."""
        inner = self.reading.inner.get((k, s.name_range.start.line))
        if inner is not None:
            return self._symbol(inner, self._layout(inner).symbols[0])
        inside = tuple(self._symbol(k, i) for i in s.inside)
        return replace(s, range=self._range(k, s.range), name_range=self._range(k, s.name_range), inside=inside)

    def folds(self) -> Iterator[tuple[int, int, bool]]:
        """Yield first and last line of what can be folded, and whether it is a comment."""
        for k in range(len(self.reading.pieces)):
            for first, last, comment in self._layout(k).folds:
                yield self._line(k, first), self._line(k, last), comment

    def formatted(self) -> str | None:
        """Return the text in the standard layout; None where something of it would be lost."""
        pieces = self.reading.pieces
        if any(d.severity == "error" for p in pieces for d in p.diagnostics):
            return None
        if any(p.stubs for p in pieces):
            return formatted(self.reading.source)
        for piece in pieces:
            if piece not in self._formatted:
                self._formatted[piece] = written(piece.file)
        return joined([self._formatted[p] for p in pieces])

    def _line(self, k: int, line: int) -> int:
        """Where in the text a line of a piece is."""
        own = self.reading.of_piece[k]
        return line + own[bisect_right(own, line, key=lambda s: s.first) - 1 if len(own) > 1 else 0].lines

    def _range(self, k: int, place: lsp.Range) -> lsp.Range:
        start, end = place.start, place.end
        first, last = self._line(k, start.line), self._line(k, end.line)
        return lsp.Range(lsp.Position(first, start.character), lsp.Position(last, end.character))

    # ------------------------------------------------------------------ of names

    def _of_names(self, k: int) -> Names:
        piece, uses = self.reading.pieces[k], self.reading.uses[k]
        kept = self._names.get(piece)
        if kept is None or kept[0] != uses:
            firsts = [s.first for s in self.reading.of_piece[k]]
            kept = self._names[piece] = uses, _names_of(self._analysis(k), self.occurrences(k), firsts)
        return kept[1]

    def occurrences(self, k: int) -> list[Occurrence]:
        """Return the names of a piece, with places in its text."""
        if k not in self._occurrences:
            self._occurrences[k] = occurrences(self._analysis(k))
        return self._occurrences[k]

    def tokens(self, first: int = 0, last: int | None = None) -> list[int]:
        """Return the names as the protocol packs them, of the pieces that have some of these lines."""
        data: list[int] = []
        reached = 0
        asked: Counter[int] = Counter()
        for s in self.reading.stretches:
            n, asked[s.piece] = asked[s.piece], asked[s.piece] + 1
            if s.last >= first and (last is None or s.first + s.lines <= last):
                own = self._of_names(s.piece).tokens[n]
                if own:
                    data += [s.lines + own[0] - reached, *own[1:]]
                    reached = s.lines + sum(own[::5])
        return data

    def units(self, first: int = 0, last: int | None = None) -> Iterator[tuple[lsp.Position, str]]:
        """Yield where a unit is to be shown, and which."""
        for k, own in enumerate(self.reading.of_piece):
            if own[-1].last >= first and (last is None or own[0].first + own[0].lines <= last):
                for place, text in self._of_names(k).units:
                    yield lsp.Position(self._line(k, place.line), place.character), text

    def models(self) -> Iterator[tuple[lsp.Range, str]]:
        """Yield the place of the name of each class, and its full name."""
        yield from self._ranges(lambda names: names.models)

    def runnable(self) -> Iterator[tuple[lsp.Range, str]]:
        """Yield the same of those that can be run."""
        yield from self._ranges(lambda names: names.runnable)

    def _ranges(self, of: Callable[[Names], Sequence[tuple[lsp.Range, str]]]) -> Iterator[tuple[lsp.Range, str]]:
        for k in range(len(self.reading.pieces)):
            yield from ((self._range(k, place), text) for place, text in of(self._of_names(k)))

    def named(self, k: int) -> list[Named]:
        """Return the names of a piece that are declared somewhere."""
        piece, uses = self.reading.pieces[k], self.reading.uses[k]
        kept = self._named.get(piece)
        if kept is None or kept[0] != uses:
            found = [(o, o.declared) for o in self.occurrences(k) if o.start < o.end]  # what is missing has no name
            kept = self._named[piece] = uses, [self._of(k, o, span) for o, span in found if span is not None]
        return kept[1]

    def _of(self, k: int, o: Occurrence, declared: Span) -> Named:
        j = self.reading.number.get(id(declared.source))
        if j is None:
            return Named(o.start, o.end, declared.source.name, declared.start, declared.text)
        where = OWN if j == k else self.reading.used[k].index(j)
        return Named(o.start, o.end, where, self.reading.pieces[j].in_declarations(declared.start), declared.text)

    def at(self, place: int) -> tuple[Occurrence | None, Source]:
        """Return the name at a character, and the text of its piece."""
        k, own = self.reading.at(place)
        return at(self.occurrences(k), own), self.reading.pieces[k].source

    def place(self, span: Span) -> tuple[str, int]:
        """Return the file in which something stands, and where in its whole text."""
        here = self.reading.here(span) or span
        return here.source.name, here.start

    def declared(self, place: int) -> Declared | None:
        """Return where the name at a character is declared; None where there is none."""
        reading = self.reading
        k, own = reading.at(place)
        found = max((n for n in self.named(k) if n.start <= own <= n.end), key=lambda n: n.start, default=None)
        if found is None:
            return None
        words = reading.pieces[k].source.text[found.start : found.end], found.text
        if isinstance(found.where, str):
            return Declared(found.where, found.place, words)
        j = k if found.where == OWN else reading.used[k][found.where]
        return Declared(reading.source.name, reading.whole(j, reading.pieces[j].in_text(found.place)), words)

    def places(self, file: str, start: int, words: Iterable[str]) -> list[Span]:
        """Return all places in this text of what is declared in a file, itself or another one, and called so."""
        reading, found = self.reading, []
        j, place = reading.at(start) if file == reading.source.name else (None, start)
        place = place if j is None else reading.pieces[j].in_declarations(place)
        for k, piece in enumerate(reading.pieces):
            if piece.words.isdisjoint(words):
                continue
            where: str | int | None = file
            if j is not None:
                where = OWN if j == k else reading.used[k].index(j) if j in reading.used[k] else None
            own = (Span(piece.source, n.start, n.end) for n in self.named(k) if (n.where, n.place) == (where, place))
            found += [here for span in own if (here := reading.here(span)) is not None]
        return found


@dataclass(frozen=True)
class Declared:
    """Where something is declared: the file, where in its whole text, and what it is called."""

    file: str
    start: int
    words: tuple[str, ...]


_NOWHERE = Scope(None, None, Report(), False)  # the outline asks for no scopes


def _names_of(analysis: Analysis, names: list[Occurrence], firsts: list[int]) -> Names:
    source = analysis.source
    starts = [*(source.line_starts[line] for line in firsts), len(source.text) + 1]
    tokens = [colours.encoded(source, [o for o in names if a <= o.start < b]) for a, b in pairwise(starts)]
    units = tuple((position(source, h.at), h.text) for h in hints.units(analysis, names))
    models = tuple((span_range(d.name_span), scope.full_name) for d in analysis.classes()
                   if (scope := analysis.scopes.get(d.name_span.start)) is not None)  # fmt: skip
    runnable = tuple((span_range(d.name_span), name) for d, name in hints.runnable(analysis))
    return Names(tokens, units, models, runnable)
