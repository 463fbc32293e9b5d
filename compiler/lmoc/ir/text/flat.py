"""The flat model as text: its parts, variables and equations in the user's names, arrays put together."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from lmoc.expression.text import number_text, to_text
from lmoc.ir.flat import Assignments, Block, FlatDAE, Group, Kind, Part
from lmoc.ir.names import block_pattern
from lmoc.ir.text.columns import aligned, cut
from lmoc.support.quoted import last

FEW = 3  # rows of a group that are written out one by one
MOST_SUMS = 60
MOST_TERMS = 40  # of a sum that is written out
_CHAPTERS = {"connection": "connections", "unconnected": "unconnected flows", "ledger": "energy ledger"}


# --------------------------------------------------------------------------- instance tree


def instance_text(flat: FlatDAE) -> str:
    """The tree of parts, each with its class and what it declares."""
    values = flat.parameter_values()
    members: dict[int, list[Block]] = {}
    for block in flat.blocks:
        if block.size and not block.path[-1][0][0].isdigit() and block.path[0][0] != "ledger":
            members.setdefault(block.part, []).append(block)
    children: dict[int, list[int]] = {}
    for number, part in enumerate(flat.parts[1:], 1):
        children.setdefault(part.parent, []).append(number)

    def lines(number: int, lead: str) -> Iterator[str]:
        part = flat.parts[number]
        name = last(part.pattern) if number else flat.name
        described = f"  {part.description}" if part.description else ""
        yield f"{lead}{part.class_name} {name}{described}" if number else f"model {name}{described}"
        rows = [_declaration(b, part, values) for b in members.get(number, ())]
        yield from (f"{lead}{row}" for row in aligned(rows, "    "))
        for child in children.get(number, ()):
            yield from lines(child, lead + "  ")

    return "\n".join(lines(0, ""))


def _declaration(block: Block, part: Part, values: np.ndarray) -> tuple[str, ...]:
    inside = Block(block.path[len(part.path) :], 0, 0, block.kind).pattern
    return block.kind.name.lower(), inside, _value(block, values), block.unit, _marks(block), block.description


# ------------------------------------------------------------------------------ flat model


def flat_text(flat: FlatDAE) -> str:
    """Parts, variables and equations of a flat model."""
    values = flat.parameter_values()
    sections = [
        [flat.name + (f": {flat.description}" if flat.description else "")],
        _parts(flat),
        _variables(flat, "parameters", (Kind.CONSTANT, Kind.PARAMETER), values),
        _variables(flat, "inputs", (Kind.INPUT,), values),
        _variables(flat, "unknowns", (Kind.UNKNOWN, Kind.DISCRETE), values),
        _equations(flat),
        _sums(flat),
        _initial(flat),
    ]
    return "\n\n".join("\n".join(section) for section in sections if section)


def _parts(flat: FlatDAE) -> list[str]:
    rows = [(p.pattern, p.class_name, p.description) for p in flat.parts[1:]]
    return [f"parts ({len(rows)})", *aligned(rows)] if rows else []


def _variables(flat: FlatDAE, title: str, kinds: Sequence[Kind], values: np.ndarray) -> list[str]:
    blocks = [b for b in flat.blocks if b.kind in kinds and b.size and not b.path[-1][0][0].isdigit()]
    if not blocks:
        return []
    signals = {int(a.target[0]): _signal(flat, a) for a in flat.bindings if flat.kind[a.target[0]] == Kind.INPUT}
    rows = [(b.pattern, signals.get(b.offset, _value(b, values)), b.unit, _marks(b), b.description) for b in blocks]
    return [f"{title} ({sum(b.size for b in blocks)})", *aligned(rows)]


def _value(block: Block, values: np.ndarray) -> str:
    own = values[block.offset : block.offset + block.size]
    if block.kind > Kind.PARAMETER:
        return ""
    if np.isnan(own).all():
        return "no value"
    low, high = np.nanmin(own), np.nanmax(own)
    return f"= {number_text(float(low))}" if low == high else f"= {low:g} … {high:g}"


def _signal(flat: FlatDAE, binding: Assignments) -> str:
    """The default signal of an input."""
    return "= " + to_text(binding.shape, lambda k, _: flat.variable_name(int(binding.slots[0, k])))


def _marks(block: Block) -> str:
    marks = ["output"] * block.output + ["flow"] * block.flow + ["structural"] * block.structural
    return " ".join(marks)


def _equations(flat: FlatDAE) -> list[str]:
    if not flat.groups:
        return []
    chapters: dict[str, list[Group]] = {}
    for group in sorted(flat.groups, key=lambda g: (g.origin in _CHAPTERS, g.part)):
        owner = flat.parts[group.part]
        title = f"{owner.pattern or flat.name} ({owner.class_name})"
        chapters.setdefault(_CHAPTERS.get(group.origin, title), []).append(group)
    lines = [f"equations ({sum(g.rows for g in flat.groups)})"]
    for title, groups in chapters.items():
        lines += [f"  {title}", *(f"    {cut(line)}" for group in groups for line in group_lines(flat, group))]
    return lines


def group_lines(flat: FlatDAE, group: Group) -> list[str]:
    """The equations of a group: each where they are few, else one line for all."""
    if group.rows <= FEW:
        return [flat.row_text(group, row) for row in range(group.rows)]
    patterns = [column_pattern(flat, group.slots[:, k]) for k in range(group.slots.shape[1])]

    def name(column: int, order: int) -> str:
        text = patterns[column]
        for _ in range(order):
            text = f"der({text})"
        return text

    return [f"{to_text(group.left, name)} = {to_text(group.right, name)}   ({group.rows} equations)"]


def column_pattern(flat: FlatDAE, variables: np.ndarray) -> str:
    """One name for the variables of a column: ``m[2:10000].q`` if of one array, else the first and an ellipsis."""
    first = int(variables[0])
    if (variables == first).all():
        return flat.variable_name(first)
    return block_pattern(flat, variables) or f"{flat.variable_name(first)}…"


def _sums(flat: FlatDAE) -> list[str]:
    rows = flat.sums.rows
    if not rows:
        return []
    lines = [line for first, last in _runs(flat) for line in _sum_lines(flat, first, last)]
    more = [f"… and {len(lines) - MOST_SUMS} more lines"] if len(lines) > MOST_SUMS else []
    return [f"balances at connections ({rows})", *(f"    {cut(line)}" for line in [*lines[:MOST_SUMS], *more])]


def _runs(flat: FlatDAE) -> list[tuple[int, int]]:
    """First and last of neighbouring sums with the same signs over the same arrays."""
    s = flat.sums
    blocks = np.where(s.sign < 0, -1 - flat.block_of[s.index], flat.block_of[s.index])
    lengths = np.diff(s.start)
    alike = np.zeros(s.rows, bool)  # as the one before
    for length in np.unique(lengths[lengths <= MOST_TERMS]):
        rows = np.flatnonzero(lengths == length)
        table = blocks[s.start[rows][:, None] + np.arange(length)]
        alike[rows[1:]] = (table[1:] == table[:-1]).all(axis=1) & (np.diff(rows) == 1)
    first = np.flatnonzero(~alike)
    return list(zip(first.tolist(), [*(first[1:] - 1).tolist(), s.rows - 1], strict=True))


def _sum_lines(flat: FlatDAE, first: int, last: int) -> list[str]:
    if last - first < FEW:
        return [_sum_text(flat, row) for row in range(first, last + 1)]
    s = flat.sums
    length = int(s.start[first + 1] - s.start[first])
    table = s.index[s.start[first : last + 1][:, None] + np.arange(length)]
    text = "".join(
        (" - " if s.sign[s.start[first] + k] < 0 else " + ") + column_pattern(flat, table[:, k]) for k in range(length)
    )
    return [f"{text.removeprefix(' + ').removeprefix(' ')} = 0   ({last - first + 1} balances)"]


def _sum_text(flat: FlatDAE, row: int) -> str:
    terms = int(flat.sums.start[row + 1] - flat.sums.start[row])
    if terms <= MOST_TERMS:
        return flat.sum_text(row)
    first, last = flat.sums.index[flat.sums.start[row]], flat.sums.index[flat.sums.start[row + 1] - 1]
    return f"{flat.variable_name(int(first))} … {flat.variable_name(int(last))} = 0   ({terms} terms)"


def _initial(flat: FlatDAE) -> list[str]:
    if not flat.initial_groups:
        return []
    lines = [line for group in flat.initial_groups for line in group_lines(flat, group)]
    return [f"initial equations ({sum(g.rows for g in flat.initial_groups)})", *(f"    {cut(x)}" for x in lines)]
