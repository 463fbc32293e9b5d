"""The language server: `lmoc lsp` speaks the Language Server Protocol (3.17) with an editor.

Whatever is asked while a person types is answered from the tree of the text as it stands; only diagnostics come from a
process of their own (`background.py`) when they are ready.
"""

from __future__ import annotations

import os
import sys
from functools import lru_cache, partial
from itertools import islice

from lsprotocol import types as lsp
from pygls import uris

from lmoc.editor import colours, describe, hints, navigation, outline
from lmoc.editor.background import Request
from lmoc.editor.commands import COMMANDS
from lmoc.editor.completion import proposals, signature
from lmoc.editor.fixes import fixes
from lmoc.editor.names import at, occurrences
from lmoc.editor.positions import offset, position, span_range
from lmoc.editor.rename import RenameRefused, renamable
from lmoc.editor.rename import rename as renamed
from lmoc.editor.session import Server, diagnostic, path_of
from lmoc.messages.source import Span

_MOST_FILES = 300  # of a workspace whose symbols are listed
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
server = Server()
feature = server.feature


@feature(lsp.TEXT_DOCUMENT_DID_OPEN)
def did_open(ls: Server, params: lsp.DidOpenTextDocumentParams) -> None:
    d = params.text_document
    ls.hold(d.uri)
    ls.settle_later()
    ls.checker.ask(Request(path_of(d.uri), d.text, d.version))


@feature(lsp.TEXT_DOCUMENT_DID_CHANGE)
def did_change(ls: Server, params: lsp.DidChangeTextDocumentParams) -> None:
    d = ls.workspace.get_text_document(params.text_document.uri)
    ls.hold(d.uri)
    ls.checker.ask(Request(path_of(d.uri), d.source, d.version))


@feature(lsp.TEXT_DOCUMENT_DID_SAVE)
def did_save(ls: Server, params: lsp.DidSaveTextDocumentParams) -> None:
    """Check the other open texts again: they may use what has been saved."""
    _read_again(ls)


@feature(lsp.WORKSPACE_DID_CHANGE_WATCHED_FILES)
def did_change_files(ls: Server, params: lsp.DidChangeWatchedFilesParams) -> None:
    """Files have been changed by something else: check the open texts again."""
    _read_again(ls)


@feature(lsp.INITIALIZED)
def watch(ls: Server, params: lsp.InitializedParams) -> None:
    """Have the editor say when files change."""
    able = ls.client_capabilities.workspace
    if able is not None and able.did_change_watched_files and able.did_change_watched_files.dynamic_registration:
        watched = lsp.FileSystemWatcher("**/*.{lmo,mo,order}")
        options = lsp.DidChangeWatchedFilesRegistrationOptions([watched])
        one = lsp.Registration("files", lsp.WORKSPACE_DID_CHANGE_WATCHED_FILES, options)
        ls.client_register_capability(lsp.RegistrationParams([one]))


def _read_again(ls: Server) -> None:
    ls.read_again()
    for uri, d in ls.workspace.text_documents.items():
        ls.checker.ask(Request(path_of(uri), d.source, d.version))


@feature(lsp.TEXT_DOCUMENT_DID_CLOSE)
def did_close(ls: Server, params: lsp.DidCloseTextDocumentParams) -> None:
    uri = params.text_document.uri
    ls.hold(uri)
    ls.checker.forget(path_of(uri))
    ls.forget(uri)
    ls.text_document_publish_diagnostics(lsp.PublishDiagnosticsParams(uri, []))


@feature(lsp.SHUTDOWN)
def shutdown(ls: Server, *_: object) -> None:
    ls.end()


# ------------------------------------------------------------------ questions about a place


@feature(lsp.TEXT_DOCUMENT_HOVER)
def hover(ls: Server, params: lsp.HoverParams) -> lsp.Hover | None:
    analysis, place = ls.quick(params.text_document.uri, params.position)
    found = at(occurrences(analysis, place), place)
    if found is None:
        return None
    text = lsp.MarkupContent(lsp.MarkupKind.Markdown, describe.markdown(found))
    here = ls.reading(params.text_document.uri).here(Span(analysis.source, found.start, found.end))
    return lsp.Hover(text, None if here is None else span_range(here))


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


@feature(lsp.TEXT_DOCUMENT_DEFINITION)
def definition(ls: Server, params: lsp.DefinitionParams) -> lsp.Location | None:
    analysis, place = ls.quick(params.text_document.uri, params.position)
    found = at(occurrences(analysis, place), place)
    if found is None or found.declared is None:
        return None
    return _location(ls.reading(params.text_document.uri).here(found.declared) or found.declared)


@server.thread()
@feature(lsp.TEXT_DOCUMENT_REFERENCES)
def references(ls: Server, params: lsp.ReferenceParams) -> list[lsp.Location]:
    uri = params.text_document.uri
    with ls.answering:
        own = ls.answers(uri)
        declared = own.declared(offset(own.reading.source, params.position))
        if declared is None:
            return []
        texts = (own, *ls.others(uri, declared.words))
        found = [s for text in texts for s in text.places(declared.file, declared.start, declared.words)]
    if not params.context.include_declaration:
        found = [s for s in found if (s.source.name, s.start) != (declared.file, declared.start)]
    return [_location(s) for s in found]


@server.thread()
@feature(lsp.TEXT_DOCUMENT_DOCUMENT_HIGHLIGHT)
def highlights(ls: Server, params: lsp.DocumentHighlightParams) -> list[lsp.DocumentHighlight]:
    with ls.answering:
        answers = ls.answers(params.text_document.uri)
        declared = answers.declared(offset(answers.reading.source, params.position))
        found = [] if declared is None else answers.places(declared.file, declared.start, declared.words)
    return [lsp.DocumentHighlight(span_range(s)) for s in found]


@feature(lsp.TEXT_DOCUMENT_PREPARE_RENAME)
def prepare_rename(ls: Server, params: lsp.PrepareRenameParams) -> lsp.Range | None:
    analysis, place = ls.quick(params.text_document.uri, params.position)
    try:
        found, _ = renamable(at(occurrences(analysis, place), place), analysis.source)
    except RenameRefused:
        return None
    here = ls.reading(params.text_document.uri).here(Span(analysis.source, found.start, found.end))
    return None if here is None else span_range(here)


@server.thread()
@feature(lsp.TEXT_DOCUMENT_RENAME, lsp.RenameOptions(prepare_provider=True))
def rename(ls: Server, params: lsp.RenameParams) -> lsp.WorkspaceEdit | None:
    uri = params.text_document.uri
    with ls.answering:
        own = ls.answers(uri)
        place = offset(own.reading.source, params.position)
        try:
            spans = renamed(own, place, params.new_name, partial(ls.others, uri), _keywords())
        except RenameRefused as refused:
            ls.window_show_message(lsp.ShowMessageParams(lsp.MessageType.Warning, str(refused)))
            return None
    changes: dict[str, list[lsp.TextEdit]] = {}
    for s in spans:
        file = uris.from_fs_path(str(navigation.location(s))) or ""
        changes.setdefault(file, []).append(lsp.TextEdit(span_range(s), params.new_name))
    return lsp.WorkspaceEdit(changes=changes)


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
    with ls.answering:
        return [_symbol(s) for s in ls.answers(params.text_document.uri).symbols()]


def _symbol(s: outline.Symbol) -> lsp.DocumentSymbol:
    kind = _SYMBOLS.get(s.kind, lsp.SymbolKind.Class)
    return lsp.DocumentSymbol(s.name, kind, s.range, s.name_range, s.detail, children=[*map(_symbol, s.inside)])


@server.thread()
@feature(lsp.WORKSPACE_SYMBOL)
def workspace_symbols(ls: Server, params: lsp.WorkspaceSymbolParams) -> list[lsp.WorkspaceSymbol]:
    query = params.query.lower()
    found = []
    files = (uris.from_fs_path(str(p)) or "" for p in islice(ls.files(), _MOST_FILES))
    for uri in dict.fromkeys([*ls.workspace.text_documents, *files]):
        with ls.answering:
            symbols = [*ls.answers(uri).symbols()]
        for s in symbols:
            if query in s.name.lower():
                place = lsp.Location(uri, s.name_range)
                found.append(lsp.WorkspaceSymbol(place, s.name, _SYMBOLS.get(s.kind, lsp.SymbolKind.Class)))
    return found


@server.thread()
@feature(lsp.TEXT_DOCUMENT_FOLDING_RANGE)
def folding(ls: Server, params: lsp.FoldingRangeParams) -> list[lsp.FoldingRange]:
    with ls.answering:
        found = [*ls.answers(params.text_document.uri).folds()]
    kinds = {True: lsp.FoldingRangeKind.Comment, False: None}
    return [lsp.FoldingRange(first, last, kind=kinds[comment]) for first, last, comment in found]


@server.thread()
@feature(
    lsp.TEXT_DOCUMENT_SEMANTIC_TOKENS_FULL,
    lsp.SemanticTokensLegend(token_types=list(colours.TYPES), token_modifiers=list(colours.MODIFIERS)),
)
def semantic_tokens(ls: Server, params: lsp.SemanticTokensParams) -> lsp.SemanticTokens:
    with ls.answering:
        data = ls.answers(params.text_document.uri).tokens()
        return lsp.SemanticTokens(data, ls.said(params.text_document.uri, data))


@server.thread()
@feature(lsp.TEXT_DOCUMENT_SEMANTIC_TOKENS_FULL_DELTA)
def changed_semantic_tokens(
    ls: Server, params: lsp.SemanticTokensDeltaParams
) -> lsp.SemanticTokens | lsp.SemanticTokensDelta:
    uri = params.text_document.uri
    with ls.answering:
        data, before = ls.answers(uri).tokens(), ls.said_before(uri, params.previous_result_id)
        own = ls.said(uri, data)
    if before is None:
        return lsp.SemanticTokens(data, own)
    edits = [lsp.SemanticTokensEdit(*edit) for edit in colours.edits(before, data)]
    return lsp.SemanticTokensDelta(edits, own)


@server.thread()
@feature(lsp.TEXT_DOCUMENT_SEMANTIC_TOKENS_RANGE)
def some_semantic_tokens(ls: Server, params: lsp.SemanticTokensRangeParams) -> lsp.SemanticTokens:
    with ls.answering:
        tokens = ls.answers(params.text_document.uri).tokens(params.range.start.line, params.range.end.line)
    return lsp.SemanticTokens(tokens)


@feature(lsp.TEXT_DOCUMENT_FORMATTING)
def formatting(ls: Server, params: lsp.DocumentFormattingParams) -> list[lsp.TextEdit]:
    """The standard layout; nothing for a text with mistakes of the grammar, of which something would be lost."""
    with ls.answering:
        answers = ls.answers(params.text_document.uri)
        source, text = answers.reading.source, answers.formatted()
    whole = lsp.Range(lsp.Position(0, 0), position(source, len(source.text)))
    return [lsp.TextEdit(whole, text)] if text is not None and text != source.text else []


@server.thread()
@feature(lsp.TEXT_DOCUMENT_INLAY_HINT)
def inlay_hints(ls: Server, params: lsp.InlayHintParams) -> list[lsp.InlayHint]:
    uri, asked = params.text_document.uri, params.range
    _, checked = ls.checked.get(uri, ("", None))
    with ls.answering:
        answers = ls.answers(uri)
        found = [*answers.units(asked.start.line, asked.end.line)]
        found += [(r.end, text) for r, name in answers.models() if (text := hints.reduction(checked, name)) is not None]
    return [lsp.InlayHint(place, text) for place, text in found if asked.start <= place <= asked.end]


@server.thread()
@feature(lsp.TEXT_DOCUMENT_CODE_LENS)
def code_lenses(ls: Server, params: lsp.CodeLensParams) -> list[lsp.CodeLens]:
    uri = params.text_document.uri
    with ls.answering:
        found = [*ls.answers(uri).runnable()]
    return [
        lsp.CodeLens(place, lsp.Command(title, command=command, arguments=[uri, name]))
        for place, name in found for command, title in hints.COMMANDS
    ]  # fmt: skip


@feature(lsp.TEXT_DOCUMENT_CODE_ACTION, lsp.CodeActionOptions(code_action_kinds=[lsp.CodeActionKind.QuickFix]))
def code_actions(ls: Server, params: lsp.CodeActionParams) -> list[lsp.CodeAction]:
    uri = params.text_document.uri
    source = ls.reading(uri).source
    low, high = offset(source, params.range.start), offset(source, params.range.end)
    found = []
    text, checked = ls.checked.get(uri, ("", None))
    for f in checked.findings if checked is not None and text == source.text else ():  # else places would be others
        if f.place is None or f.place.file != source.name or not (f.place.start <= high and low <= f.place.end):
            continue
        for fix in fixes(f, source.text):
            edit = lsp.TextEdit(span_range(Span(source, fix.start, fix.end)), fix.text)
            found.append(
                lsp.CodeAction(
                    fix.title, lsp.CodeActionKind.QuickFix, diagnostics=[diagnostic(source, f)],
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
