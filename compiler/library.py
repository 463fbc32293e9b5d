"""The library that comes with lmoc (``stdlib/*.lmo``), parsed."""

from __future__ import annotations

import os
from functools import cache as once

from lmoc.diagnostics import Report
from lmoc.source import Source
from lmoc.syntax import tree


@once
def load() -> tuple[tree.File, ...]:
    """All files of the library, in the order of their names.

    Raises
    ------
    ModelError
        If a file of the library has a syntax error.
    """
    report = Report()
    files = tuple(_parse(name, text, report) for name, text in _texts())
    report.check()
    return files


def _texts() -> list[tuple[str, str]]:
    import lmoc.stdlib

    folder = os.path.dirname(lmoc.stdlib.__file__)
    found = []
    for name in sorted(os.listdir(folder)):
        if name.endswith(".lmo"):
            with open(os.path.join(folder, name), encoding="utf-8") as file:
                found.append((name, file.read()))
    return found


def _parse(name: str, text: str, report: Report) -> tree.File:
    from lmoc.syntax.parse import parse

    return parse(Source(f"stdlib/{name}", text), report)
