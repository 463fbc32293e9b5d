"""The same said of every member of an array, said once: ``m[1].q``, ``m[2].q``, … are ``m[1:10000].q``."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from lmoc.messages.diagnostics import Diagnostic, Report

# of mistakes that may be one in all members of an array, so many are looked at
LOOKED_AT = 20_000
# where members of an array make several ranges, so many of them are listed
RUNS = 2

_SUBSCRIPT = re.compile(r"\[\d+(?:,\d+)*\]")
_NUMBER = re.compile(r"\d+")


def report_alike(found: Iterable[Diagnostic], report: Report, most: int, unseen: int = 0) -> None:
    """Add diagnostics to a report: one for all that differ in indices only, and of unlike ones no more than `most`.

    Parameters
    ----------
    found : as they would be said of each member of an array; what they expect, find and hint at is merged where it
        differs in indices only too, else that of the first is shown
    unseen : how many more places have not been looked at; the last one shown tells it, and how many were cut
    """
    families: dict[tuple[Any, ...], list[Diagnostic]] = {}
    for d in found:
        families.setdefault((d.code, d.span, _plain(d.message)), []).append(d)
    shown = [d for family in list(families.values())[:most] for d in _merged(family)]
    more = sum(len(family) for family in list(families.values())[most:])
    further = [f"{more} more such {'mistake is' if more == 1 else 'mistakes are'} not shown"] if more else []
    further += [f"{unseen} more {'place was' if unseen == 1 else 'places were'} not examined"] if unseen else []
    if further and shown:
        shown[-1] = replace(shown[-1], hint="; ".join(filter(None, [shown[-1].hint, *further])))
    report.diagnostics += shown


def ranges(names: Sequence[str]) -> list[str]:
    """Names in their order, those that differ in indices only and fill a range of them as one.

    Members of an array that fill no range stay as they are.
    """
    families: dict[str, list[str]] = {}
    for name in names:
        families.setdefault(_plain(name), []).append(name)
    result: list[str] = []
    for family in families.values():
        one = over_range(family) if len(family) > 2 else None
        result += family if one is None else [one]
    return result


def over_range(texts: Sequence[str]) -> str | None:
    """Texts that differ in indices only as one with ranges, where all of these together mean just these texts.

    Indices that count up together, as in ``a[i] and b[i+1]``, are one range each.

    >>> over_range(["a[1] and b[2]", "a[2] and b[3]", "a[3] and b[4]"])
    'a[1:3] and b[2:4]'
    """
    if len(texts) == 1:
        return texts[0]
    table = _indices(texts)
    low, high = table.min(axis=0), table.max(axis=0)
    steps = {column.tobytes() for column in (table - low).T if column.any()}
    lengths = [int(np.frombuffer(step, table.dtype).max()) + 1 for step in steps]
    if np.prod(lengths, dtype=float) != len(texts) or len({row.tobytes() for row in table}) < len(texts):
        return None
    spans = iter(f"{a}:{b}" if a != b else str(a) for a, b in zip(low.tolist(), high.tolist(), strict=True))
    return _SUBSCRIPT.sub(lambda s: _NUMBER.sub(lambda _: next(spans), s[0]), texts[0])


def _merged(family: list[Diagnostic]) -> list[Diagnostic]:
    """One for all, or where they fill no range of indices one for each of the first ranges that some of them fill."""
    message = over_range([d.message for d in family])
    if message is not None:
        return [_over_range(family, message)]
    runs = _runs(family)
    result = [_over_range(run, over_range([d.message for d in run]) or run[0].message) for run in runs[:RUNS]]
    more = sum(map(len, runs[RUNS:]))
    if more:
        result[-1] = replace(result[-1], message=f"{result[-1].message}, and {more} more like it")
    return result


def _runs(family: list[Diagnostic]) -> list[list[Diagnostic]]:
    """Members side by side of which each has the same indices one higher than the one before."""
    table = _indices([d.message for d in family])
    steps = np.diff(table, axis=0)
    unit = ((steps == 0) | (steps == 1)).all(axis=1)
    runs = [[family[0]]]
    for k, d in enumerate(family[1:]):
        goes_on = len(runs[-1]) == 1 or (steps[k] == steps[k - 1]).all()
        if unit[k] and goes_on:
            runs[-1].append(d)
        else:
            runs.append([d])
    return runs


def _over_range(family: list[Diagnostic], message: str) -> Diagnostic:
    rest: dict[str, Any] = {}
    for name in ("expected", "found", "hint") if len(family) > 1 else ():
        texts = [getattr(d, name) for d in family]
        alike = len(set(map(_plain, texts))) == 1
        own = (texts[0] if len(set(texts)) == 1 else over_range(texts)) if alike else None
        rest[name] = own if own is not None else f"of the first: {texts[0]}"
    return replace(family[0], message=message, **rest)


def _indices(texts: Sequence[str]) -> np.ndarray:
    """(texts, indices) the numbers in all subscripts of texts that differ in nothing else."""
    return np.array([[int(i) for s in _SUBSCRIPT.findall(t) for i in _NUMBER.findall(s)] for t in texts], int)


def _plain(text: str) -> str:
    """A text without the numbers in its subscripts: what all members of an array have in common."""
    return _SUBSCRIPT.sub(lambda s: "[" + "," * s[0].count(",") + "]", text)
