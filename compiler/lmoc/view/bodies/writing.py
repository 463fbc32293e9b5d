"""Formulas in a picture: names with subscripts below the line, derivatives as dots."""

from __future__ import annotations

from unicodedata import normalize

from lmoc.symbolic.styles import GREEK, Unicode, split_name
from lmoc.view.scene.text import escaped

_DOTS = {1: "\u0307", 2: "\u0308", 3: "\u20db", 4: "\u20dc"}


class Marked(Unicode):
    """As in the terminal, with indices and exponents marked for `lmoc.view.scene.text`."""

    minus, sign = " − ", "−"

    def symbol(self, name: str, order: int) -> str:
        delta, word, digits, index = split_name(name)
        letter = GREEK.get(word, word)
        below = digits or GREEK.get(index, index)
        tail = f"_{{{escaped(below)}}}" if below else ""
        if order and (len(letter) > 1 or order > 4):
            return f"{delta}{escaped(letter)}{tail}" + "'" * order
        return delta + escaped(normalize("NFC", letter + _DOTS.get(order, ""))) + tail

    def power(self, base: str, exponent: str) -> str:
        return f"{base}^{{{exponent}}}" if "{" not in exponent else f"{base}^({exponent})"


MARKED = Marked()
