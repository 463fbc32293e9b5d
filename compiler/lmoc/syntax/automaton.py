"""The LALR automaton at work: tokens in, one value out."""

from __future__ import annotations

from typing import Any

from lmoc.syntax.lexer import Tokens
from lmoc.syntax.tables import Tables

# Symbols that wait to be completed: brackets, blocks and operators around a place. Whoever walks the tree may
# recurse, a few calls for each of them.
MOST_PENDING = 250


class TooDeep(Exception):
    """The text is nested too deeply at the token `at`."""

    def __init__(self, at: int):
        super().__init__(at)
        self.at = at


def run(tables: Tables, tokens: Tokens, actions: object) -> Any:
    """Read tokens and make the value of the whole.

    Every value on the stack goes with the range of characters that it covers. An empty one begins at the token after
    it and ends with the one before, so that whatever holds it is not made longer by it.

    Parameters
    ----------
    tables, tokens
    actions : object
        Has a method for each rule: it takes the list of the values kept, and the range.

    Returns
    -------
    Any
        What the action of the first rule made; None if a token cannot stand where it does.

    Raises
    ------
    TooDeep
        Where more than `MOST_PENDING` symbols wait.
    """
    steps, gotos, accept = tables.steps, tables.gotos, tables.accept
    rules = [(*rule, getattr(actions, rule.action, None)) for rule in tables.rules]
    symbols, texts, starts, stops = tokens
    states, values, begins, ends = [tables.start], [], [], []
    last = len(symbols) - 1
    at = 0
    while True:
        symbol = symbols[at]
        step = steps[states[-1]].get(symbol)
        if step is None:
            return None
        if step >= 0:
            states.append(step)
            if len(states) > MOST_PENDING:
                raise TooDeep(at)
            values.append(texts[at])
            begins.append(starts[at])
            ends.append(stops[at])
            at += 1
            continue
        origin, size, _, kept, spliced, passes, grows, action = rules[-1 - step]
        if passes and size == 1:  # most reductions: an operand passes through all levels of precedence
            states[-1] = gotos[states[-2]][origin]
            continue
        if size:
            children = values[-size:]
            begin, end = begins[-size], ends[-1]
            del states[-size:], values[-size:], begins[-size:], ends[-size:]
        else:
            children, begin, end = [], starts[at], stops[at - 1] if at else 0
        if spliced:
            children = _splice(children, kept, spliced, grows)
        elif len(kept) < size:
            children = [children[i] for i in kept]
        values.append(action(children, begin, end) if action else children[0] if passes else children)
        states.append(gotos[states[-1]][origin])
        begins.append(begin)
        ends.append(end)
        if at == last and states[-1] == accept:
            return values[-1]


def _splice(children: list, kept: tuple[int, ...], spliced: tuple[int, ...], grows: bool) -> list:
    """The values kept, those of lists one by one; a list that grows takes them in itself."""
    result = children[0] if grows else []
    for i in kept[1:] if grows else kept:
        if i in spliced:
            result.extend(children[i])
        else:
            result.append(children[i])
    return result
