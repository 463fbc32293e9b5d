"""Names in single quotes, in which any character is allowed, in texts that are split at signs: 'a.b'.q, m[3].'#1'."""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import cache

QUOTED = r"'(?:[^'\\]|\\.)*'"
_SUBSCRIPT = re.compile(rf"({QUOTED})|\[([^\]]*)\]", re.DOTALL)


@cache
def _at(sign: str) -> re.Pattern[str]:
    return re.compile(rf"{QUOTED}|({re.escape(sign)})", re.DOTALL)


def split(text: str, sign: str = ".") -> list[str]:
    """Return the pieces of a text between signs, like `str.split`; signs within quotes do not count.

    >>> split("a.'b.c'.d")
    ['a', "'b.c'", 'd']
    """
    if "'" not in text:
        return text.split(sign)
    pieces, begin = [], 0
    for found in _at(sign).finditer(text):
        if found[1]:
            pieces.append(text[begin : found.start()])
            begin = found.end()
    return [*pieces, text[begin:]]


def partition(text: str, sign: str) -> tuple[str, str, str]:
    """Return what `str.partition` does, at the first sign that is not within quotes."""
    first, *rest = split(text, sign)
    return (first, sign, sign.join(rest)) if rest else (text, "", "")


def parent(name: str) -> str:
    """Return a dotted name without its last part; empty where it has one alone."""
    return ".".join(split(name)[:-1])


def last(name: str) -> str:
    """Return the last part of a dotted name."""
    return split(name)[-1]


def without_subscripts(name: str, instead: str = "") -> str:
    """Return a name without its indices: ``m[3].q`` is ``m.q``."""
    return _SUBSCRIPT.sub(lambda found: found[1] or instead, name) if "[" in name else name


def with_subscripts(name: str, indices: Iterable[str]) -> str:
    """Return a name with other indices in the places of its own."""
    given = iter(indices)
    return _SUBSCRIPT.sub(lambda found: found[1] or f"[{','.join(next(given) for _ in found[2].split(','))}]", name)


def subscripts(name: str) -> list[list[str]]:
    """Return the indices of a name, as they are written: ``m[3].a[1,2]`` has [["3"], ["1", "2"]]."""
    return [found[2].split(",") for found in _SUBSCRIPT.finditer(name) if found[1] is None]
