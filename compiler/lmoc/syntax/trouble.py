"""A place where the text cannot go on, and changes of the tokens there.

Only symbols are looked at, no values are made. The stack of the automaton is a linked list here, so the one before
every token is kept and a change can be tried at an earlier place for free.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

from lmoc.messages.diagnostics import Diagnostic
from lmoc.messages.source import Source, Span
from lmoc.syntax.lexer import Tokens
from lmoc.syntax.tables import END_OF_TEXT, Tables

# A change after which so many more tokens can be read is believed.
CERTAIN = 12
# What begins a new part of a text, whatever came before.
FRESH = {"end", "equation", "algorithm", "public", "protected", "_INITIAL_EQUATION", "_INITIAL_ALGORITHM", END_OF_TEXT}

CLASSES = {"class", "model", "block", "connector", "type", "record", "package", "function", "partial"}


class StackNode(NamedTuple):
    """The top of a stack: the state, the symbol that led there, its first token, and what lies below."""

    state: int
    symbol: str
    token: int
    below: StackNode | None


class Edit(NamedTuple):
    """At a token, take some away and put others; `name` is the text of an identifier among them."""

    at: int
    removed: int
    inserted: tuple[str, ...]
    name: str = ""


class Slip(NamedTuple):
    """A change that might be what the writer meant, and how to say so.

    One that is `sure` is taken if reading goes on at all: what follows it may be the same slip once more.
    """

    edit: Edit
    explain: Callable[[], Diagnostic]
    sure: bool = False


def advance(
    tables: Tables, node: StackNode, symbol: str, token: int, reduced: list[str] | None = None
) -> StackNode | None:
    """The stack after one more token, None where it cannot stand; `reduced` takes the rules completed before it."""
    steps, gotos, rules = tables.steps, tables.gotos, tables.rules
    while True:
        step = steps[node.state].get(symbol)
        if step is None:
            return None
        if step >= 0:
            return StackNode(step, symbol, token, node)
        rule = rules[-1 - step]
        first = token
        for _ in range(rule.size):
            first = node.token
            node = node.below
        if reduced is not None:
            reduced.append(rule.origin)
        node = StackNode(gotos[node.state][rule.origin], rule.origin, first, node)
        if symbol == END_OF_TEXT and node.state == tables.accept:
            return node


class Trouble:
    """A place where the text cannot go on.

    Attributes
    ----------
    source, tables, tokens
    trail : list of StackNode
        The stack before each token up to the wrong one.
    at : int
        The wrong token.
    """

    def __init__(self, source: Source, tables: Tables, tokens: Tokens, trail: list[StackNode], at: int):
        self.source = source
        self.tables = tables
        self.tokens = tokens
        self.trail = trail
        self.at = at

    @property
    def found(self) -> str:
        return self.tokens.symbols[self.at]

    @property
    def before(self) -> str:
        return self.tokens.symbols[self.at - 1] if self.at else ""

    @property
    def breaks_line(self) -> bool:
        """Return whether the wrong token is the first of its line."""
        return self.breaks_before(self.at)

    def span(self, token: int | None = None, last: int | None = None) -> Span:
        """The place of a token (the wrong one by default), or of several."""
        first = self.at if token is None else token
        last = first if last is None else last
        return Span(self.source, self.tokens.starts[first], self.tokens.ends[last])

    def gap(self, token: int | None = None) -> Span:
        """The place right after the token before (the wrong one by default), where something is missing."""
        token = self.at if token is None else token
        end = self.tokens.ends[token - 1] if token else self.tokens.starts[0]
        return Span(self.source, end, end)

    def stack(self, token: int | None = None) -> Iterator[StackNode]:
        """The symbols read so far, the latest first."""
        node: StackNode | None = self.trail[self.at if token is None else token]
        while node is not None:
            yield node
            node = node.below

    def can_follow(self) -> set[str]:
        """The symbols of all tokens that could stand here."""
        node = self.trail[self.at]
        return {s for s in self.tables.steps[node.state] if advance(self.tables, node, s, self.at)}

    def completed_by(self, symbol: str) -> list[str]:
        """The rules that a symbol would complete here."""
        reduced: list[str] = []
        advance(self.tables, self.trail[self.at], symbol, self.at, reduced)
        return reduced

    def breaks_before(self, token: int) -> bool:
        """Return whether a token is the first of its line."""
        return token == 0 or "\n" in self.source.text[self.tokens.ends[token - 1] : self.tokens.starts[token]]

    def statement_start(self) -> int:
        """The first token of the statement or declaration in which the wrong token occurs."""
        starts = FRESH | {";", "then", "else", "loop"}
        for token in range(self.at - 1, -1, -1):
            if self.tokens.symbols[token] in starts:
                return token + 1
        return 0

    def reach(self, edit: Edit) -> int:
        """Return how many tokens after a change, and not before the wrong one, can be parsed; at most `CERTAIN`."""
        node: StackNode | None = self.trail[edit.at]
        for symbol in edit.inserted:
            node = advance(self.tables, node, symbol, edit.at)
            if node is None:
                return 0
        symbols = self.tokens.symbols
        resumed = edit.at + edit.removed
        counted = max(resumed, self.at)
        for token in range(resumed, min(counted + CERTAIN, len(symbols))):
            node = advance(self.tables, node, symbols[token], token)
            if node is None:
                return token - counted
        return CERTAIN
