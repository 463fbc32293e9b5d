"""Where a person types: inside of which brackets, behind which dots. Read off the text, which may be wrong there."""

from __future__ import annotations

import re

from lmoc.support.records import dataclass

_HIDDEN = re.compile(r'"(?:[^"\\]|\\.)*"?|//[^\n]*|/\*.*?(?:\*/|\Z)', re.S)
_DOTTED = re.compile(r"((?:[^\W\d]\w*(?:\[[^\[\]]*\])?\s*\.\s*)*)([^\W\d]\w*)?$")
_BEFORE_BRACKET = re.compile(
    r"([^\W\d][\w.]*)(?:\s*\[[^\]]*\])?\s+([^\W\d]\w*)(?:\s*\[[^\]]*\])?\s*$|([^\W\d][\w.]*)\s*$"
)
_CLASS = re.compile(r"\b(?:model|block|connector|record|package|function|class|type)\s+([^\W\d]\w*)")
_REACH = 20_000  # characters before a place that are looked at


@dataclass(frozen=True)
class Context:
    """A place in a text.

    Attributes
    ----------
    path : the names behind whose dots it stands
    word : what has been typed of the name
    inside : the open brackets around it, outermost first: what stands before each (a type where one is declared)
    argument : number of the argument in the innermost bracket, from 0
    hidden : in a comment or a string
    class_name : the name of the class whose text is around, as far as can be read without understanding it
    """

    path: tuple[str, ...]
    word: str
    inside: tuple[tuple[str, str], ...]
    argument: int
    hidden: bool
    class_name: str


def context(text: str, offset: int) -> Context:
    """Return what can be read before a character."""
    before = text[max(0, offset - _REACH) : offset]
    hidden = any(m.end() == len(before) and not _closed(m[0]) for m in _HIDDEN.finditer(before))
    plain = _HIDDEN.sub(lambda m: re.sub(r"[^\n]", " ", m[0]), before)
    dotted = _DOTTED.search(plain)
    path = tuple(re.sub(r"\[.*?\]", "", p).strip() for p in dotted[1].split(".")[:-1]) if dotted else ()
    inside, argument = _brackets(plain)
    classes = _CLASS.findall(plain)
    return Context(path, (dotted[2] or "") if dotted else "", inside, argument, hidden, classes[-1] if classes else "")


def _closed(text: str) -> bool:
    if text.startswith('"'):
        return len(text) > 1 and text.endswith('"')
    return text.endswith("*/") if text.startswith("/*") else False


def _brackets(plain: str) -> tuple[tuple[tuple[str, str], ...], int]:
    """What stands before each open bracket since the last ';' that is in none, and the commas in the innermost."""
    start = plain.rfind(";") + 1
    opened: list[int] = []
    commas: list[int] = []
    for k in range(start, len(plain)):
        char = plain[k]
        if char in "([{":
            opened.append(k)
            commas.append(0)
        elif char in ")]}" and opened:
            opened.pop()
            commas.pop()
        elif char == "," and commas:
            commas[-1] += 1
    found = []
    for k in opened:
        match = _BEFORE_BRACKET.search(plain[start:k]) if plain[k] == "(" else None
        found.append(("", "") if match is None else (match[1] or "", match[2] or match[3]))
    return tuple(found), commas[-1] if commas else 0
