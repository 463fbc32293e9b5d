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

import pytest
from conftest import ROOT

import lmoc

_CLASS = re.compile(r"end (?!when|for|if|while)\w+;$")
_VALUE = re.compile(r"([\w.\[\],']+?)(?:\((\S+?)\))? = (\S+)")


def _page():
    """The script that writes the page: it reads the programs."""
    spec = importlib.util.spec_from_file_location("make_modelica", ROOT / "docs" / "make_modelica.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


PAGE = _page()
PROGRAMS = [(f"{clause} {construct}", expected, text) for clause, construct, expected, text in PAGE.programs()]


@pytest.mark.parametrize(("clause", "expected", "text"), PROGRAMS, ids=[p[0] for p in PROGRAMS])
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
    assert (ROOT / "docs" / "modelica.md").read_text(encoding="utf-8") == PAGE.page(), "python docs/make_modelica.py"
