"""Every program in ``tests/wrong`` gives the diagnostics that its comments name, and no others.

A line ``// expect: E0104 line 7 "some words" "more words"`` stands for one diagnostic: its code, the line of its place
(may be left out) and words that its text contains. Every error must be expected; warnings must be, where a warning
is. What has no syntax error goes through all stages up to the reduced system.
"""

import re
from pathlib import Path
from typing import NamedTuple

import pytest

from lmoc.messages.diagnostics import Diagnostic, ModelError, Report, render
from lmoc.messages.source import Source

PROGRAMS = sorted((Path(__file__).parents[1] / "wrong").glob("*.lmo"))


class Expected(NamedTuple):
    code: str
    line: int | None
    words: tuple[str, ...]

    def fits(self, d: Diagnostic) -> bool:
        place = self.line is None or (d.span is not None and d.span.line == self.line)
        return d.code == self.code and place and all(words in render(d) for words in self.words)


def expectations(text: str) -> list[Expected]:
    found = []
    for line in re.findall(r"^// expect: (.*)$", text, re.MULTILINE):
        head = re.match(r"([EWN]\d{4})(?: line (\d+))?", line)
        assert head, f"not an expectation: {line}"
        words = tuple(re.findall(r'"([^"]*)"', line[head.end() :]))
        found.append(Expected(head[1], int(head[2]) if head[2] else None, words))
    return found


def diagnose(source: Source) -> list[Diagnostic]:
    """All that the stages up to the reduced system say about a program."""
    from lmoc.syntax.parse import parse

    report = Report()
    file = parse(source, report)
    if report.errors:
        return report.diagnostics
    from lmoc.semantics.flatten import flatten
    from lmoc.sources.library import load
    from lmoc.structure.reduce import reduce

    try:
        flat = flatten([file], load(), None, {}, report)
        report.check()
        reduce(flat, report=report)
        report.check()
    except ModelError as error:
        known = {id(d) for d in error.diagnostics}
        return [*error.diagnostics, *(d for d in report.diagnostics if id(d) not in known)]
    return report.diagnostics


@pytest.mark.parametrize("path", PROGRAMS, ids=lambda path: path.stem)
def test_wrong_program(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    expected = expectations(text)
    assert expected, "the program says nothing about what is expected"
    found = diagnose(Source(path.name, text))
    shown = "\n\n".join(map(render, found))
    left = list(expected)
    for d in found:
        fitting = next((e for e in left if e.fits(d)), None)
        if fitting is not None:
            left.remove(fitting)
        elif d.severity == "error" or (d.severity == "warning" and any(e.code[0] == "W" for e in expected)):
            pytest.fail(f"not expected:\n{render(d)}\n\nall that was found:\n{shown}")
    assert not left, f"expected but not found: {left}\n\nfound:\n{shown}"
