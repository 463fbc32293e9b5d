"""The LALR automaton at work: tokens in, one value out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from lmoc.syntax.lexer import Tokens
from lmoc.syntax.tables import Tables


class Automaton:
    """The stacks of a parse.

    Attributes
    ----------
    states : list of int
    values : list
        The value of each symbol on the stack: the text of a token, what the action of a rule gave.
    begins, ends : list of int
        The range of characters that each symbol covers. An empty symbol begins at the token after it
        and ends with the one before, so that whatever holds it is not made longer by it.
    symbols : list of str
    """

    def __init__(self, tables: Tables, tokens: Tokens, actions: object):
        self.tables = tables
        self.tokens = tokens
        self.actions: list[Callable | None] = [
            getattr(actions, rule.action) if rule.action else None for rule in tables.rules
        ]
        self.states = [tables.start]
        self.symbols: list[str] = []
        self.values: list[Any] = []
        self.begins: list[int] = []
        self.ends: list[int] = []
        self.at = 0

    def run(self) -> bool:
        """Read tokens as far as possible; true where the text is complete, false before a wrong token."""
        steps, accept = self.tables.steps, self.tables.accept
        states, values, begins, ends = self.states, self.values, self.begins, self.ends
        symbols, texts, starts, stops = self.tokens
        last = len(symbols) - 1
        at = self.at
        while True:
            symbol = symbols[at]
            step = steps[states[-1]].get(symbol)
            if step is None:
                self.at = at
                return False
            if step >= 0:
                states.append(step)
                values.append(texts[at])
                begins.append(starts[at])
                ends.append(stops[at])
                self.symbols.append(symbol)
                at += 1
            else:
                self.reduce(-1 - step, starts[at], stops[at - 1] if at else 0)
                if at == last and states[-1] == accept:
                    self.at = at
                    return True

    def reduce(self, number: int, next_start: int, last_end: int) -> None:
        """Replace the symbols of a rule on the stack by the one that they make."""
        rule = self.tables.rules[number]
        states, values, begins, ends, symbols = self.states, self.values, self.begins, self.ends, self.symbols
        size = rule.size
        if size:
            children = values[-size:]
            begin, end = begins[-size], ends[-1]
            del states[-size:], values[-size:], begins[-size:], ends[-size:], symbols[-size:]
        else:
            children, begin, end = [], next_start, last_end
        if rule.spliced:
            if rule.grows:
                value = children[0]
                kept = rule.kept[1:]
            else:
                value = []
                kept = rule.kept
            for i in kept:
                if i in rule.spliced:
                    value.extend(children[i])
                else:
                    value.append(children[i])
        elif len(rule.kept) == size:
            value = children
        else:
            value = [children[i] for i in rule.kept]
        if rule.action:
            value = self.actions[number](value, begin, end)
        elif rule.passes:
            value = value[0]
        states.append(self.tables.gotos[states[-1]][rule.origin])
        values.append(value)
        begins.append(begin)
        ends.append(end)
        symbols.append(rule.origin)
