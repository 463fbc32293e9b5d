"""Writes `docs/diagnostics.md`: the catalogue of diagnostics, with the messages that its examples get."""

from __future__ import annotations

from pathlib import Path

from lmoc.messages.catalogue import CATALOGUE
from lmoc.messages.diagnostics import Report, render
from lmoc.messages.source import Source
from lmoc.syntax.parse import parse

PAGE = Path(__file__).with_name("diagnostics.md")


def page() -> str:
    """The catalogue as a page of the documentation, with what is said about the examples."""
    lines = [
        "# Diagnostics",
        "",
        "Every error, warning and note of lmoc by its code; `lmoc explain CODE` shows an entry on the command line.",
        "This page is made by `docs/make_diagnostics.py`.",
        "",
    ]
    for code in sorted(CATALOGUE, key=lambda code: (code[1:], code[0])):
        entry = CATALOGUE[code]
        lines += [f"## {code}: {entry.title}", "", entry.explanation, ""]
        if entry.example:
            lines += ["```modelica", entry.example, "```", ""]
            lines += [line for shown in _said(entry.example) for line in ("```text", shown, "```", "")]
    return "\n".join(lines).rstrip() + "\n"


def _said(example: str) -> list[str]:
    """What the parser says about a program."""
    report = Report()
    parse(Source("example.lmo", example), report)
    return [render(d) for d in report.diagnostics]


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
