"""The parser's tables: made from the grammar by lark, shipped with the package, kept between processes.

lark turns ``grammar/lmo.lark`` into an LALR(1) automaton (DeRemer & Pennello 1982). That takes a few tenths of a
second, most of it importing and building, so the result is kept as plain data in the user's cache. A process that
finds it there never imports lark.
"""

from __future__ import annotations

import marshal
import os
from collections import namedtuple
from functools import cache as once
from zlib import crc32

from lmoc.support import cache

END_OF_TEXT = "$END"
PACKAGED = "tables.json"


# One production: what its reduction does with the values of its symbols.
#   origin: str; size: int
#   action: name of the method that makes the value; "" where none is needed
#   kept: positions of the symbols whose values count
#   spliced: those among them whose value is a list to be spliced
#   passes: its only child stands for it
#   grows: a left-recursive list; the first value is extended in place
Rule = namedtuple("Rule", "origin size action kept spliced passes grows")


class Tables:
    """An LALR(1) automaton and the tokens it reads.

    Attributes
    ----------
    steps : tuple of dict
        For each state, by the symbol of a token: the state to shift to (>= 0), or ``-1 - rule`` to reduce by.
    gotos : tuple of dict
        For each state, by the origin of a rule just reduced: the next state.
    rules : tuple of Rule
    start, accept : int
        The first state, and the one in which the text is complete.
    literals : frozenset of str
        Keywords and operators. A literal's symbol is the literal itself.
    patterns : tuple of (str, str)
        Symbol and regular expression of the other tokens.
    ignored : frozenset of str
        Symbols of tokens that are skipped.
    """

    def __init__(
        self,
        steps: tuple[dict[str, int], ...],
        gotos: tuple[dict[str, int], ...],
        rules: tuple[tuple, ...],
        start: int,
        accept: int,
        literals: frozenset[str],
        patterns: tuple[tuple[str, str], ...],
        ignored: frozenset[str],
    ):
        self.steps = steps
        self.gotos = gotos
        self.rules = tuple(map(Rule._make, rules))
        self.start = start
        self.accept = accept
        self.literals = literals
        self.patterns = patterns
        self.ignored = ignored


@once
def load() -> Tables:
    """Return the tables of the lmo grammar: from the cache, else from the package, else made by lark."""
    grammar = grammar_text()
    key = grammar.encode() + cache.fingerprint(__file__)
    kept = cache.read("grammar", key)
    if kept is not None:
        try:
            return Tables(*marshal.loads(kept))
        except (ValueError, EOFError, TypeError):
            pass  # whatever is wrong with it, the tables can be made
    data = packaged(grammar)
    if data is None:
        data = build(grammar)
    cache.write("grammar", key, marshal.dumps(data))
    return Tables(*data)


def grammar_text() -> str:
    """Return the grammar as it appears in its file."""
    with open(os.path.join(_grammar_folder(), "lmo.lark"), encoding="utf-8") as file:
        return file.read()


def packaged(grammar: str) -> tuple | None:
    """Return the tables that come with the package, as `build` makes them; None where they are another grammar's."""
    import json

    try:
        with open(os.path.join(_grammar_folder(), PACKAGED), encoding="utf-8") as file:
            kept = json.load(file)
    except (OSError, ValueError):
        return None
    if kept["grammar"] != crc32(grammar.encode()):
        return None
    steps, gotos, rules, start, accept, literals, patterns, ignored = kept["tables"]
    return (
        tuple(steps),
        tuple(gotos),
        tuple((*rule[:3], tuple(rule[3]), tuple(rule[4]), *rule[5:]) for rule in rules),
        start,
        accept,
        frozenset(literals),
        tuple((symbol, pattern) for symbol, pattern in patterns),
        frozenset(ignored),
    )


def write_packaged(path: str) -> None:
    """Write the tables of the present grammar to the file that comes with the package: `make grammar`."""
    import json

    grammar = grammar_text()
    tables = [sorted(part) if isinstance(part, frozenset) else part for part in build(grammar)]
    with open(path, "w", encoding="utf-8") as file:
        kept = {"grammar": crc32(grammar.encode()), "tables": tables}
        json.dump(kept, file, ensure_ascii=False, separators=(",", ":"))
        file.write("\n")


def _grammar_folder() -> str:
    import lmoc.grammar

    return os.path.dirname(lmoc.grammar.__file__)


def build(grammar: str) -> tuple:
    """The arguments of `Tables` as plain data, made by lark from the text of a grammar.

    Raises
    ------
    lark.exceptions.GrammarError
        If the grammar is wrong or has conflicts.
    """
    from lark import Lark
    from lark.parsers.lalr_analysis import Shift

    made = Lark(grammar, parser="lalr", lexer="basic", start="file", maybe_placeholders=False)
    table = made.parser.parser._parse_table
    # lark's names are tokens of its own grammar: marshal wants plain strings.
    literal = {str(t.name): str(t.pattern.value) for t in made.terminals if t.pattern.type == "str"}
    patterns = {str(t.name): str(t.pattern.value) for t in made.terminals if t.pattern.type != "str"}
    numbers = {rule: i for i, rule in enumerate(made.rules)}
    states = {state: i for i, state in enumerate(table.states)}

    steps: list[dict[str, int]] = []
    gotos: list[dict[str, int]] = []
    for row in table.states.values():
        shifts = {str(symbol): states[target] for symbol, (action, target) in row.items() if action is Shift}
        reductions = {str(symbol): -1 - numbers[rule] for symbol, (action, rule) in row.items() if action is not Shift}
        moves = shifts | reductions
        gotos.append({symbol: state for symbol, state in moves.items() if not _is_token(symbol)})
        steps.append({literal.get(symbol, symbol): step for symbol, step in moves.items() if _is_token(symbol)})
    ignored = frozenset(map(str, made.lexer_conf.ignore))
    first, last = states[table.start_states["file"]], states[table.end_states["file"]]
    steps, gotos, number = _ordered(steps, gotos, first)
    return (
        steps,
        gotos,
        tuple(_rule(rule) for rule in made.rules),
        number[first],
        number[last],
        frozenset(literal.values()),
        tuple(patterns.items()),
        ignored,
    )


def _ordered(
    steps: list[dict[str, int]], gotos: list[dict[str, int]], first: int
) -> tuple[tuple[dict[str, int], ...], tuple[dict[str, int], ...], dict[int, int]]:
    """The states numbered as they are met from the first one on: lark's numbers differ from process to process."""
    number = {first: 0}
    order = [first]
    for state in order:
        shifts = [(s, t) for s, t in sorted(steps[state].items()) if t >= 0]
        for _, target in (*shifts, *sorted(gotos[state].items())):
            if target not in number:
                number[target] = len(order)
                order.append(target)
    return (
        tuple({s: number[t] if t >= 0 else t for s, t in sorted(steps[state].items())} for state in order),
        tuple({s: number[t] for s, t in sorted(gotos[state].items())} for state in order),
        number,
    )


def _is_token(symbol: str) -> bool:
    return symbol.isupper()


def _rule(rule) -> tuple:
    """The fields of a `Rule`, with lark's conventions about which children a node has."""
    origin = str(rule.origin.name)
    splices = origin.startswith("_")
    kept = tuple(
        i
        for i, symbol in enumerate(rule.expansion)
        if not (symbol.is_term and symbol.filter_out) or rule.options.keep_all_tokens
    )
    spliced = tuple(i for i in kept if not rule.expansion[i].is_term and rule.expansion[i].name.startswith("_"))
    grows = splices and bool(rule.expansion) and rule.expansion[0].name == origin
    passes = bool(rule.options.expand1) and not rule.alias and len(kept) == 1 and not spliced
    action = "" if splices or passes else str(rule.alias or origin)
    return origin, len(rule.expansion), action, kept, spliced, passes, grows
