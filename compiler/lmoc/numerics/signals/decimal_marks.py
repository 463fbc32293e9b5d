"""Which mark separates the decimals of a table's numbers, a point or a comma, and which one groups their digits.

`1,234` is 1.234 in one country and 1234 in another. What a mark means follows from those numbers that allow one reading
alone (``0,5``, ``1.234,56``, ``1,234,567``) and holds for all of them; where none says it, nothing is guessed.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from functools import lru_cache

from lmoc.support.numbers import parsed_number
from lmoc.support.records import dataclass

_EITHER = re.compile(r"[+-]?[1-9]\d{0,2}[.,]\d{3}")  # three decimals, or thousands
_ORDINARY = str.maketrans({"\u2212": "-", "\u2019": "'", "\u00a0": " ", "\u202f": " ", "\u2009": " "})
_OTHER = {",": ".", ".": ","}


@dataclass(frozen=True)
class Marks:
    """What stands before the decimals, and between groups of three digits: empty, nothing but blanks or apostrophes."""

    decimal: str = "."
    group: str = ""


class Ambiguous(ValueError):
    """What a number means cannot be told; `place` is where it stands among those that were given."""

    def __init__(self, place: int, message: str, hint: str):
        super().__init__(message)
        self.place, self.hint = place, hint


@dataclass(frozen=True)
class _Evidence:
    """What numbers say of the marks: each mark with the place of the first number that says it."""

    decimal: dict[str, int]  # stands before decimals
    group: dict[str, int]  # stands between groups
    either: dict[str, int]  # may be both


def marks_of(texts: Sequence[str], others: Iterable[str] = (), unproven: str = "") -> Marks:
    """Return the marks by which all of the numbers can be read.

    Parameters
    ----------
    texts : the numbers
    others : numbers beside them, which are asked where they themselves say nothing
    unproven : the decimal mark where not even these do; empty: that is an error

    Raises
    ------
    Ambiguous
    """
    if unproven == "." and not any("," in text for text in texts):
        return Marks()
    said = _evidence(texts)
    if len(said.decimal) == 2:
        first, second = sorted(said.decimal.values())
        message = f"'{texts[second]}' has another decimal mark than '{texts[first]}'"
        raise Ambiguous(second, message, "write all numbers with the same decimal mark")
    decimal = set(said.decimal)
    if not decimal and said.either:
        beside = set(_evidence(others).decimal)
        decimal = beside if len(beside) == 1 else {unproven} & set(said.either)
        if not decimal:
            place = min(said.either.values())
            raise Ambiguous(place, *_two_readings(texts[place]))
    mark = decimal.pop() if decimal else "."
    other = _OTHER[mark]
    if other in said.either and other not in said.group:
        place, sign = said.either[other], "point" if mark == "." else "comma"
        hint = f"write {_readings(texts[place])[1]} if that is meant: no separators between thousands"
        raise Ambiguous(place, f"'{texts[place]}' stands among numbers with a decimal {sign}", hint)
    return Marks(mark, other if other in said.group else "")


def _evidence(texts: Iterable[str]) -> _Evidence:
    said = _Evidence({}, {}, {})
    for place, text in enumerate(texts):
        if "," in text or "." in text:
            _look(_plain(text), place, said)
    return said


def _look(text: str, place: int, said: _Evidence) -> None:
    """Note what a number with a point or a comma says; what is no number with any marks says nothing."""
    used = [mark for mark in ".," if mark in text]
    if _EITHER.fullmatch(text):
        said.either.setdefault(used[0], place)
    elif len(used) == 1 and text.count(used[0]) == 1:
        if _is_number(text, Marks(used[0])):
            said.decimal.setdefault(used[0], place)
    else:
        last = max(used, key=text.rfind) if len(used) == 2 else _OTHER[used[0]]
        if _is_number(text, Marks(last, _OTHER[last])):
            said.decimal.setdefault(last, place)
            said.group.setdefault(_OTHER[last], place)


def _readings(text: str) -> tuple[str, str]:
    """What three digits behind a mark may mean: decimals, or thousands."""
    text = _plain(text)
    return text.replace(",", "."), text.replace(",", "").replace(".", "")


def _two_readings(text: str) -> tuple[str, str]:
    decimals, thousands = _readings(text)
    message = f"'{text}' may be {decimals} or {thousands}, and no number of the table says which"
    return message, f"write {decimals}0 or {thousands}; or columns separated by commas, with decimal points"


def number(text: str, marks: Marks) -> float:
    """Return a number that is written with these marks.

    Raises
    ------
    ValueError
        It is none.
    """
    text = _plain(text)
    if marks == Marks() and "'" not in text and " " not in text:
        return parsed_number(text)
    if not _is_number(text, marks):
        if any(c.isdigit() for c in text):
            raise ValueError(f"not a number: {text}")
        return parsed_number(text)  # inf, nan
    for mark in (marks.group, " ", "'"):
        text = text.replace(mark, "") if mark else text
    return parsed_number(text.replace(marks.decimal, "."))


def _is_number(text: str, marks: Marks) -> bool:
    return _pattern(marks).fullmatch(text) is not None


@lru_cache(maxsize=8)
def _pattern(marks: Marks) -> re.Pattern:
    """Numbers with these marks: groups of three digits before the decimals, all separated alike."""
    point, groups = re.escape(marks.decimal), "|".join(re.escape(mark) for mark in (marks.group, " ", "'") if mark)
    whole = rf"(?:\d+|[1-9]\d{{0,2}}({groups})\d{{3}}(?:\1\d{{3}})*)"
    return re.compile(rf"[+-]?(?:{whole}(?:{point}\d*)?|{point}\d+)(?:[eE][+-]?\d+)?", re.ASCII)


def _plain(text: str) -> str:
    """A text with ordinary signs instead of those that typographers put there."""
    return text if text.isascii() else text.translate(_ORDINARY).strip()
