"""A session with the language server, as an editor and a person have it."""

import asyncio
import sys
from pathlib import Path

import pytest

lsp = pytest.importorskip("lsprotocol.types")
pytest_lsp = pytest.importorskip("pytest_lsp")

PUBLISHED = "textDocument/publishDiagnostics"
TEXT = """model First "A mass between a wall and a spring"
  Fixed wall;
  Spring spring(k = 50, d0 = 0.2);
  Damper damper(c = 1);
  Mass mass(m = 2, q(start = 0.5, fixed = true));
  output Real x = mass.q "where the mass is";
equation
  connect(wall.flange, spring.a);
  connect(wall.flange, damper.a);
  connect(spring.b, mass.flange);
  connect(damper.b, mass.flange);
end First;
"""


@pytest_lsp.fixture(config=pytest_lsp.ClientServerConfig(server_command=[sys.executable, "-m", "lmoc", "lsp"]))
async def client(lsp_client: pytest_lsp.LanguageClient):
    encodings = lsp.GeneralClientCapabilities(position_encodings=["utf-8", "utf-16"])  # as Neovim has it
    able = lsp.ClientCapabilities(general=encodings)
    answer = await lsp_client.initialize_session(lsp.InitializeParams(able, root_uri=None))
    assert answer.capabilities.position_encoding == "utf-16"
    yield
    await lsp_client.shutdown_session()


class Text:
    """A text that is open in the editor."""

    def __init__(self, client, path: Path, text: str) -> None:
        self.client, self.uri, self.text, self.version = client, path.as_uri(), text, 1
        document = lsp.TextDocumentItem(self.uri, "lmo", 1, text)
        client.text_document_did_open(lsp.DidOpenTextDocumentParams(document))

    @property
    def id(self):
        return lsp.TextDocumentIdentifier(self.uri)

    def at(self, word: str, behind: bool = False, occurrence: int = 0):
        start = -1
        for _ in range(occurrence + 1):
            start = self.text.index(word, start + 1)
        before = self.text[: start + len(word) * behind]
        return lsp.Position(before.count("\n"), len(before) - before.rfind("\n") - 1)

    def replace(self, old: str, new: str) -> None:
        """Change a part of the text, as typing does."""
        start = self.at(old)
        end = self.at(old, behind=True)
        self.text = self.text.replace(old, new, 1)
        self.version += 1
        change = lsp.TextDocumentContentChangePartial(lsp.Range(start, end), new)
        own = lsp.VersionedTextDocumentIdentifier(self.version, self.uri)
        self.client.text_document_did_change(lsp.DidChangeTextDocumentParams(own, [change]))

    async def diagnostics(self):
        """Those of the newest text."""
        while True:
            said = await asyncio.wait_for(self.client.wait_for_notification(PUBLISHED), 120)
            if (said.uri, said.version) == (self.uri, self.version):
                return said.diagnostics


def changed(text: str, edit) -> str:
    """The text after a workspace edit of it."""
    lines = text.splitlines(keepends=True)
    for e in sorted(edit, key=lambda e: (e.range.start.line, e.range.start.character), reverse=True):
        first, last = e.range.start, e.range.end
        assert first.line == last.line
        line = lines[first.line]
        lines[first.line] = line[: first.character] + e.new_text + line[last.character :]
    return "".join(lines)


@pytest.mark.asyncio
async def test_a_session(client, tmp_path):
    text = Text(client, tmp_path / "first.lmo", TEXT)
    assert list(await text.diagnostics()) == []

    # what the model reduces to, and the units of its values
    whole = lsp.Range(lsp.Position(0, 0), lsp.Position(99, 0))
    hints = await client.text_document_inlay_hint_async(lsp.InlayHintParams(text.id, whole))
    assert {h.label for h in hints} >= {"  2 states", " N/m", " kg", " m"}

    # a slip, its diagnostic, and the fix
    text.replace("Damper damper(c", "Dampr damper(c")
    (found,) = [d for d in await text.diagnostics() if d.severity == lsp.DiagnosticSeverity.Error]
    assert found.code == "E0202" and "did you mean 'Damper'?" in found.message
    assert found.range == lsp.Range(text.at("Dampr"), text.at("Dampr", behind=True))
    context = lsp.CodeActionContext([found])
    (fix,) = await client.text_document_code_action_async(lsp.CodeActionParams(text.id, found.range, context))
    assert changed(text.text, fix.edit.changes[text.uri]) == TEXT
    text.replace("model First", "// moved\nmodel First")  # its places are others, until it is checked again
    for again in await client.text_document_code_action_async(lsp.CodeActionParams(text.id, found.range, context)):
        assert changed(text.text, again.edit.changes[text.uri]) == "// moved\n" + TEXT
    text.replace("// moved\n", "")
    text.replace("Dampr", "Damper")
    assert list(await text.diagnostics()) == []

    # half a line, as it is being typed
    text.replace("  Damper damper(c = 1);\n", "  Damper damper(c = 1);\n  Spring other(\n")
    waiting = asyncio.ensure_future(text.diagnostics())
    here = lsp.CompletionParams(text.id, text.at("other(", behind=True))
    names = [i.label for i in (await client.text_document_completion_async(here)).items]
    assert names[:3] == ["k", "L", "d0"]
    signature = await client.text_document_signature_help_async(lsp.SignatureHelpParams(text.id, here.position))
    assert signature.signatures[0].label == "Spring(k, L, d0)"
    assert any(d.severity == lsp.DiagnosticSeverity.Error for d in await waiting)


@pytest.mark.asyncio
async def test_questions_about_names(client, tmp_path):
    text = Text(client, tmp_path / "first.lmo", TEXT)

    hover = await client.text_document_hover_async(lsp.HoverParams(text.id, text.at("k = 50")))
    assert "N/m" in hover.contents.value and "stiffness" in hover.contents.value
    hover = await client.text_document_hover_async(lsp.HoverParams(text.id, text.at("damper(c")))
    assert "f = c*" in hover.contents.value

    own = await client.text_document_definition_async(lsp.DefinitionParams(text.id, text.at("mass.flange")))
    assert own.uri == text.uri and own.range.start == text.at("mass(m")
    library = await client.text_document_definition_async(lsp.DefinitionParams(text.id, text.at("Mass mass")))
    assert library.uri.endswith("stdlib/translational.lmo")
    line = Path(library.uri.removeprefix("file://")).read_text().splitlines()[library.range.start.line]
    assert line.startswith("model Mass ")

    places = await client.text_document_references_async(
        lsp.ReferenceParams(lsp.ReferenceContext(True), text.id, text.at("mass(m"))
    )
    assert len(places) == TEXT.count("mass.") + 1
    edit = await client.text_document_rename_async(lsp.RenameParams(text.id, text.at("mass.q"), "body"))
    new = changed(TEXT, edit.changes[text.uri])
    assert new == TEXT.replace("mass.", "body.").replace("mass(m", "body(m")
    library_class = lsp.PrepareRenameParams(text.id, text.at("Mass mass"))
    assert await client.text_document_prepare_rename_async(library_class) is None
    assert await client.text_document_rename_async(lsp.RenameParams(text.id, text.at("mass.q"), "2x")) is None

    async def offered(word: str) -> list[str]:
        here = lsp.CompletionParams(text.id, text.at(word, behind=True))
        return [i.label for i in (await client.text_document_completion_async(here)).items]

    assert "flange" in await offered("wall.")
    assert {"mass", "spring", "sin", "First"} - set(await offered("Real x = ")) == {"First"}  # a model is no value
    types = await offered("where the mass is\";\n")
    assert "Spring" in types and "TwoFlanges" not in types  # that is partial
    text.replace("equation\n", "equation\n  for part in 1:3 loop\n    x = 2;\n  end for;\n")
    assert "part" in await offered("x = 2")


@pytest.mark.asyncio
async def test_the_whole_text(client, tmp_path):
    text = Text(client, tmp_path / "first.lmo", TEXT.replace("  Fixed", " Fixed"))
    (model,) = await client.text_document_document_symbol_async(lsp.DocumentSymbolParams(text.id))
    assert (model.name, [c.name for c in model.children]) == ("First", ["wall", "spring", "damper", "mass", "x"])
    folds = await client.text_document_folding_range_async(lsp.FoldingRangeParams(text.id))
    assert [(f.start_line, f.end_line) for f in folds] == [(0, 11)]
    tokens = await client.text_document_semantic_tokens_full_async(lsp.SemanticTokensParams(text.id))
    assert len(tokens.data) % 5 == 0 and len(tokens.data) > 100
    lines = lsp.Range(lsp.Position(2, 0), lsp.Position(4, 0))
    some = await client.text_document_semantic_tokens_range_async(lsp.SemanticTokensRangeParams(text.id, lines))
    assert some.data == tokens.data  # those of the class
    text.replace("Damper damper", "\n  Damper  damper")
    changes = lsp.SemanticTokensDeltaParams(text.id, tokens.result_id)
    (edit,) = (await client.text_document_semantic_tokens_full_delta_async(changes)).edits
    assert edit.delete_count == len(edit.data) < 10
    data = [*tokens.data[: edit.start], *edit.data, *tokens.data[edit.start + edit.delete_count :]]
    whole = await client.text_document_semantic_tokens_full_async(lsp.SemanticTokensParams(text.id))
    assert data == list(whole.data)
    text.replace("\n  Damper  damper", "Damper damper")
    places = lsp.DocumentHighlightParams(text.id, text.at("mass.q"))
    assert len(await client.text_document_document_highlight_async(places)) == TEXT.count("mass.") + 1
    options = lsp.FormattingOptions(2, True)
    (edit,) = await client.text_document_formatting_async(lsp.DocumentFormattingParams(text.id, options))
    assert edit.new_text == TEXT
    lenses = await client.text_document_code_lens_async(lsp.CodeLensParams(text.id))
    assert [x.command.title for x in lenses] == ["run", "draw", "view", "equations"]
    found = {}
    for lens in (lenses[0], lenses[1], lenses[3]):
        params = lsp.ExecuteCommandParams(lens.command.command, lens.command.arguments)
        found[lens.command.title] = await client.workspace_execute_command_async(params)
    assert found["run"]["kind"] == "text" and "2 states" in found["run"]["content"]
    assert found["draw"]["content"].startswith("<svg")
    assert found["equations"]["content"].startswith("m·ẍ + c·ẋ + k·x = d0·k\n")


@pytest.mark.asyncio
async def test_names_of_other_files_of_the_folder(client, tmp_path):
    (tmp_path / "Part.lmo").write_text('model Part "of another file"\n  parameter Real size = 1;\nend Part;\n')
    scene = "model Scene\n  Part part(size = 2);\n  Real x = part.size;\nend Scene;\n"
    text = Text(client, tmp_path / "scene.lmo", scene)
    assert list(await text.diagnostics()) == []
    found = await client.text_document_definition_async(lsp.DefinitionParams(text.id, text.at("size = 2")))
    assert found.uri == (tmp_path / "Part.lmo").as_uri() and found.range.start.line == 1

    # what is open counts, saved or not; and files of the folder are searched, although no workspace is open
    part = Text(client, tmp_path / "Part.lmo", (tmp_path / "Part.lmo").read_text())
    part.replace("model Part", "// a part\nmodel Part")
    found = await client.text_document_definition_async(lsp.DefinitionParams(text.id, text.at("size = 2")))
    assert found.range.start == part.at("size")
    edit = await client.text_document_rename_async(lsp.RenameParams(part.id, part.at("size"), "length"))
    assert changed(part.text, edit.changes[part.uri]) == part.text.replace("size", "length")
    assert changed(scene, edit.changes[text.uri]) == scene.replace("size", "length")
    assert await client.text_document_rename_async(lsp.RenameParams(part.id, part.at("Part"), "Piece")) is None

    # a file changes on the disk
    client.text_document_did_close(lsp.DidCloseTextDocumentParams(part.id))
    (tmp_path / "Part.lmo").write_text("\n\n\nmodel Part\n  parameter Real size = 1;\nend Part;\n")
    event = lsp.FileEvent(part.uri, lsp.FileChangeType.Changed)
    client.workspace_did_change_watched_files(lsp.DidChangeWatchedFilesParams([event]))
    found = await client.text_document_definition_async(lsp.DefinitionParams(text.id, text.at("size = 2")))
    assert found.range.start.line == 4
