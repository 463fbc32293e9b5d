"""What the language server knows: the texts that are open, and what has been read and checked of them."""

from __future__ import annotations

import gc
import os
import threading
from collections.abc import Generator, Iterable, Iterator
from pathlib import Path
from typing import Any

from lsprotocol import types as lsp
from pygls import uris
from pygls.lsp.server import LanguageServer
from pygls.protocol import LanguageServerProtocol, lsp_method

from lmoc.editor.analysis import Analysis
from lmoc.editor.answers import Answers
from lmoc.editor.background import Checker, Request
from lmoc.editor.checking import Checked, Finding
from lmoc.editor.pieces import Reading, read
from lmoc.editor.positions import offset, span_range
from lmoc.messages.diagnostics import ModelError
from lmoc.messages.source import Source, Span
from lmoc.semantics.classes.scope import Scope
from lmoc.sources.files import OPEN, SUFFIXES, package_file, read_source
from lmoc.sources.opened import top_folder
from lmoc.support.version import __version__

_SEVERITY = {
    "error": lsp.DiagnosticSeverity.Error, "warning": lsp.DiagnosticSeverity.Warning,
    "note": lsp.DiagnosticSeverity.Information,
}  # fmt: skip


_SETTLED = 5.0  # s after a text is opened
Others = frozenset[tuple[str, int | None]]


class _Protocol(LanguageServerProtocol):
    """Counts characters in units of UTF-16, as `positions` does, also with a client that prefers others."""

    @lsp_method(lsp.INITIALIZE)
    def lsp_initialize(self, params: lsp.InitializeParams) -> Generator[Any, Any, lsp.InitializeResult]:
        if params.capabilities.general is not None:
            params.capabilities.general.position_encodings = None
        return (yield from super().lsp_initialize(params))


class Server(LanguageServer):
    """The texts that are open, and what is known of them."""

    def __init__(self) -> None:
        super().__init__("lmoc", __version__, protocol_cls=_Protocol)
        self.checked: dict[str, tuple[str, Checked]] = {}  # {uri: (text, what a check of it has found)}
        self._checker: Checker | None = None
        self._readings: dict[str, Reading] = {}  # {uri: its text in pieces}
        self._answers: dict[str, tuple[str, Others, Answers]] = {}  # {uri: (text, the others, about all of it)}
        self._said: dict[str, tuple[str, list[int]]] = {}  # {uri: (their name, the tokens of the last answer)}
        self._count = 0  # answers with tokens
        self._scopes: tuple[Reading, Others, Scope] | None = None  # those in which the last place was looked at
        self._reading_lock, self.answering = threading.Lock(), threading.RLock()

    @property
    def checker(self) -> Checker:
        """The process that checks; begun with the first text."""
        if self._checker is None:
            self._checker = Checker(self.deliver)
        return self._checker

    def settle_later(self) -> None:
        """Soon have the collector of garbage look no more at what is there: 250 ms each time, of 5,000 lines."""
        timer = threading.Timer(_SETTLED, _settle)
        timer.daemon = True
        timer.start()

    def end(self) -> None:
        """End the process that checks."""
        if self._checker is not None:
            self._checker.close()

    def _versions(self, uri: str) -> Others:
        """The other texts that are open, as they stand: their classes are taken from them, saved or not."""
        return frozenset((other, d.version) for other, d in [*self.workspace.text_documents.items()] if other != uri)

    def read_again(self) -> None:
        """Forget what is known: files have changed."""
        self._answers.clear()
        self._scopes = None

    def hold(self, uri: str) -> None:
        """Have an open text read in the place of its file; of one that is closed, the file again."""
        path = os.path.abspath(path_of(uri))
        if uri in self.workspace.text_documents:
            OPEN[path] = self.workspace.get_text_document(uri).source
        else:
            OPEN.pop(path, None)

    def reading(self, uri: str) -> Reading:
        """Return a text in pieces: those that have been read before are not read again."""
        text = self.text(uri)
        with self._reading_lock:
            kept = self._readings.get(uri)
            if kept is None or kept.source.text != text:
                kept = self._readings[uri] = read(path_of(uri), text, () if kept is None else kept.pieces)
            return kept

    def quick(self, uri: str, place: lsp.Position) -> tuple[Analysis, int]:
        """Return what is known of the piece of a text around a place, and the character in this piece."""
        reading, others = self.reading(uri), self._versions(uri)
        if self._scopes is None or self._scopes[0] is not reading or self._scopes[1] != others:
            self._scopes = reading, others, reading.opened()
        k, at = reading.at(offset(reading.source, place))
        return reading.analysis(k, self._scopes[2]), at

    def answers(self, uri: str) -> Answers:
        """Return the answers about all of a text; to be asked while `answering` is held."""
        reading, others = self.reading(uri), self._versions(uri)
        kept = self._answers.get(uri)
        if kept is not None and kept[:2] == (reading.source.text, others):
            return kept[2]
        made = Answers(reading, *((None, False) if kept is None else (kept[2], kept[1] == others)))
        self._answers[uri] = reading.source.text, others, made
        return made

    def said(self, uri: str, tokens: list[int]) -> str:
        """Keep the tokens that are said of a text, and return the name under which an editor refers to them."""
        self._said[uri] = str(self._count), tokens
        self._count += 1
        return self._said[uri][0]

    def said_before(self, uri: str, name: str) -> list[int] | None:
        """Return the tokens that have been said under a name; None where others were said since."""
        last, tokens = self._said.get(uri, ("", None))
        return tokens if last == name else None

    def forget(self, uri: str) -> None:
        """A text is closed: nothing of it is kept."""
        for kept in (self.checked, self._readings, self._answers, self._said):
            kept.pop(uri, None)

    def others(self, uri: str, names: Iterable[str]) -> Iterator[Answers]:
        """Yield the answers about the other texts, open or in `files`, in which one of the names occurs."""
        found = [*self.workspace.text_documents, *(uris.from_fs_path(str(p)) or "" for p in self.files(uri))]
        for other in dict.fromkeys(found):
            if other != uri and any(name in self.text(other) for name in names):
                yield self.answers(other)

    def text(self, uri: str) -> str:
        """Return a text as it is open, else as the compiler reads its file: nothing where it cannot."""
        if uri in self.workspace.text_documents:
            return self.workspace.get_text_document(uri).source
        try:
            return read_source(path_of(uri)).text
        except ModelError:
            return ""

    def files(self, uri: str | None = None) -> Iterator[Path]:
        """Yield the files of the workspace, and those around a text in which classes are found."""
        root = self.workspace.root_path
        folders = {Path(path_of(f)) for f in self.workspace.folders} or ({Path(root)} if root else set())
        for folder in sorted(folders):
            yield from (p for p in sorted(folder.rglob("*")) if p.suffix in SUFFIXES)
        if uri is not None and Path(path_of(uri)).parent.is_dir():
            around = top_folder(Path(path_of(uri)), self.reading(uri).file)
            yield from (p for p in sorted(around.glob("*")) if p.suffix in SUFFIXES)
            for folder in (p for p in sorted(around.glob("*")) if package_file(p) is not None):
                yield from (p for p in sorted(folder.rglob("*")) if p.suffix in SUFFIXES)

    def deliver(self, request: Request, checked: Checked) -> None:
        """Send the diagnostics of a text."""
        uri = uris.from_fs_path(request.path) or request.path
        source = Source(request.path, request.text)
        self.checked[uri] = request.text, checked
        said = [diagnostic(source, f) for f in checked.findings]
        self.text_document_publish_diagnostics(lsp.PublishDiagnosticsParams(uri, said, request.version))
        able = self.client_capabilities.workspace
        if able is not None and able.inlay_hint is not None and able.inlay_hint.refresh_support:
            self.workspace_inlay_hint_refresh(None)


def _settle() -> None:
    gc.collect()
    gc.freeze()


def path_of(uri: str) -> str:
    """Return the path of a file; of a text that is in none yet, a name for it."""
    return uris.to_fs_path(uri) or uri.rpartition("/")[2] or "untitled.lmo"


def diagnostic(source: Source, f: Finding) -> lsp.Diagnostic:
    """Return what a check has found as the protocol has it."""
    here = f.place is not None and f.place.file == source.name
    range_ = span_range(Span(source, f.place.start, f.place.end)) if here and f.place else _first_line()
    lines = [f.message]
    lines += [
        f"{title}: {text}" for title, text in (("expected", f.expected), ("found", f.found), ("hint", f.hint)) if text
    ]
    if f.place is not None and not here:
        lines[0] = f"{f.place.file}: {f.message}"
    related = [
        lsp.DiagnosticRelatedInformation(
            lsp.Location(uris.from_fs_path(p.file) or p.file, span_range(Span(source, p.start, p.end))), text
        )
        for p, text in f.labels
        if p.file == source.name
    ]
    return lsp.Diagnostic(range_, "\n".join(lines), _SEVERITY[f.severity], f.code, source="lmoc",
                          related_information=related or None)  # fmt: skip


def _first_line() -> lsp.Range:
    return lsp.Range(lsp.Position(0, 0), lsp.Position(0, 0))
