"""Cutting long lines where a person would."""

from __future__ import annotations

import re
from collections.abc import Iterator

WIDTH = 120
_STRING = re.compile(r"\"(?:[^\"\\]|\\[\s\S])*\"|'(?:[^'\\]|\\.)+'")
_LAST_STRING = re.compile(r' ("(?:[^"\\]|\\.)*";)$')
_SMALLEST_PIECE = 20


def broken(line: str) -> list[str]:
    """A line of a declaration, an equation or a statement as lines of bearable length; tokens stay whole.

    In this order: the description goes to a line of its own, what follows an '=' does, the items of a list do, and at
    last the line is cut at the space inside the fewest brackets.
    """
    if len(line) <= WIDTH or "\n" in line:
        return [line]
    indent = line[: len(line) - len(line.lstrip())]
    marks = list(_marks(line))
    for cut in (_before_description, _after_sign, _at_commas, _at_space):
        parts = cut(line, indent, marks)
        if parts:
            first, *rest = parts
            return [first, *(piece for part in rest for piece in broken(part))]
    return [line]


def _marks(line: str) -> Iterator[tuple[int, str, int]]:
    """Position, character and depth in brackets of all that is outside of strings."""
    depth = at = 0
    while at < len(line):
        string = _STRING.match(line, at)
        if string:
            at = string.end()
            continue
        if line[at] in ")]}":
            depth -= 1
        yield at, line[at], depth
        if line[at] in "([{":
            depth += 1
        at += 1


def _before_description(line: str, indent: str, marks: list) -> list[str]:
    found = _LAST_STRING.search(line)
    before = line[: found.start()] if found else ""
    return [before, f"{indent}  {found[1]}"] if before.strip() and len(before) <= WIDTH else []


def _after_sign(line: str, indent: str, marks: list) -> list[str]:
    for at, char, depth in marks:
        if char == "=" and depth == 0 and line[at + 1 : at + 2] == " ":
            head, tail = line[: at + 1], f"{indent}  {line[at + 2 :]}"
            return [head, tail] if len(tail) <= WIDTH and len(indent) + _SMALLEST_PIECE < at < WIDTH else []
    return []


def _at_commas(line: str, indent: str, marks: list) -> list[str]:
    """A piece for each item of the longest list, if it is most of the line."""
    lists = []
    for number, (at, char, depth) in enumerate(marks):
        if char in "([{" and depth == 0:
            end = next((stop for stop, c, d in marks[number + 1 :] if d == 0 and c in ")]}"), at)
            commas = [place for place, c, d in marks if at < place < end and c == "," and d == 1]
            if commas and at < WIDTH and 2 * (end - at) > len(line) - len(indent):
                lists.append((end - at, at, commas))
    if not lists:
        return []
    _, at, commas = max(lists)
    cuts = [at, *commas]
    ends = [*(comma + 1 for comma in commas), len(line)]
    return [line[: at + 1], *(f"{indent}  {line[a + 1 : b].strip()}" for a, b in zip(cuts, ends, strict=True))]


def _at_space(line: str, indent: str, marks: list) -> list[str]:
    """Pieces as long as possible among those that end in the fewest brackets, and behind a comma if there is one."""
    spaces = [(depth, line[at - 1] != ",", -at) for at, char, depth in marks if char == " "]
    pieces: list[str] = []
    start, deeper = len(indent), ""
    while len(indent) + len(deeper) + len(line) - start > WIDTH:
        end = start + WIDTH - len(indent) - len(deeper)
        fitting = [space for space in spaces if start + _SMALLEST_PIECE <= -space[2] <= end]
        if not fitting:
            break
        at = -min(fitting)[2]
        pieces.append(indent + deeper + line[start:at])
        if len(pieces) == 1 and not (indent.endswith("    ") and line[at + 1] in "+-"):
            deeper = "    "
        start = at + 1
    return [*pieces, indent + deeper + line[start:]] if pieces else []
