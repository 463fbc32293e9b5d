"""Going on after a syntax error: the smallest change of the tokens with which the text makes sense.

Where the automaton stops, likely slips are tried in turn (`lmoc.syntax.slips`): each is a change of a few tokens, and
the first one after which the automaton reads on well is taken, as in the repair methods of Graham and Rhodes (1975) and
Burke and Fisher (1987). Only if none helps is the rest of the statement skipped. What comes out is a list
of tokens that the grammar accepts, and a diagnostic for each change.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from lmoc.messages.diagnostics import Diagnostic
from lmoc.messages.source import Source
from lmoc.syntax.lexer import Tokens
from lmoc.syntax.slips import WANT_OPERAND, slips, unexpected
from lmoc.syntax.tables import Tables
from lmoc.syntax.trouble import CERTAIN, CLASSES, FRESH, Edit, Slip, StackNode, Trouble, advance

# So many tokens must make sense after a change that is a guess, and after a statement has been left out.
_PLAUSIBLE = 2
_CONVINCING = 3
_BEFORE_NAME = WANT_OPERAND | {".", "IDENT"}


def repair(
    source: Source, tables: Tables, tokens: Tokens, known: Sequence[Diagnostic], most: int
) -> tuple[list[Diagnostic], bool]:
    """Change tokens in place until the grammar accepts them.

    Parameters
    ----------
    source, tables
    tokens : Tokens
        Changed in place.
    known : sequence of Diagnostic
        What is known to be wrong with the characters: what goes wrong next to it is not reported again.
    most : int
        So many changes are made, not more.

    Returns
    -------
    list of Diagnostic
        One for each change.
    bool
        Whether the tokens are acceptable now; false where nothing helped.
    """
    said: list[Diagnostic] = []
    trail = [StackNode(tables.start, "", 0, None)]
    while True:
        read_on(tables, tokens, trail)
        at = len(trail) - 1
        if at == len(tokens.symbols):
            return said, True
        trouble = Trouble(source, tables, tokens, trail, at)
        slip = _most_likely(trouble, slips(trouble)) or _skip(trouble)
        begin, end = trouble.gap().start, trouble.span().end
        if slip is None or not any(d.span.start <= end and d.span.end >= begin for d in known):
            said.append(slip.explain() if slip else unexpected(trouble))
        if slip is None or len(said) >= most:
            return said, False
        tokens.splice(*slip.edit)
        if slip.edit.inserted == ("IDENT",) and slip.edit.name in tables.literals:
            _take_as_name(tokens, slip.edit.name, slip.edit.at)
        del trail[slip.edit.at + 1 :]


def _take_as_name(tokens: Tokens, word: str, start: int) -> None:
    """Take a keyword for a name wherever a name is needed from a token on: once it is one, it is used."""
    for at in range(start + 1, len(tokens.symbols)):
        if tokens.symbols[at] == word and tokens.symbols[at - 1] in _BEFORE_NAME:
            tokens.splice(at, 1, ("IDENT",), word)


def read_on(tables: Tables, tokens: Tokens, trail: list[StackNode]) -> None:
    """Read on from the end of the trail as far as possible."""
    symbols = tokens.symbols
    for token in range(len(trail) - 1, len(symbols)):
        node = advance(tables, trail[-1], symbols[token], token)
        if node is None:
            return
        trail.append(node)


def _most_likely(trouble: Trouble, candidates: Iterator[Slip]) -> Slip | None:
    """The first candidate with which reading goes on well, else the one that carries farthest."""
    best, farthest = None, _PLAUSIBLE - 1
    for slip in candidates:
        reach = trouble.reach(slip.edit)
        if reach >= (_PLAUSIBLE if slip.sure else CERTAIN):
            return slip
        if reach > farthest:
            best, farthest = slip, reach
    return best


def _skip(trouble: Trouble) -> Slip | None:
    """Leave out the statement: up to the next place where reading can go on from an earlier one."""
    symbols = trouble.tokens.symbols
    for stop in range(trouble.at, len(symbols)):
        if not _can_begin(trouble, stop):
            continue
        for start in range(min(stop, trouble.at), -1, -1):
            edit = Edit(start, stop - start, ())
            if trouble.reach(edit) >= min(_CONVINCING, len(symbols) - stop):
                return Slip(edit, lambda: unexpected(trouble))
    return None


def _can_begin(trouble: Trouble, token: int) -> bool:
    """Return whether something new can begin at a token, whatever came before."""
    symbols = trouble.tokens.symbols
    begins_class = symbols[token] in CLASSES and trouble.breaks_before(token)
    return symbols[token] in FRESH or begins_class or (token > 0 and symbols[token - 1] == ";")
