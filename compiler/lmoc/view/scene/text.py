"""Texts of a picture: names with subscripts, and how much room they take."""

from __future__ import annotations

import re
from collections.abc import Iterator
from unicodedata import combining

from lmoc.view.scene.picture import Frame, Label

SMALL = 0.72  # of the size: subscripts and superscripts
LOWERED, RAISED = 0.28, -0.38  # of the size

_RUN = re.compile(r"([_^])\{([^{}]*)\}")
_NARROW, _WIDE = frozenset("iljtf.,:;|!'()[]{} ·"), frozenset("mwMW@%—…")


def runs(text: str) -> Iterator[tuple[str, int]]:
    """Pieces of a text with their level: 0 on the line, -1 below it, 1 above it."""
    at = 0
    for found in _RUN.finditer(text):
        if found.start() > at:
            yield text[at : found.start()], 0
        if found[2]:
            yield found[2], -1 if found[1] == "_" else 1
        at = found.end()
    if at < len(text):
        yield text[at:], 0


def plain(text: str) -> str:
    """Return a text without its marks: ``q_{1}`` as ``q1``."""
    return "".join(piece for piece, _ in runs(text))


def escaped(name: str) -> str:
    """Return a user's text such that nothing in it counts as a mark."""
    return name.replace("_{", "_\u200b{").replace("^{", "^\u200b{")


def width(text: str, size: float) -> float:
    """Return an estimate of a text's width in px, for DejaVu Sans and fonts that are narrower."""
    return sum(_advance(c) * size * (1 if level == 0 else SMALL) for piece, level in runs(text) for c in piece)


def _advance(character: str) -> float:
    """The width of a character by the size of the font."""
    if combining(character) or character == "\u200b":
        return 0.0
    if character in _NARROW:
        return 0.40
    if character in _WIDE:
        return 1.0
    return 0.72 if character.isupper() else 0.64


def box(label: Label, frame: Frame) -> tuple[float, float, float, float]:
    """Return the corners (left, top, right, bottom) of a label as drawn."""
    x, y = frame.place(label.at)
    wide, high = width(label.text, label.size), 1.15 * label.size
    left = x - {"start": 0.0, "middle": wide / 2, "end": wide}[label.anchor]
    return left, y - high / 2, left + wide, y + high / 2
