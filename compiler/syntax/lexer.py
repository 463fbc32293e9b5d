"""From text to tokens."""

from __future__ import annotations

import re
from functools import cache
from typing import NamedTuple

from lmoc.syntax.tables import END_OF_TEXT, Tables


class Tokens(NamedTuple):
    """The tokens of a text, as parallel lists; the last one is the end of the text."""

    symbols: list[str]
    texts: list[str]
    starts: list[int]
    ends: list[int]

    def splice(self, at: int, removed: int, symbols: tuple[str, ...]) -> None:
        """Replace `removed` tokens from `at` on by made-up ones of no width, placed after the token before."""
        place = self.ends[at - 1] if at else 0
        made = len(symbols)
        stop = at + removed
        self.symbols[at:stop] = symbols
        self.texts[at:stop] = symbols
        self.starts[at:stop] = [place] * made
        self.ends[at:stop] = [place] * made


@cache
def _scanner(tables: Tables) -> re.Pattern:
    operators = sorted((s for s in tables.literals if not s[0].isalpha()), key=len, reverse=True)
    # Patterns come first, those with a longer fixed beginning (`initial equation`) before the general names.
    order = sorted(tables.patterns, key=lambda item: item[0] in ("IDENT", "NUMBER"))
    parts = [f"(?P<{symbol}>{pattern})" for symbol, pattern in order]
    return re.compile("|".join([*parts, f"(?P<operator>{'|'.join(map(re.escape, operators))})", r"(?P<wrong>[\s\S])"]))


def scan(text: str, tables: Tables) -> tuple[Tokens, list[int]]:
    """The tokens of a text, and the offsets of characters with which no token begins.

    Keywords and operators are their own symbols. The wrong characters are left out of the tokens.
    """
    tokens = Tokens([], [], [], [])
    wrong: list[int] = []
    add_symbol, add_text = tokens.symbols.append, tokens.texts.append
    add_start, add_end = tokens.starts.append, tokens.ends.append
    ignored, literals = tables.ignored, tables.literals
    for match in _scanner(tables).finditer(text):
        symbol = match.lastgroup
        if symbol in ignored:
            continue
        value = match.group()
        if symbol == "wrong":
            wrong.append(match.start())
            continue
        # A pattern with a context of its own (`end` as an index) goes before the keyword of the same text.
        add_symbol(value if value in literals and symbol in ("IDENT", "operator") else symbol)
        add_text(value)
        add_start(match.start())
        add_end(match.end())
    add_symbol(END_OF_TEXT)
    add_text("")
    add_start(len(text))
    add_end(len(text))
    return tokens, wrong
