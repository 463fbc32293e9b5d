"""Elements of Modelica's library that are written in lmo here (``stdlib/modelica.mo``), under the same names.

What the library leaves to C, or to loops over values that change, stands in the place of its own text.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from functools import cache

from lmoc.messages.diagnostics import Report
from lmoc.messages.source import Source
from lmoc.sources.kept import kept
from lmoc.syntax import tree

# without their packages
NAMES = frozenset(
    ("interpolate", "TimeTable", "CombiTimeTable", "CombiTable1Ds", "CombiTable1Dv",
     "random", "automaticGlobalSeed", "initializeImpureRandom", "impureRandom", "hashString", "length", "substring",
     "error", "dgesv", "dgesv_vec", "dgglse_vec")
)  # fmt: skip


def native(full_name: str) -> tree.Class | None:
    """Return the definition that stands in the place of a class, None where there is none."""
    return _definitions().get(full_name)


@cache
def _definitions() -> Mapping[str, tree.Class]:
    import lmoc.stdlib

    path, name = os.path.join(os.path.dirname(lmoc.stdlib.__file__), "modelica.mo"), "stdlib/modelica.mo"
    with open(path, encoding="utf-8") as file:
        text = file.read()
    return dict(_inside("", kept("library-modelica", (name, text), lambda: _parse(Source(name, text))).classes))


def _parse(source: Source) -> tree.File:
    from lmoc.syntax.parse import parse

    report = Report()
    parsed = parse(source, report)
    report.check()
    return parsed


def _inside(prefix: str, classes: Iterable[tree.Class]) -> Iterator[tuple[str, tree.Class]]:
    for definition in classes:
        name = f"{prefix}{definition.name}"
        if definition.kind == "package":
            yield from _inside(f"{name}.", (e for e in definition.elements if isinstance(e, tree.Class)))
        else:
            yield name, definition
