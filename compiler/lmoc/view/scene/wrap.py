"""Long strips, broken into rows.

A row ends behind a node by which alone the rest is joined to it; a number says where it goes on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import inf

from lmoc.ir.look import Look
from lmoc.view.scene.block import Block, packed
from lmoc.view.scene.elements import Element
from lmoc.view.scene.strip import RIGHT, UP, Direction, DrawnStrip, Strip, Style
from lmoc.view.scene.strips import draw_strip

LONGEST = 640.0  # px of a row: with more it is hard to read where a picture is 600 px wide
TALLEST = 1000.0  # px of what is drawn upright for it is too long to lie
TRIED = 10  # lengths of rows
GAP = 30.0
FRESH = -2 * 10**9  # numbers of nodes that stand for others

CONTINUED = Element("", "", Look("continuation"), ())


def draw_wrapped(strip: Strip, style: Style, direction: Direction) -> Block:
    """Return a strip, drawn: in one row where it has room, else in several below or beside each other."""
    drawn = draw_strip(strip, style, direction)
    if _length(drawn, direction) <= LONGEST:
        return drawn.block
    if direction == RIGHT and not strip.shaft and _stands(drawn):
        upright = draw_strip(strip, style, UP)
        if _length(upright, UP) <= TALLEST:
            return upright.block
    for candidate in (strip, strip.apart()):
        whole = draw_strip(candidate, style, direction)
        candidate = whole.strip
        span = max(whole.along.values()) - min(whole.along.values())
        room = LONGEST - (_length(whole, direction) - span)  # bodies and arrows stand out beyond the nodes
        places = _breaks(whole.along, _cuts(candidate, whole.along), max(room, LONGEST / 2))
        if places:
            rows = _rows(candidate, whole.along, places)
            moved = replace(style, variables=_variables(style.variables, places))
            blocks = [draw_strip(row, moved, direction).block for row in rows]
            return packed(blocks, 0.0 if direction == RIGHT else inf, GAP)
    return drawn.block


def _stands(drawn: DrawnStrip) -> bool:
    """Return whether a strip stands on what holds it, and ends free: a building."""
    held = [n for n in drawn.strip.nodes if drawn.strip.held(n) is not None]
    return bool(held) and all(drawn.is_first(n) for n in held) and len(drawn.along) > len(held)


def _length(drawn: DrawnStrip, direction: Direction) -> float:
    left, top, right, bottom = drawn.block.corners
    return right - left if direction == RIGHT else bottom - top


def _cuts(strip: Strip, along: Mapping[int, float]) -> list[int]:
    """Nodes that nothing leads past: what lies on both sides is joined by them alone."""
    spans = [sorted((along[a], along[b])) for _, a, b in (*strip.links, *strip.frames)]
    found = []
    for node in strip.nodes:
        x = along[node]
        alone = not any(abs(along[other] - x) < 1 for other in strip.nodes if other != node)
        if alone and strip.held(node) is None and node not in strip.hubs and not any(a < x < b for a, b in spans):
            found.append(node)
    return found


def _breaks(along: Mapping[int, float], cuts: Sequence[int], room: float) -> list[int]:
    """The nodes behind which a new row begins: as few rows as possible, and these of about the same length.

    Parameters
    ----------
    room : px between the first and the last node of a row
    """
    first, last = min(along.values()), max(along.values())
    inner = sorted((n for n in cuts if first < along[n] < last), key=lambda n: along[n])

    def within(most: float) -> list[int]:
        found: list[int] = []
        begin = first
        while last - begin > most and (beyond := [n for n in inner if along[n] > begin]):
            near = [n for n in beyond if along[n] - begin <= most]
            found.append(near[-1] if near else beyond[0])
            begin = along[found[-1]]
        return found

    fewest = len(within(room))
    mean = min(room, (last - first) / (fewest + 1))
    lengths = [mean + (room - mean) * k / TRIED for k in range(TRIED + 1)]
    return next(found for most in lengths if len(found := within(most)) == fewest)


def _numbers(k: int) -> tuple[int, int, int]:
    """The nodes made for the k-th break: the mark where a row ends, the mark where one begins, the node there."""
    return FRESH - 3 * k, FRESH - 3 * k - 1, FRESH - 3 * k - 2


def _variables(variables: Mapping[int, str], places: Sequence[int]) -> dict[int, str]:
    """Return the variables of all nodes: those that were made move as the ones that they stand for."""
    made = {n: variables[place] for k, place in enumerate(places) if place in variables for n in _numbers(k)}
    return {**variables, **made}


def _rows(strip: Strip, along: Mapping[int, float], places: Sequence[int]) -> list[Strip]:
    """The pieces between the breaks."""
    ends = [-inf, *(along[n] for n in places), inf]
    rows = []
    for k in range(len(places) + 1):
        row = Strip(strip.shaft, on=strip.on, hubs=dict(strip.hubs), marks=dict(strip.marks), same=dict(strip.same))
        same = {places[k - 1]: _numbers(k - 1)[2]} if k else {}
        if k:
            _, begin, node = _numbers(k - 1)
            row.nodes += [begin, node]
            row.links.append((CONTINUED, begin, node))
            row.marks[begin] = row.same[node] = strip.meets(places[k - 1])
        row.nodes += [n for n in strip.nodes if ends[k] < along[n] <= ends[k + 1]]
        for links, mine in ((strip.links, row.links), (strip.frames, row.frames)):
            for element, a, b in links:
                if ends[k] < (along[a] + along[b]) / 2 < ends[k + 1]:
                    mine.append((element, same.get(a, a), same.get(b, b)))
        if k < len(places):
            row.nodes.append(_numbers(k)[0])
            row.links.append((CONTINUED, places[k], _numbers(k)[0]))
            row.marks[_numbers(k)[0]] = strip.meets(places[k])
        rows.append(row)
    return rows
