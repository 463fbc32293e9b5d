"""Usual slips with what has a beginning and an end: blocks, classes, brackets.

As in `lmoc.syntax.slips`, each function yields changes of the tokens that would repair the place, with the diagnostic.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

from lmoc.messages.diagnostics import Diagnostic, Label
from lmoc.syntax.tables import END_OF_TEXT
from lmoc.syntax.trouble import Edit, Slip, StackNode, Trouble
from lmoc.syntax.words import found

BLOCKS = {"for", "if", "when", "while"}
_PARTNER = {"(": ")", "[": "]", "{": "}"}
_MOST_SIGNS = 10  # brackets shown in a message


# ------------------------------------------------------------------- blocks


def _open_classes(trouble: Trouble, token: int) -> Iterator[tuple[str, int]]:
    """Name and token of the classes that are open before a token, the innermost first."""
    for node in trouble.stack(token):
        if node.symbol == "name" and node.below is not None and node.below.symbol == "class_kind":
            yield trouble.tokens.texts[node.token], node.token


def _open_block(trouble: Trouble, token: int) -> tuple[str, int] | None:
    """Word and token of the innermost ``for``, ``if``, ``when``, ``while`` that is open before a token."""
    closed = 0
    for node in trouble.stack(token):
        if node.symbol == "class_kind":
            return None
        if node.symbol in BLOCKS and node.below is not None and node.below.symbol == "end":
            closed += 1
        elif node.symbol in BLOCKS and closed:
            closed -= 1
        elif node.symbol in BLOCKS:
            return node.symbol, node.token
    return None


def _open_brackets(trouble: Trouble) -> list[StackNode]:
    """The brackets that are open before the place, the innermost first."""
    closed, found = 0, []
    for node in trouble.stack():
        if node.symbol in _PARTNER.values():
            closed += 1
        elif node.symbol in _PARTNER and closed:
            closed -= 1
        elif node.symbol in _PARTNER:
            found.append(node)
    return found


def unclosed_block(trouble: Trouble) -> Iterator[Slip]:
    """``end if;`` and the like is missing, or closes something else."""
    at = trouble.at - 1 if trouble.before == "end" else trouble.at
    block = _open_block(trouble, at)
    if block is not None and (trouble.before == "end" or trouble.found in (END_OF_TEXT, "equation", "algorithm")):
        word, begin = block
        yield Slip(
            Edit(at, 0, ("end", word, ";")),
            lambda: _not_closed(trouble, f"'{word}'", f"'end {word};'", begin, at),
        )
        if trouble.before == "end" and trouble.found in BLOCKS:
            yield Slip(
                Edit(trouble.at, 1, (word,)),
                lambda: Diagnostic(
                    "E0109",
                    f"'{word}' is closed by 'end {trouble.found}'",
                    trouble.span(at, trouble.at),
                    expected=f"'end {word};'",
                    labels=(Label(trouble.span(begin), "begins here"),),
                ),
            )


def unclosed_class(trouble: Trouble) -> Iterator[Slip]:
    """The text is over, and a class is open: ``end Name;`` is missing, here or before the end of one around it."""
    owner = next(_open_classes(trouble, trouble.at), None)
    if owner is None or trouble.found != END_OF_TEXT:
        return
    symbols, texts = trouble.tokens.symbols, trouble.tokens.texts
    for end in range(trouble.at - 1):
        # An `end A` that closes B, where A is the name of a class around B: that of B is missing before it.
        if symbols[end] == "end" and symbols[end + 1] == "IDENT":
            around = list(_open_classes(trouble, end))
            name, begin = around[0] if around else ("", 0)
            if name != texts[end + 1] and texts[end + 1] in [outer for outer, _ in around]:
                yield Slip(
                    Edit(end, 0, ("end", "IDENT", ";"), name),
                    lambda name=name, begin=begin, end=end: _not_closed(
                        trouble, f"'{name}'", f"'end {name};'", begin, end
                    ),
                )
    name, begin = owner
    for inserted in (("end", "IDENT", ";"), (";", "end", "IDENT", ";")):
        yield Slip(
            Edit(trouble.at, 0, inserted, name),
            lambda: _not_closed(trouble, f"'{name}'", f"'end {name};'", begin, trouble.at),
        )


def missing_block_word(trouble: Trouble) -> Iterator[Slip]:
    """``end;`` where ``if``, ``for``, ``when`` or ``while`` belongs behind it."""
    block = _open_block(trouble, trouble.at)
    if trouble.before == "end" and block is not None:
        word, begin = block
        yield Slip(
            Edit(trouble.at, 0, (word,)),
            lambda: Diagnostic(
                "E0109",
                f"'end' is followed by the keyword of what ends: '{word}'",
                trouble.gap(),
                expected=f"'end {word};'",
                found=found(trouble),
                labels=(Label(trouble.span(begin), "begins here"),),
            ),
        )


def _not_closed(trouble: Trouble, what: str, expected: str, begin: int, at: int) -> Diagnostic:
    words = trouble.tokens.symbols[max(0, begin - 1) : at]
    is_else_if = ("else", "if") in zip(words, words[1:], strict=False)
    hint = "'else if' opens another 'if'; the word for a further case is 'elseif'" if is_else_if else ""
    return Diagnostic(
        "E0109",
        f"{what} is not closed: {expected} is missing",
        trouble.span(at) if trouble.tokens.texts[at] else trouble.gap(at),
        expected=expected,
        found=found(trouble, at),
        hint=hint,
        labels=(Label(trouble.span(begin), "begins here"),),
    )


def missing_end_name(trouble: Trouble) -> Iterator[Slip]:
    """``end;`` where the name of the class belongs behind it."""
    owner = next(_open_classes(trouble, trouble.at), None)
    if trouble.before == "end" and owner is not None:
        yield Slip(
            Edit(trouble.at, 0, ("IDENT",), owner[0]),
            lambda: Diagnostic(
                "E0108",
                f"'end' is followed by the name of what ends: '{owner[0]}'",
                trouble.gap(),
                expected=f"'end {owner[0]};'",
                found=found(trouble),
            ),
        )


def stray_end(trouble: Trouble) -> Iterator[Slip]:
    """An ``end`` that closes nothing."""
    if trouble.found == "end":
        for last in (trouble.at + 2, trouble.at + 1):  # with the name and the ';', or one of them
            if last < len(trouble.tokens.symbols) - 1:
                yield Slip(
                    Edit(trouble.at, last - trouble.at + 1, ()),
                    lambda last=last: Diagnostic("E0109", "this 'end' closes nothing", trouble.span(trouble.at, last)),
                )


# ----------------------------------------------------------------- brackets


def brackets(trouble: Trouble) -> Iterator[Slip]:
    """A bracket that is not closed, several of them, or one that was never opened."""
    openers = _open_brackets(trouble)
    if not openers:
        if trouble.found in _PARTNER.values():
            yield Slip(
                Edit(trouble.at, 1, ()),
                lambda: Diagnostic("E0103", f"'{trouble.found}' has no partner before it", trouble.span()),
            )
        return
    closer = _PARTNER[openers[0].symbol]
    one = partial(_unclosed, trouble, openers[:1])
    if trouble.found in _PARTNER.values() and trouble.found != closer:
        yield Slip(Edit(trouble.at, 1, (closer,)), one)
    if trouble.found != ",":
        yield Slip(Edit(trouble.at, 0, (closer,)), one)
    if trouble.breaks_line:
        yield Slip(Edit(trouble.at, 0, (closer, ";")), one)
    if trouble.before == ";":
        yield Slip(Edit(trouble.at - 1, 0, (closer,)), one)
    if trouble.found == ";" and len(openers) > 1:
        closers = tuple(_PARTNER[node.symbol] for node in openers)
        yield Slip(Edit(trouble.at, 0, closers), partial(_unclosed, trouble, openers))


def _unclosed(trouble: Trouble, openers: Sequence[StackNode]) -> Diagnostic:
    signs = "".join(node.symbol for node in reversed(openers))
    return Diagnostic(
        "E0103",
        f"'{signs[:_MOST_SIGNS]}' {'is' if len(openers) == 1 else 'are'} not closed",
        trouble.gap(),
        expected=f"'{''.join(_PARTNER[node.symbol] for node in openers)[:_MOST_SIGNS]}'",
        found=found(trouble),
        labels=tuple(Label(trouble.span(node.token), "opened here") for node in openers[:3]),
    )
