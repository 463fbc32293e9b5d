"""The catalogue of diagnostics is complete, its examples are what they say, and its page is up to date."""

import importlib.util
import re
from pathlib import Path

import pytest

from lmoc.messages.catalogue import CATALOGUE
from lmoc.messages.diagnostics import Report
from lmoc.messages.source import Source
from lmoc.syntax.parse import parse

ROOT = Path(__file__).parents[2]
_CODE = re.compile(r"\"([EWN]\d{4})\"")


def used_codes() -> set[str]:
    """The codes that the program can give."""
    found: set[str] = set()
    for path in (ROOT / "compiler").rglob("*.py"):
        if path.parent.name != "catalogue":
            found |= set(_CODE.findall(path.read_text(encoding="utf-8")))
    return found


def test_every_code_has_an_entry() -> None:
    assert sorted(used_codes() - CATALOGUE.keys()) == []


def test_every_entry_is_of_use() -> None:
    assert sorted(CATALOGUE.keys() - used_codes()) == []


@pytest.mark.parametrize("code", sorted(code for code in CATALOGUE if code[1:3] == "01"))
def test_the_example_of_a_syntax_error(code: str) -> None:
    report = Report()
    parse(Source("example.lmo", CATALOGUE[code].example), report)
    assert [d.code for d in report.diagnostics] == [code]


def test_the_page() -> None:
    spec = importlib.util.spec_from_file_location("make_diagnostics", ROOT / "docs/make_diagnostics.py")
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    shown = (ROOT / "docs" / "diagnostics.md").read_text(encoding="utf-8")
    assert shown == made.page(), "run: make docs"
