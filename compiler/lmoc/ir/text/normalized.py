"""The result of linear elimination as text: the equations in roots, and the formula for every other variable."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lmoc.expression.text import number_text, to_text
from lmoc.ir.flat import Kind
from lmoc.ir.names import patterns
from lmoc.ir.normalized import JetGroup, Normalized
from lmoc.ir.text.columns import cut

FEW = 3  # rows of a group that are written out one by one
MOST_TERMS = 12  # of a long sum that are written out
MOST_SUMS = 20


def normalized_text(n: Normalized) -> str:
    """Return counts, the equations that are left, the variables they are for, and what has been eliminated."""
    flat = n.flat
    root = np.flatnonzero((n.root == np.arange(flat.count)) & (flat.kind == Kind.UNKNOWN))
    unknown = int(np.count_nonzero(flat.kind == Kind.UNKNOWN))
    sections = [
        [flat.name, *(f"  {count:>9} {what}" for what, count in n.counts.items())],
        [f"unknowns ({len(root)})", *(f"    {name}" for name in patterns(flat, root, most=40))],
        [f"equations ({sum(g.rows for g in n.groups)})", *(f"    {cut(x)}" for g in n.groups for x in _lines(n, g))],
        [f"sums ({n.sums.rows})", *(f"    {cut(_sum(n, row))}" for row in range(min(n.sums.rows, MOST_SUMS)))],
        [f"derived parameters ({n.extended_count - flat.count})", *(f"    {cut(x)}" for x in _derived(n))],
        [f"eliminated: {unknown - len(root)} variables, each a factor times one of these, or a known value"],
        ["notes", *(f"    {d.message}" for d in n.notes)],
    ]
    return "\n\n".join("\n".join(s) for s in sections if len(s) > 1 or s[0].startswith("eliminated"))


def extended_name(n: Normalized, index: int) -> str:
    """Return the name of an extended variable; a derived parameter is ``#`` and its number."""
    return n.flat.variable_name(index) if index < n.flat.count else f"#{index}"


def _lines(n: Normalized, group: JetGroup) -> list[str]:
    rows = range(group.rows if group.rows <= FEW else 1)
    more = f"   (and {group.rows - 1} alike)" if group.rows > FEW else ""
    return [f"{to_text(group.residual, _namer(n, group.slots[row].tolist()))} = 0{more}" for row in rows]


def _namer(n: Normalized, names: list[int]) -> Callable[[int, int], str]:
    def name(column: int, order: int) -> str:
        return "der(" * order + extended_name(n, names[column]) + ")" * order

    return name


def _sum(n: Normalized, row: int) -> str:
    s = n.sums
    begin, end = int(s.start[row]), int(s.start[row + 1])
    text = ""
    for j in range(begin, min(end, begin + MOST_TERMS)):
        c, name = float(s.coefficient[j]), n.flat.jet_name(int(s.index[j]), int(s.order[j]))
        text += (" - " if c < 0 else " + ") + (name if abs(c) == 1 else f"{number_text(abs(c))}*{name}")
    more = f" … ({end - begin} terms)" if end - begin > MOST_TERMS else ""
    return text.removeprefix(" + ").strip() + more + " = 0"


def _derived(n: Normalized) -> list[str]:
    """One line for each group of derived parameters: the first of them."""
    lines = []
    for a in n.derived:
        more = f"   (and {len(a.target) - 1} alike)" if len(a.target) > 1 else ""
        value = to_text(a.shape, _namer(n, a.slots[0].tolist()))
        lines.append(f"{extended_name(n, int(a.target[0]))} := {value}{more}")
    return lines
