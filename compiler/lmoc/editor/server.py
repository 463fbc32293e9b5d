"""The language server: `lmoc lsp` speaks the Language Server Protocol (3.17) with an editor.

Whatever is asked while a person types is answered from the tree of the text as it stands; only diagnostics come from a
process of their own (`background.py`) when they are ready.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

from lsprotocol import types as lsp
from pygls import uris
from pygls.lsp.server import LanguageServer

from lmoc.editor import colours, describe, hints, navigation, outline
from lmoc.editor.analysis import Analysis, analyse, with_change
from lmoc.editor.background import Checker, Request
from lmoc.editor.checking import Checked, Finding
from lmoc.editor.commands import COMMANDS
from lmoc.editor.completion import proposals, signature
from lmoc.editor.fixes import fixes
from lmoc.editor.names import at, occurrences
from lmoc.editor.navigation import Known, RenameRefused, known
from lmoc.editor.positions import offset, position, span_range
from lmoc.messages.diagnostics import ModelError
from lmoc.messages.source import Source, Span
from lmoc.support.version import __version__

_SUFFIXES = (".lmo", ".mo")
_MOST_FILES = 300  # of a workspace that are searched for a name
_KINDS = {
    "component": lsp.CompletionItemKind.Variable, "parameter": lsp.CompletionItemKind.Property,
    "port": lsp.CompletionItemKind.Interface, "class": lsp.CompletionItemKind.Class,
    "package": lsp.CompletionItemKind.Module, "function": lsp.CompletionItemKind.Function,
    "type": lsp.CompletionItemKind.TypeParameter, "attribute": lsp.CompletionItemKind.Field,
    "keyword": lsp.CompletionItemKind.Keyword, "literal": lsp.CompletionItemKind.EnumMember,
}  # fmt: skip
_SYMBOLS = {
    "package": lsp.SymbolKind.Package, "function": lsp.SymbolKind.Function, "connector": lsp.SymbolKind.Interface,
    "record": lsp.SymbolKind.Struct, "type": lsp.SymbolKind.TypeParameter, "parameter": lsp.SymbolKind.Property,
    "constant": lsp.SymbolKind.Constant, "component": lsp.SymbolKind.Field, "discrete": lsp.SymbolKind.Field,
}  # fmt: skip
_SEVERITY = {
    "error": lsp.DiagnosticSeverity.Error, "warning": lsp.DiagnosticSeverity.Warning,
    "note": lsp.DiagnosticSeverity.Information,
}  # fmt: skip


class Server(LanguageServer):
    """The texts that are open, and what is known of them."""

    def __init__(self) -> None:
        super().__init__("lmoc", __version__)
        self.known: dict[str, tuple[str, Known]] = {}  # {uri: (text, what is known of it)}
        self.checked: dict[str, Checked] = {}
        self._checker: Checker | None = None
        self._lock = threading.Lock()

    @property
    def checker(self) -> Checker:
        """The process that checks; begun with the first text."""
        if self._checker is None:
            self._checker = Checker(self.deliver)
        return self._checker

    def end(self) -> None:
        """End the process that checks."""
        if self._checker is not None:
            self._checker.close()

    def of(self, uri: str) -> Known:
        """Return all that is known of a text, open or on the disk, as it stands now."""
        text = self.workspace.get_text_document(uri).source
        with self._lock:
            kept = self.known.get(uri)
            if kept is None or kept[0] != text:
                kept = self.known[uri] = text, known(analyse(text, path_of(uri)))
            return kept[1]

    def quick(self, uri: str, place: lsp.Position) -> tuple[Analysis, int]:
        """Return what is known of an open text around a place, and the character there.

        Where the text has been changed since all of it was read, and the place is where it has been, only that part is.
        """
        text = self.workspace.get_text_document(uri).source
        kept = self.known.get(uri)
        found = None if kept is None or kept[0] == text else with_change(kept[1].analysis, text)
        if found is not None:
            at = offset(found.source, place)
            if found.known.start <= at and (at < found.known.end or found.known.end == len(text)):
                return found, at
        whole = self.of(uri).analysis
        return whole, offset(whole.source, place)

    def others(self, uri: str, name: str) -> Iterator[Known]:
        """Yield what is known of the other texts of the workspace in which a name occurs."""
        seen = {uri}
        for other in [*self.workspace.text_documents]:
            if other not in seen and name in self.workspace.get_text_document(other).source:
                seen.add(other)
                yield self.of(other)
        for path in self._files():
            other = uris.from_fs_path(str(path)) or ""
            if other not in seen and name in path.read_text("utf-8", "replace"):
                seen.add(other)
                yield self.of(other)

    def _files(self) -> list[Path]:
        folders = [Path(path_of(f)) for f in self.workspace.folders] or [
            Path(p) for p in [self.workspace.root_path] if p
        ]
        found = (p for folder in folders for suffix in _SUFFIXES for p in sorted(folder.rglob(f"*{suffix}")))
        return [p for p, _ in zip(found, range(_MOST_FILES), strict=False)]

    def deliver(self, request: Request, checked: Checked) -> None:
        """Send the diagnostics of a text."""
        uri = uris.from_fs_path(request.path) or request.path
        source = Source(request.path, request.text)
        self.checked[uri] = checked
        said = [_diagnostic(source, f) for f in checked.findings]
        self.text_document_publish_diagnostics(lsp.PublishDiagnosticsParams(uri, said, request.version))
        able = self.client_capabilities.workspace
        if able is not None and able.inlay_hint is not None and able.inlay_hint.refresh_support:
            self.workspace_inlay_hint_refresh(None)


def path_of(uri: str) -> str:
    """Return the path of a file; of a text that is in none yet, a name for it."""
    return uris.to_fs_path(uri) or uri.rpartition("/")[2] or "untitled.lmo"


server = Server()
feature = server.feature


@feature(lsp.TEXT_DOCUMENT_DID_OPEN)
def did_open(ls: Server, params: lsp.DidOpenTextDocumentParams) -> None:
    d = params.text_document
    ls.checker.ask(Request(path_of(d.uri), d.text, d.version))


@feature(lsp.TEXT_DOCUMENT_DID_CHANGE)
def did_change(ls: Server, params: lsp.DidChangeTextDocumentParams) -> None:
    d = ls.workspace.get_text_document(params.text_document.uri)
    ls.checker.ask(Request(path_of(d.uri), d.source, d.version))


@feature(lsp.TEXT_DOCUMENT_DID_SAVE)
def did_save(ls: Server, params: lsp.DidSaveTextDocumentParams) -> None:
    """Check the other open texts again: they may use what has been saved."""
    for uri, d in ls.workspace.text_documents.items():
        ls.known.pop(uri, None)
        ls.checker.ask(Request(path_of(uri), d.source, d.version))


@feature(lsp.TEXT_DOCUMENT_DID_CLOSE)
def did_close(ls: Server, params: lsp.DidCloseTextDocumentParams) -> None:
    uri = params.text_document.uri
    ls.checker.forget(path_of(uri))
    ls.known.pop(uri, None)
    ls.checked.pop(uri, None)
    ls.text_document_publish_diagnostics(lsp.PublishDiagnosticsParams(uri, []))


@feature(lsp.SHUTDOWN)
def shutdown(ls: Server, *_: object) -> None:
    ls.end()


def _diagnostic(source: Source, f: Finding) -> lsp.Diagnostic:
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


# ------------------------------------------------------------------ questions about a place


@feature(lsp.TEXT_DOCUMENT_HOVER)
def hover(ls: Server, params: lsp.HoverParams) -> lsp.Hover | None:
    analysis, place = ls.quick(params.text_document.uri, params.position)
    source = analysis.source
    found = at(occurrences(analysis, place), place)
    if found is None:
        return None
    text = lsp.MarkupContent(lsp.MarkupKind.Markdown, describe.markdown(found))
    return lsp.Hover(text, span_range(Span(source, found.start, found.end)))


@feature(lsp.TEXT_DOCUMENT_COMPLETION, lsp.CompletionOptions(trigger_characters=[".", "("]))
def completion(ls: Server, params: lsp.CompletionParams) -> lsp.CompletionList:
    found = proposals(*ls.quick(params.text_document.uri, params.position))
    items = [
        lsp.CompletionItem(
            p.name, kind=_KINDS[p.kind], detail=p.detail or None, documentation=p.documentation or None,
            insert_text=p.text or None, sort_text=f"{k:05}",
        )
        for k, p in enumerate(found)
    ]  # fmt: skip
    return lsp.CompletionList(False, items)


@feature(lsp.TEXT_DOCUMENT_SIGNATURE_HELP, lsp.SignatureHelpOptions(trigger_characters=["(", ","]))
def signature_help(ls: Server, params: lsp.SignatureHelpParams) -> lsp.SignatureHelp | None:
    found = signature(*ls.quick(params.text_document.uri, params.position))
    if found is None:
        return None
    parameters = [lsp.ParameterInformation(name, text or None) for name, text in found.parameters]
    one = lsp.SignatureInformation(found.label, found.documentation or None, parameters)
    return lsp.SignatureHelp([one], 0, min(found.active, max(0, len(parameters) - 1)))


@server.thread()
@feature(lsp.TEXT_DOCUMENT_DEFINITION)
def definition(ls: Server, params: lsp.DefinitionParams) -> lsp.Location | None:
    own = ls.of(params.text_document.uri)
    found = navigation.definition(own, offset(own.analysis.source, params.position))
    return None if found is None else _location(found)


@server.thread()
@feature(lsp.TEXT_DOCUMENT_REFERENCES)
def references(ls: Server, params: lsp.ReferenceParams) -> list[lsp.Location]:
    own = ls.of(params.text_document.uri)
    place = offset(own.analysis.source, params.position)
    found = navigation.references(own, place, ls.others(params.text_document.uri, _word(own, place)))
    declared = navigation.definition(own, place)
    if not params.context.include_declaration and declared is not None:
        found = [s for s in found if (s.source.name, s.start) != (declared.source.name, declared.start)]
    return [_location(s) for s in found]


@server.thread()
@feature(lsp.TEXT_DOCUMENT_DOCUMENT_HIGHLIGHT)
def highlights(ls: Server, params: lsp.DocumentHighlightParams) -> list[lsp.DocumentHighlight]:
    own = ls.of(params.text_document.uri)
    found = navigation.references(own, offset(own.analysis.source, params.position), ())
    return [lsp.DocumentHighlight(span_range(s)) for s in found]


@feature(lsp.TEXT_DOCUMENT_PREPARE_RENAME)
def prepare_rename(ls: Server, params: lsp.PrepareRenameParams) -> lsp.Range | None:
    own = ls.of(params.text_document.uri)
    found = at(own.names, offset(own.analysis.source, params.position))
    if found is None or found.declared is None or found.declared.source.name.startswith(navigation.LIBRARY):
        return None
    return span_range(Span(own.analysis.source, found.start, found.end))


@feature(lsp.TEXT_DOCUMENT_RENAME, lsp.RenameOptions(prepare_provider=True))
def rename(ls: Server, params: lsp.RenameParams) -> lsp.WorkspaceEdit | None:
    own = ls.of(params.text_document.uri)
    place = offset(own.analysis.source, params.position)
    others = ls.others(params.text_document.uri, _word(own, place))
    try:
        spans = navigation.rename(own, place, params.new_name, others, _keywords())
    except RenameRefused as refused:
        ls.window_show_message(lsp.ShowMessageParams(lsp.MessageType.Warning, str(refused)))
        return None
    changes: dict[str, list[lsp.TextEdit]] = {}
    for s in spans:
        uri = uris.from_fs_path(str(navigation.location(s))) or ""
        changes.setdefault(uri, []).append(lsp.TextEdit(span_range(s), params.new_name))
    return lsp.WorkspaceEdit(changes=changes)


def _word(own: Known, place: int) -> str:
    found = at(own.names, place)
    return own.analysis.source.text[found.start : found.end] if found is not None else "\0"


@lru_cache(maxsize=1)
def _keywords() -> frozenset[str]:
    from lmoc.syntax.tables import load

    return frozenset(word for word in load().literals if word.isidentifier())


def _location(span: Span) -> lsp.Location:
    return lsp.Location(uris.from_fs_path(str(navigation.location(span).absolute())) or "", span_range(span))


# ------------------------------------------------------------------ the whole text


@server.thread()
@feature(lsp.TEXT_DOCUMENT_DOCUMENT_SYMBOL)
def document_symbols(ls: Server, params: lsp.DocumentSymbolParams) -> list[lsp.DocumentSymbol]:
    return [_symbol(s) for s in outline.symbols(ls.of(params.text_document.uri).analysis)]


def _symbol(s: outline.Symbol) -> lsp.DocumentSymbol:
    kind = _SYMBOLS.get(s.kind, lsp.SymbolKind.Class)
    return lsp.DocumentSymbol(
        s.name, kind, span_range(s.span), span_range(s.name_span), s.detail, children=[_symbol(i) for i in s.inside]
    )


@server.thread()
@feature(lsp.WORKSPACE_SYMBOL)
def workspace_symbols(ls: Server, params: lsp.WorkspaceSymbolParams) -> list[lsp.WorkspaceSymbol]:
    query = params.query.lower()
    open_texts = {uri: ls.of(uri) for uri in ls.workspace.text_documents}
    files = {uris.from_fs_path(str(p)) or "": p for p in ls._files()}
    found = []
    for uri in dict.fromkeys([*open_texts, *files]):
        own = open_texts.get(uri) or ls.of(uri)
        for s in outline.symbols(own.analysis):
            if query in s.name.lower():
                place = lsp.Location(uri, span_range(s.name_span))
                found.append(lsp.WorkspaceSymbol(place, s.name, _SYMBOLS.get(s.kind, lsp.SymbolKind.Class)))
    return found


@server.thread()
@feature(lsp.TEXT_DOCUMENT_FOLDING_RANGE)
def folding(ls: Server, params: lsp.FoldingRangeParams) -> list[lsp.FoldingRange]:
    found = []
    for span, comment in outline.folds(ls.of(params.text_document.uri).analysis):
        range_ = span_range(span)
        if range_.end.line > range_.start.line:
            kind = lsp.FoldingRangeKind.Comment if comment else None
            found.append(lsp.FoldingRange(range_.start.line, range_.end.line, kind=kind))
    return found


@server.thread()
@feature(
    lsp.TEXT_DOCUMENT_SEMANTIC_TOKENS_FULL,
    lsp.SemanticTokensLegend(token_types=list(colours.TYPES), token_modifiers=list(colours.MODIFIERS)),
)
def semantic_tokens(ls: Server, params: lsp.SemanticTokensParams) -> lsp.SemanticTokens:
    own = ls.of(params.text_document.uri)
    return lsp.SemanticTokens(colours.encoded(own.analysis.source, own.names))


@feature(lsp.TEXT_DOCUMENT_FORMATTING)
def formatting(ls: Server, params: lsp.DocumentFormattingParams) -> list[lsp.TextEdit]:
    """The standard layout; nothing for a text with mistakes of the grammar, of which something would be lost."""
    from lmoc.syntax.layout import formatted

    source = ls.of(params.text_document.uri).analysis.source
    try:
        text = formatted(source)
    except ModelError:
        return []
    whole = lsp.Range(lsp.Position(0, 0), position(source, len(source.text)))
    return [lsp.TextEdit(whole, text)] if text != source.text else []


@server.thread()
@feature(lsp.TEXT_DOCUMENT_INLAY_HINT)
def inlay_hints(ls: Server, params: lsp.InlayHintParams) -> list[lsp.InlayHint]:
    uri = params.text_document.uri
    own = ls.of(uri)
    source = own.analysis.source
    low, high = offset(source, params.range.start), offset(source, params.range.end)
    found = [*hints.units(own.analysis, own.names), *hints.reductions(own.analysis, ls.checked.get(uri))]
    return [lsp.InlayHint(position(source, h.at), h.text) for h in found if low <= h.at <= high]


@server.thread()
@feature(lsp.TEXT_DOCUMENT_CODE_LENS)
def code_lenses(ls: Server, params: lsp.CodeLensParams) -> list[lsp.CodeLens]:
    uri = params.text_document.uri
    found = []
    for d, name in hints.runnable(ls.of(uri).analysis):
        for command, title in hints.COMMANDS:
            action = lsp.Command(title, command=command, arguments=[uri, name])
            found.append(lsp.CodeLens(span_range(d.name_span), action))
    return found


@feature(lsp.TEXT_DOCUMENT_CODE_ACTION, lsp.CodeActionOptions(code_action_kinds=[lsp.CodeActionKind.QuickFix]))
def code_actions(ls: Server, params: lsp.CodeActionParams) -> list[lsp.CodeAction]:
    uri = params.text_document.uri
    source = ls.of(uri).analysis.source
    low, high = offset(source, params.range.start), offset(source, params.range.end)
    found = []
    checked = ls.checked.get(uri)
    for f in checked.findings if checked is not None else ():
        if f.place is None or f.place.file != source.name or not (f.place.start <= high and low <= f.place.end):
            continue
        for fix in fixes(f, source.text):
            edit = lsp.TextEdit(span_range(Span(source, fix.start, fix.end)), fix.text)
            found.append(
                lsp.CodeAction(
                    fix.title, lsp.CodeActionKind.QuickFix, diagnostics=[_diagnostic(source, f)],
                    edit=lsp.WorkspaceEdit(changes={uri: [edit]}),
                )
            )  # fmt: skip
    return found


def _register(name: str) -> None:
    run = COMMANDS[name]

    @server.thread()
    @server.command(name)
    def execute(ls: Server, uri: str, model: str | None = None) -> object:
        return run(ls.workspace.get_text_document(uri).source, path_of(uri), model)


for _name in COMMANDS:
    _register(_name)


def serve() -> None:
    """Speak with an editor over standard input and output until it says good-bye."""
    try:
        server.start_io()
    finally:
        server.end()
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115  the protocol has closed the other one
