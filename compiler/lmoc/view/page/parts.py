"""What a page says of the parts in its picture: class, description, and equations as they are written."""

from __future__ import annotations

from collections.abc import Iterable
from math import prod
from typing import Any

from lmoc.ir.flat import FlatDAE
from lmoc.ir.paths import dims_of, element_name
from lmoc.report.result import Result

MOST_PARTS = 200
MOST_EQUATIONS = 12
OWN = ("equation", "binding", "law", "argument")  # origins of the equations that a part's text holds
OF_THE_LEDGER = ("energy", "loss", "power")  # variables that the equations of motion do without


def parts_data(run: Result, names: Iterable[str]) -> list[dict[str, Any]]:
    """Return {name, class, text, equations} of the named parts, each once."""
    flat = run.reduced.lawful or run.flat
    wanted = list(dict.fromkeys(names))[:MOST_PARTS]
    numbers = _numbers(flat, set(wanted))
    written: dict[int, list[str]] = {}
    for item in (*flat.groups, *flat.laws):
        if item.span is not None and getattr(item, "origin", "law") in OWN:
            text = " ".join(item.span.text.split()).rstrip(";")
            if text.split("=")[0].strip() not in OF_THE_LEDGER:
                written.setdefault(item.part, []).append(text)
    found = []
    for name in wanted:
        part = numbers.get(name)
        if part is not None:
            own = flat.parts[part]
            equations = list(dict.fromkeys(written.get(part, ())))[:MOST_EQUATIONS]
            short = own.class_name.rpartition(".")[2]
            found.append({"name": name, "class": short, "text": own.description, "equations": equations})
    return found


def _numbers(flat: FlatDAE, names: set[str]) -> dict[str, int]:
    """Return the number of the part of each name."""
    found = {}
    for number, part in enumerate(flat.parts):
        count = prod(dims_of(part.path))
        if number and count <= MOST_PARTS:
            found |= {n: number for k in range(count) if (n := element_name(part.path, k)) in names}
    return found
