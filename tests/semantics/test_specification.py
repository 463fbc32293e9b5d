"""One construct a program, over the clauses of the Modelica specification 3.6: each right, or refused by its name.

The programs stand in `tests/data/specification`, one a line (continued on indented lines)::

    clause | expectation | program

The expectation is ``y = 2``, at the start, ``y(1) = 2``, at 1 s, several joined by ``;``, the code of the first
error, or ``stopped`` for a run that does not reach its end. A program that does not end with a class is the
body of a model.
"""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import lmoc

FOLDER = Path(__file__).parent.parent / "data" / "specification"
_CLASS = re.compile(r"end (?!when|for|if|while)\w+;$")
_VALUE = re.compile(r"([\w.\[\],']+?)(?:\((\S+?)\))? = (\S+)")


def programs() -> Iterator[tuple[str, str, str]]:
    """(clause, expectation, text) of each program."""
    for path in sorted(FOLDER.glob("*.txt")):
        joined = re.sub(r"\n[ \t]+", " ", path.read_text(encoding="utf-8"))
        for line in joined.splitlines():
            if line.strip() and not line.startswith("#"):
                clause, expected, text = line.split(" | ", 2)
                yield clause.strip(), expected.strip(), text.strip()


@pytest.mark.parametrize(("clause", "expected", "text"), list(programs()), ids=[p[0] for p in programs()])
def test_a_construct(clause: str, expected: str, text: str) -> None:
    if not _CLASS.search(text):
        text = f"model M {text} end M;"
    if re.fullmatch(r"E\d{4}|stopped", expected):
        with pytest.raises((lmoc.ModelError, lmoc.SimulationError)) as raised:
            lmoc.compile_text(text).simulate(times=[0.0, 1.0], energy=False)
        found = getattr(raised.value, "diagnostics", ())
        assert next((d.code for d in found if d.severity == "error"), "stopped") == expected, clause
        return
    wanted = [match.groups() for match in map(_VALUE.fullmatch, expected.split("; "))]
    times = sorted({0.0, *(float(at or 0) for _, at, _ in wanted)})
    run = lmoc.compile_text(text).simulate(times=times, energy=False)
    for name, at, value in wanted:
        number = {"true": 1.0, "false": 0.0}.get(value)
        found = float(run[name][times.index(float(at or 0))])
        assert found == pytest.approx(float(value) if number is None else number, abs=1e-6, rel=1e-5), clause


def test_the_page_is_made_of_these_programs() -> None:
    root = FOLDER.parent.parent.parent
    spec = importlib.util.spec_from_file_location("make_modelica", root / "docs" / "make_modelica.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert (root / "docs" / "modelica.md").read_text(encoding="utf-8") == module.page(), "python docs/make_modelica.py"
