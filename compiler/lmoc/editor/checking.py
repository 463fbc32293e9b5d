"""The diagnostics of a text: those of `lmoc check`, for every model that could be meant.

Checking solves for the start of a scene and can take seconds; an editor has it done in a process of its own
(`lmoc.editor.background`), in which a model is not checked again as long as the pieces of the text of which it is made
(`lmoc.editor.pieces`) are the same.
"""

from __future__ import annotations

import os
import re
from bisect import bisect_right
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path

from lmoc.editor.analysis import folders, opened, own_folder
from lmoc.editor.pieces import Piece, Reading, Stretch, read, with_inner
from lmoc.messages.diagnostics import Diagnostic, ModelError, Report
from lmoc.messages.source import Source, Span
from lmoc.support.quoted import split
from lmoc.support.records import dataclass
from lmoc.syntax import tree
from lmoc.syntax.classwise import parse_classwise, with_mistakes
from lmoc.syntax.parts import blank, emptied

_LINE = re.compile(r"\bline \d+|:\d+:\d+")  # a place in a message itself


@dataclass(frozen=True)
class FileRange:
    """A range of characters of a file."""

    file: str
    start: int
    end: int


@dataclass(frozen=True)
class Finding:
    """A diagnostic without its source, so that it can pass between processes."""

    code: str
    severity: str
    message: str
    place: FileRange | None
    expected: str
    found: str
    hint: str
    labels: tuple[tuple[FileRange, str], ...]


@dataclass(frozen=True)
class Checked:
    """The outcome of a check.

    Attributes
    ----------
    counts : {model: (stage, count) …}, of models without errors
    left, models : how many models are still to be checked, of how many
    """

    findings: tuple[Finding, ...]
    counts: tuple[tuple[str, tuple[tuple[str, int], ...]], ...]
    left: int = 0
    models: int = 0


@dataclass(frozen=True)
class _Found:
    """What a check of one model has found.

    Attributes
    ----------
    begin : where the pieces of which it is made begin
    """

    findings: tuple[Finding, ...]
    counts: tuple[tuple[str, int], ...] | None
    begin: tuple[int, ...]


Kept = dict[tuple[object, ...], _Found]


def check(text: str, path: str) -> Checked:
    """Check every model of a text that `lmoc check` would take with ``--model`` or without.

    Parameters
    ----------
    path : of the file that the text belongs to
    """
    return Checks().check(text, path)


class Stopped(Exception):
    """A check has been given up."""


Part = Callable[[], Checked]


class Checks:
    """Checks texts one after the other: models that have not changed are not checked again."""

    def __init__(self) -> None:
        self._readings: dict[str, Reading] = {}
        self._kept: dict[str, Kept] = {}  # {path: what was found in its last text}
        self._age: dict[str, dict[Piece, int]] = {}  # {path: the text of the file in which each piece came up}
        self._texts = 0

    def check(
        self, text: str, path: str, go_on: Callable[[], bool] = lambda: True,
        tell: Callable[[Part], None] = lambda _: None,
    ) -> Checked:  # fmt: skip
        """Return what a check of a text finds, as the function `check`.

        Models whose own text has changed last are checked first.

        Parameters
        ----------
        go_on : asked after each model; where it says no, the check is given up
        tell : told after each model, but the last, what returns the outcome so far

        Raises
        ------
        Stopped
        """
        one = self._read(text, path)
        if any(d.severity == "error" for d in one.misplaced):
            return Checked(tuple(map(_finding, one.misplaced)), ())
        kept = self._kept.setdefault(path, {})
        keys = {model: one.key(model) for model in one.models()}
        found = {model: kept[key] for model, key in keys.items() if key in kept}
        age = self._age[path]
        unchecked = sorted((m for m in keys if m not in found), key=lambda m: -max(age[p] for p in one.own(m)))
        for k, model in enumerate(unchecked, 1):
            own = found[model] = one.checked(model)
            if one.holds(model, own):
                kept[keys[model]] = own
            if not go_on():
                raise Stopped
            if left := len(unchecked) - k:
                tell(lambda left=left: one.outcome(keys, found, left))
        self._kept[path] = {key: kept[key] for key in keys.values() if key in kept}
        return one.outcome(keys, found)

    def _read(self, text: str, path: str) -> _Text:
        before = self._readings.get(path)
        reading = self._readings[path] = read(path, text, () if before is None else before.pieces)
        self._texts += 1
        age = self._age.get(path, {})
        self._age[path] = {p: age.get(p, self._texts) for p in reading.pieces}
        return _Text(reading)


@dataclass(frozen=True)
class _Model:
    """A model to check; without `asked` for the one that is meant where none is named.

    Attributes
    ----------
    pieces : those of which it can be made; None for all
    """

    name: str
    asked: str | None
    pieces: tuple[int, ...] | None


class _Text:
    """A text whose models are checked."""

    def __init__(self, reading: Reading) -> None:
        self.reading = reading
        split_up = [with_mistakes(p.file, p.diagnostics) for p in reading.pieces]
        self.misplaced = [self._moved(d) for _, rest in split_up for d in rest]
        self._classes = [own.classes for own, _ in split_up]

    def models(self) -> Sequence[_Model]:
        """The models to check."""
        from lmoc.semantics.classes.choose import choose_model
        from lmoc.semantics.mistakes.wrong import NoModel, SeveralModels, Wrong

        file = self.reading.file
        try:
            one = choose_model(opened(self.reading.source.name, file), [file], None)
            return [_Model(one.full_name, None, self._needs(one.full_name))]
        except SeveralModels as wrong:
            return [_Model(name, name, self._needs(name)) for name in wrong.names]
        except NoModel:
            if file.classes:
                return ()
        except Wrong:
            pass  # it will be said
        return [_Model("", None, None)]

    def _needs(self, name: str) -> tuple[int, ...] | None:
        k = self._piece(name)
        needed = None if k is None else self.reading.needs[k]
        return None if needed is None else tuple(sorted(needed))

    def _piece(self, name: str) -> int | None:
        """The piece in which a class stands."""
        inside: Iterable[object] = self.reading.file.classes
        own: tree.Class | None = None
        for part in split(name) if name else ():
            own = next((c for c in inside if isinstance(c, tree.Class) and c.name == part), None)
            if own is None:
                break
            inside = own.elements
        return None if own is None else self.reading.number[id(own.span.source)]

    def own(self, model: _Model) -> Sequence[Piece]:
        """The pieces in which a model may stand itself."""
        k = self._piece(model.name)
        return self.reading.pieces if k is None else [self.reading.pieces[k]]

    def outcome(self, models: Collection[_Model], found: dict[_Model, _Found], left: int = 0) -> Checked:
        """The outcome of some models, in the order of the text."""
        here = [(model.name, self.here(model, found[model])) for model in models if model in found]
        findings = dict.fromkeys(f for _, own in here for f in own.findings)
        findings.update(dict.fromkeys(self.left_out([own.findings for _, own in here])))
        counts = tuple((name, own.counts) for name, own in here if own.counts is not None)
        return Checked(tuple(findings), counts, left, len(models))

    def key(self, model: _Model) -> tuple[object, ...]:
        """All that the outcome depends on: the pieces, and what else there is, which a hint may name."""
        texts = () if model.pieces is None else tuple(self.reading.pieces[k].source.text for k in model.pieces)
        return model, texts, self._names, self._around

    @cached_property
    def _names(self) -> tuple[tuple[str, str, bool], ...]:
        return tuple((c.name, c.kind, c.partial) for c in with_inner(self.reading.file.classes))

    @cached_property
    def _around(self) -> tuple[tuple[str, int, int], ...]:
        """The files in which further classes are looked for, as they are now, but that of the text itself."""
        entries = (e for f in folders(self.reading.source.name, self.reading.file) for e in os.scandir(f.path))
        own = Path(self.reading.source.name)
        named = any(c.name == own.stem for c in self.reading.file.classes)
        sought = not named and any(own.stem in p.words for p in self.reading.pieces)  # then it is found in the file
        files = (e for e in entries if e.is_file() and (sought or Path(e.path).absolute() != own.absolute()))
        return tuple(sorted((e.path, e.stat().st_mtime_ns, e.stat().st_size) for e in files))

    def checked(self, model: _Model) -> _Found:
        """Check a model."""
        from lmoc.compilation import compiled, scene_of

        path = [str(f.path) for f in own_folder(self.reading.source.name, self.reading.file)]
        said: Sequence[Diagnostic]
        try:
            dae = compiled(self._tree(model), scene_of(model.asked, path=path))
            said, counts = dae.check(), tuple(dae.reduced.counts.items())
        except ModelError as error:
            said, counts = error.diagnostics, None
        return _Found(tuple(_finding(self._moved(d)) for d in said), counts, self._begin(model))

    def _tree(self, model: _Model) -> tree.File:
        """The tree of the text: its pieces parsed where they stand; of the others what their classes are called."""
        reading = self.reading
        needed = range(len(reading.pieces)) if model.pieces is None else model.pieces
        text = "".join(self._text(s, needed) for s in reading.stretches)
        report = Report()
        goes_on = reading.stretches[-1].piece not in needed  # a class without end says what follows it
        file = parse_classwise(Source(reading.source.name, text, goes_on), report)
        report.check()
        classes: list[tree.Class] = []
        for k in (k for k, package in enumerate(reading.around) if package is None):
            own = (c for c in file.classes if reading.at(c.span.start)[0] == k)
            classes += own if k in needed else reading.pieces[k].file.classes
        return replace(file, classes=tuple(classes))

    def _text(self, s: Stretch, needed: Collection[int]) -> str:
        """The text of a stretch, or nothing that is as long; in a package, a class with nothing in it."""
        text = self.reading.pieces[s.piece].source.text[s.start : s.end]
        if s.piece in needed:
            return text
        return emptied(text) if self.reading.around[s.piece] in needed else blank(text)

    def _begin(self, model: _Model) -> tuple[int, ...]:
        return () if model.pieces is None else tuple(s.at for s in self.reading.stretches if s.piece in model.pieces)

    def _moved(self, d: Diagnostic) -> Diagnostic:
        """A diagnostic with places in the text itself instead of the text of a piece."""
        here = self.reading.here
        labels = tuple(replace(label, span=here(label.span) or label.span) for label in d.labels)
        return replace(d, span=d.span and (here(d.span) or d.span), labels=labels)

    def holds(self, model: _Model, found: _Found) -> bool:
        """Return whether the outcome says nothing of other pieces, and no lines in words, which may become others."""
        if model.pieces is None:
            return False
        for f in found.findings:
            for place in _places(f):
                s = self.reading.stretches[self.reading.stretch(place.start)]
                beyond = s.piece not in model.pieces or place.end > s.at + s.end - s.start
                if place.file == self.reading.source.name and beyond:
                    return False
            if any(_LINE.search(text) for text in (f.message, f.expected, f.found, f.hint, *(t for _, t in f.labels))):
                return False
        return True

    def here(self, model: _Model, found: _Found) -> _Found:
        """An outcome with the places that its pieces have in this text."""
        begin = self._begin(model)
        if begin == found.begin:
            return found

        def moved(place: FileRange) -> FileRange:
            if place.file != self.reading.source.name:
                return place
            k = bisect_right(found.begin, place.start) - 1
            further = begin[k] - found.begin[k]
            return FileRange(place.file, place.start + further, place.end + further)

        findings = tuple(
            replace(f, place=f.place and moved(f.place), labels=tuple((moved(p), text) for p, text in f.labels))
            for f in found.findings
        )
        return _Found(findings, found.counts, begin)

    def left_out(self, of_models: Sequence[Iterable[Finding]]) -> Iterator[Finding]:
        """Warn of classes with mistakes, but for those of which all models are made: there they are errors."""
        from lmoc.semantics.classes.choose import left_out

        file = replace(self.reading.file, classes=tuple(c for own in self._classes for c in own))
        for definition in with_inner(file.classes):
            mistakes = [_finding(self._moved(d)) for d in definition.mistakes if d.severity == "error"]
            if mistakes and not (of_models and all(mistakes[0] in found for found in of_models)):
                alone = replace(file, classes=(replace(definition, elements=()),))
                yield from (_finding(self._moved(d)) for d in left_out([alone], Report()))


def _places(f: Finding) -> Iterator[FileRange]:
    if f.place is not None:
        yield f.place
    yield from (place for place, _ in f.labels)


def _finding(d: Diagnostic) -> Finding:
    labels = tuple((_place(label.span), label.text) for label in d.labels)
    return Finding(d.code, d.severity, d.message, d.span and _place(d.span), d.expected, d.found, d.hint, labels)


def _place(span: Span) -> FileRange:
    return FileRange(span.source.name, span.start, span.end)
