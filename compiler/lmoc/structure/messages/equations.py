"""Flat equations by number: their place, their variables, the parts they belong to. For messages only."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from itertools import accumulate

import numpy as np

from lmoc.ir.flat import FlatDAE, Kind
from lmoc.messages.ranges import ranges
from lmoc.messages.source import Span
from lmoc.support.indices import INDEX
from lmoc.support.quoted import split, without_subscripts

# of many names, equations or mistakes of one sort, this many are shown
SHOWN = 5
NAMED = 100  # characters of an equation that a message about something else names
HELD = "two ways that lead there do not agree: remove one, or put a spring where the real mechanism is elastic"


def listed(names: Sequence[str]) -> str:
    """``a, b and c``; of many the first few, members of an array as one."""
    names = list(names)
    if len(names) > SHOWN + 1:
        names = ranges(names)
    if len(names) > SHOWN + 1:
        return ", ".join(names[:SHOWN]) + f" and {len(names) - SHOWN} more"
    return ", ".join(names[:-1]) + " and " + names[-1] if len(names) > 1 else "".join(names)


class Equations:
    """The flat equations numbered through: the groups in order, then the sums."""

    def __init__(self, flat: FlatDAE):
        self.flat = flat
        self._first = [0, *accumulate(g.rows for g in flat.groups)]

    @property
    def first_sum(self) -> int:
        """Number of the first sum."""
        return self._first[-1]

    def place(self, number: int) -> tuple[int, int]:
        """Group (-1: the sums) and row of an equation."""
        if number >= self.first_sum:
            return -1, number - self.first_sum
        group = bisect_right(self._first, number) - 1
        return group, number - self._first[group]

    def span(self, number: int) -> Span | None:
        group, row = self.place(number)
        if group >= 0:
            return self.flat.groups[group].span
        sums = self.flat.sums
        at = int(sums.span_of[row]) if len(sums.span_of) else -1
        return sums.spans[at] if at >= 0 else None

    def text(self, number: int) -> str:
        group, row = self.place(number)
        return self.flat.sum_text(row) if group < 0 else self.flat.row_text(self.flat.groups[group], row)

    def begun(self, number: int) -> str:
        """Return what a message names it by: its beginning, since a curve of many pieces fills a screen."""
        text = self.text(number)
        return text if len(text) <= NAMED else f"{text[:NAMED].rstrip()} …"

    def unknowns(self, number: int) -> list[int]:
        group, row = self.place(number)
        sums = self.flat.sums
        found = sums.index[sums.start[row] : sums.start[row + 1]] if group < 0 else self.flat.groups[group].slots[row]
        return [v for v in dict.fromkeys(found.tolist()) if self.flat.kind[v] == Kind.UNKNOWN]

    def is_balance(self, number: int) -> bool:
        """It ties forces, not positions."""
        return number >= self.first_sum or any(self.flat.block_at(v).flow for v in self.unknowns(number))

    def part(self, number: int) -> str:
        """The element that an equation describes, "" for connections and for equations of the model itself."""
        group, row = self.place(number)
        if group < 0:
            return ""
        g = self.flat.groups[group]
        if g.origin in ("connection", "unconnected", "ledger") or not self.flat.parts[g.part].path:
            return ""
        depth = len(self.flat.parts[g.part].path)
        names = [split(self.flat.variable_name(v)) for v in g.slots[row].tolist() if v < self.flat.count]
        own = [without_subscripts(p) for p in split(self.flat.parts[g.part].pattern)]
        for name in names:
            if [without_subscripts(n) for n in name[:depth]] == own:
                return ".".join(name[:depth])
        return self.flat.parts[g.part].pattern

    def parts(self, numbers: Iterable[int]) -> list[str]:
        """Names of the elements that some equations describe, each once."""
        return [name for name in dict.fromkeys(self.part(n) for n in numbers) if name]

    def spans(self, numbers: Iterable[int]) -> list[Span]:
        """Places of some equations in what the user wrote, each once: of a part's equations, where it is declared."""
        return [s for s in dict.fromkeys(self._user_span(n) for n in numbers) if s is not None]

    def _user_span(self, number: int) -> Span | None:
        group, _ = self.place(number)
        if group >= 0 and self.flat.groups[group].origin == "unconnected":
            return None
        if group >= 0 and self.part(number):
            declared = self.flat.parts[self.flat.groups[group].part].span
            return declared or self.span(number)
        return self.span(number)


class Loops:
    """Remembers by which equation each eliminated variable hangs on another, to name what closes a loop."""

    def __init__(self, equations: Equations, count: int):
        self.equations = equations
        self.walked = 0  # steps from equation to equation so far
        self.parent = np.full(count + 1, -1, INDEX)
        self.source = np.full(count + 1, -1, INDEX)

    def link(self, child: np.ndarray, parent: np.ndarray, source: np.ndarray) -> None:
        self.parent[child] = parent
        self.source[child] = source

    def _path(self, variable: int) -> tuple[int, list[int]]:
        """The root of a variable, and the equations on the way there."""
        path = []
        while self.parent[variable] >= 0:
            path.append(int(self.source[variable]))
            variable = int(self.parent[variable])
        self.walked += len(path)
        return variable, path

    def around(self, number: int) -> list[int]:
        """The equations of the loop that this one closes, itself first."""
        paths = [self._path(v)[1] for v in self.equations.unknowns(number)]
        return list(dict.fromkeys([number, *_unshared(paths)]))

    def among(self, numbers: Sequence[int]) -> list[int]:
        """These equations and those that tie their unknowns to each other."""
        paths: dict[int, list[list[int]]] = {}
        for number in numbers:
            for v in self.equations.unknowns(number):
                root, path = self._path(v)
                paths.setdefault(root, []).append(path)
        return list(dict.fromkeys([*numbers, *(e for alike in paths.values() for e in _unshared(alike))]))


def _unshared(paths: list[list[int]]) -> list[int]:
    """Return the items on some of the paths to a root, but not on all of them."""
    shared = set.intersection(*map(set, paths)) if len(paths) > 1 else set()
    return [e for path in paths for e in path if e not in shared]
