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
OWN = ("equation", "binding", "argument")  # origins of the equations that a part's text holds
OF_THE_LEDGER = ("energy", "loss", "power")  # variables that the equations of motion do without


def parts_data(run: Result, names: Iterable[str]) -> list[dict[str, Any]]:
    """Return {name, class, text, equations} of the named parts, each once."""
    flat = run.reduced.lawful or run.flat
    wanted = list(dict.fromkeys(names))[:MOST_PARTS]
    numbers = _numbers(flat, set(wanted))
    written: dict[int, list[str]] = {}
    own = [(g.part, g.span) for g in flat.groups if g.origin in OWN] + [(law.part, law.span) for law in flat.laws]
    for number, span in own:
        text = "" if span is None else " ".join(span.text.split()).rstrip(";")
        if text and text.split("=")[0].strip() not in OF_THE_LEDGER:
            written.setdefault(number, []).append(text)
    found = []
    for name in wanted:
        known = numbers.get(name)
        if known is not None:
            part = flat.parts[known]
            equations = list(dict.fromkeys(written.get(known, ())))[:MOST_EQUATIONS]
            short = part.class_name.rpartition(".")[2]
            found.append({"name": name, "class": short, "text": part.description, "equations": equations})
    return found


def _numbers(flat: FlatDAE, names: set[str]) -> dict[str, int]:
    """Return the number of the part of each name."""
    found = {}
    for number, part in enumerate(flat.parts):
        count = prod(dims_of(part.path))
        if number and count <= MOST_PARTS:
            found |= {n: number for k in range(count) if (n := element_name(part.path, k)) in names}
    return found
