"""What the page of the language shows is understood, and its first program runs."""

import re
from pathlib import Path

import pytest

from lmoc.messages.diagnostics import Report, render
from lmoc.messages.source import Source
from lmoc.syntax.lexer import scan
from lmoc.syntax.parse import parse
from lmoc.syntax.tables import load
from lmoc.syntax.words import is_word

PAGE = (Path(__file__).parents[2] / "docs" / "language.md").read_text(encoding="utf-8")
BLOCKS = [block for block in re.findall(r"```modelica\n(.*?)```", PAGE, re.DOTALL) if "…" not in block]


def whole(block: str) -> str:
    """A program around what a block shows."""
    if re.search(r"^end \w+;", block, re.MULTILINE):
        return block
    return f"model Shown\n{block}end Shown;\n"


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: block.split("\n")[0][:30])
def test_what_is_shown_is_understood(block: str) -> None:
    report = Report()
    parse(Source("language.md", whole(block)), report)
    assert not report.diagnostics, "\n".join(map(render, report.diagnostics))


def test_the_first_program_runs() -> None:
    import lmoc

    dae = lmoc.compile_text(BLOCKS[0], "language.md")
    assert sorted(dae.outputs) == ["q"] and len(dae.states) == 2


def test_the_keywords() -> None:
    listed = re.search(r"\*\*Keywords\*\* cannot be names: `(.*?)`", PAGE, re.DOTALL)
    assert sorted(listed[1].split()) == sorted(filter(is_word, load().literals))


def test_no_keyword_can_be_a_name() -> None:
    for word in filter(is_word, load().literals):
        tokens, _ = scan(Source("name.lmo", word), load())
        assert tokens.symbols[0] == word
