"""Usual slips: for a place where the text cannot go on, what the writer probably meant.

Each function yields changes of the tokens that would repair one kind of slip there, with the diagnostic that explains
it. `lmoc.syntax.recovery` tries them in the order of `slips`.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterator

from lmoc.diagnostics import Diagnostic, Label
from lmoc.syntax.tables import END_OF_TEXT
from lmoc.syntax.trouble import Edit, Slip, Trouble
from lmoc.syntax.words import completed, expectation, found, is_word

_PARTNER = {"(": ")", "[": "]", "{": "}"}
_BLOCKS = {"for", "if", "when", "while"}
_OPERAND_ENDS = {"IDENT", "NUMBER", "STRING", ")", "]", "}", "true", "false"}
_OPERAND_STARTS = {"IDENT", "NUMBER", "(", "{", "der"}
_WANT_OPERAND = set("+ - * / ^ .+ .- .* ./ .^ < <= > >= == <> = := and or not ( [ { , : if then else elseif in".split())
_SIGNS = {"=": (":=", "=="), ":=": ("=",), "==": ("=", ":=")}
# So far back a misspelled keyword is looked for: it may have been taken for the name of a type.
_LOOK_BACK = 40


def slips(trouble: Trouble) -> Iterator[Slip]:
    """The changes that might repair a place, the most likely first."""
    for kind in (
        _missing_semicolon_at_line_end,
        _declaration_among_equations,
        _unclosed_block,
        _brackets,
        _wrong_sign,
        _keyword_as_name,
        _misspelled_keyword,
        _missing_section,
        _missing_end_name,
        _missing_operand,
        _missing_operator,
        _missing_word,
        _missing_semicolon,
        _stray_end,
        _missing_name,
        _stray_token,
    ):
        yield from kind(trouble)


def unexpected(trouble: Trouble) -> Diagnostic:
    """The plain message: this cannot stand here, that could."""
    return Diagnostic(
        "E0101",
        f"{found(trouble)} cannot stand here",
        trouble.span() if trouble.found != END_OF_TEXT else trouble.after_previous(),
        expected=expectation(trouble),
        found=found(trouble),
        hint=_hint(trouble),
    )


def _hint(trouble: Trouble) -> str:
    if trouble.found == "=" and "=" in trouble.tokens.symbols[trouble.statement_start() : trouble.at]:
        return "an equation has one '='; is a ';' missing on an earlier line?"
    if trouble.found == "if" and trouble.before == "=":
        return "an if-expression that is part of a larger one needs parentheses"
    return ""


def _insert(trouble: Trouble, *symbols: str) -> Edit:
    return Edit(trouble.at, 0, symbols)


# --------------------------------------------------------------- semicolons


def _missing_semicolon_at_line_end(trouble: Trouble) -> Iterator[Slip]:
    if trouble.breaks_line or trouble.found in ("end", END_OF_TEXT):
        yield from _missing_semicolon(trouble)


def _missing_semicolon(trouble: Trouble) -> Iterator[Slip]:
    def explain() -> Diagnostic:
        what = completed(trouble)
        return Diagnostic(
            "E0102",
            f"';' is missing after {what}",
            trouble.after_previous(),
            expected=f"';' after {what}",
            found=found(trouble),
        )

    yield Slip(_insert(trouble, ";"), explain)


# ------------------------------------------------------------ declarations


def _section_word(trouble: Trouble) -> str:
    """The word that opened the section of equations or statements around the place; empty outside of one."""
    for node in trouble.stack():
        if node.symbol in ("equation", "algorithm", "INITIAL_EQUATION", "INITIAL_ALGORITHM"):
            return trouble.tokens.texts[node.token]
        if node.symbol in ("public", "protected", "class_kind") or node.symbol in _BLOCKS:
            return ""
    return ""


def _declaration_among_equations(trouble: Trouble) -> Iterator[Slip]:
    start = trouble.statement_start()
    symbols = trouble.tokens.symbols
    section = _section_word(trouble)
    if not section or any(s not in ("IDENT", ".") for s in symbols[start : trouble.at]):
        return
    begins = {"parameter", "constant", "discrete", "input", "output", "flow", "final", "inner", "outer", "replaceable"}
    if not (trouble.found in begins and start == trouble.at) and not (trouble.found == "IDENT" and start < trouble.at):
        return
    if trouble.breaks_line and start < trouble.at:
        return
    try:
        stop = symbols.index(";", trouble.at) + 1
    except ValueError:
        return
    yield Slip(
        Edit(start, stop - start, ()),
        lambda: Diagnostic(
            "E0120",
            f"a declaration cannot stand below '{section}'",
            trouble.span(start, stop - 1),
            hint=f"put it before '{section}'",
        ),
    )


def _missing_section(trouble: Trouble) -> Iterator[Slip]:
    start = trouble.statement_start()
    word = "algorithm" if ":=" in trouble.tokens.symbols[start : trouble.at + 1] else "equation"
    for at in {start, trouble.at}:
        yield Slip(
            Edit(at, 0, (word,)),
            lambda at=at: Diagnostic(
                "E0122",
                f"'{word}' is missing before the first {'equation' if word == 'equation' else 'statement'}",
                trouble.span(at),
                expected=f"a declaration, or '{word}' on a line of its own",
                found=found(trouble),
            ),
        )


# ------------------------------------------------------------------- blocks


def _class_name(trouble: Trouble) -> tuple[str, int] | None:
    """Name and token of the innermost class that is not closed yet."""
    for node in trouble.stack():
        if node.symbol == "name" and node.below is not None and node.below.symbol == "class_kind":
            return trouble.tokens.texts[node.token], node.token
    return None


def _open_block(trouble: Trouble, token: int) -> tuple[str, int] | None:
    """Word and token of the innermost ``for``, ``if``, ``when``, ``while`` that is open before a token."""
    for node in trouble.stack(token):
        if node.symbol in _BLOCKS:
            return node.symbol, node.token
        if node.symbol == "class_kind":
            return None
    return None


def _unclosed_block(trouble: Trouble) -> Iterator[Slip]:
    at = trouble.at - 1 if trouble.before == "end" else trouble.at
    block = _open_block(trouble, at)
    if block is not None and (trouble.before == "end" or trouble.found in (END_OF_TEXT, "equation", "algorithm")):
        word, begin = block
        yield Slip(
            Edit(at, 0, ("end", word, ";")),
            lambda: _not_closed(trouble, f"'{word}'", f"'end {word};'", begin, at),
        )
        if trouble.before == "end" and trouble.found in _BLOCKS:
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
    owner = _class_name(trouble)
    if owner is not None and trouble.found == END_OF_TEXT:
        name, begin = owner
        for inserted in (("end", "IDENT", ";"), (";", "end", "IDENT", ";")):
            yield Slip(
                Edit(trouble.at, 0, inserted, name),
                lambda: _not_closed(trouble, f"'{name}'", f"'end {name};'", begin, trouble.at),
            )


def _not_closed(trouble: Trouble, what: str, expected: str, begin: int, at: int) -> Diagnostic:
    return Diagnostic(
        "E0109",
        f"{what} is not closed: {expected} is missing",
        trouble.span(at) if trouble.found != END_OF_TEXT else trouble.after_previous(),
        expected=expected,
        found=found(trouble, at),
        labels=(Label(trouble.span(begin), "begins here"),),
    )


def _missing_end_name(trouble: Trouble) -> Iterator[Slip]:
    owner = _class_name(trouble)
    if trouble.before == "end" and owner is not None:
        yield Slip(
            Edit(trouble.at, 0, ("IDENT",), owner[0]),
            lambda: Diagnostic(
                "E0108",
                f"after 'end' stands the name of what ends: '{owner[0]}'",
                trouble.after_previous(),
                expected=f"'end {owner[0]};'",
                found=found(trouble),
            ),
        )


def _stray_end(trouble: Trouble) -> Iterator[Slip]:
    if trouble.found == "end":
        for removed in (3, 2):
            last = min(trouble.at + removed, len(trouble.tokens.symbols)) - 1
            yield Slip(
                Edit(trouble.at, removed, ()),
                lambda last=last: Diagnostic("E0109", "this 'end' closes nothing", trouble.span(trouble.at, last)),
            )


# ----------------------------------------------------------------- brackets


def _brackets(trouble: Trouble) -> Iterator[Slip]:
    opener = next((node for node in trouble.stack() if node.symbol in _PARTNER), None)
    closers = set(_PARTNER.values())
    if opener is None:
        if trouble.found in closers:
            yield Slip(
                Edit(trouble.at, 1, ()),
                lambda: Diagnostic("E0103", f"'{trouble.found}' has no partner before it", trouble.span()),
            )
        return
    closer = _PARTNER[opener.symbol]

    def explain() -> Diagnostic:
        return Diagnostic(
            "E0103",
            f"'{opener.symbol}' is not closed",
            trouble.after_previous(),
            expected=f"'{closer}'",
            found=found(trouble),
            labels=(Label(trouble.span(opener.token), "opened here"),),
        )

    if trouble.found in closers and trouble.found != closer:
        yield Slip(Edit(trouble.at, 1, (closer,)), explain)
    if trouble.found != ",":
        yield Slip(_insert(trouble, closer), explain)
    if trouble.breaks_line:
        yield Slip(_insert(trouble, closer, ";"), explain)


# -------------------------------------------------------------------- words


def _wrong_sign(trouble: Trouble) -> Iterator[Slip]:
    for sign in _SIGNS.get(trouble.found, ()):
        yield Slip(
            Edit(trouble.at, 1, (sign,)),
            lambda sign=sign: Diagnostic(
                "E0107",
                f"'{trouble.found}' instead of '{sign}'",
                trouble.span(),
                expected=f"'{sign}'",
                found=f"'{trouble.found}'",
            ),
        )


def _keyword_as_name(trouble: Trouble) -> Iterator[Slip]:
    word = trouble.found
    if not is_word(word):
        return
    yield Slip(
        Edit(trouble.at, 1, ("IDENT",), word),
        lambda: Diagnostic(
            "E0110",
            f"'{word}' is a word of the language and cannot be a name",
            trouble.span(),
            expected="a name",
            found=f"the keyword '{word}'",
            hint=f"take another name, or write it in quotes: \"'{word}'\"",
        ),
    )


def _misspelled_keyword(trouble: Trouble) -> Iterator[Slip]:
    tokens, words = trouble.tokens, [s for s in trouble.tables.literals if is_word(s)]
    for at in range(trouble.at, max(-1, trouble.at - _LOOK_BACK), -1):
        if tokens.symbols[at] != "IDENT":
            continue
        for word in difflib.get_close_matches(tokens.texts[at], words, n=2, cutoff=0.75):
            yield Slip(
                Edit(at, 1, (word,)),
                lambda at=at, word=word: Diagnostic(
                    "E0112",
                    f"'{tokens.texts[at]}' should probably be '{word}'",
                    trouble.span(at),
                    hint=f"did you mean '{word}'?",
                ),
            )


def _missing_word(trouble: Trouble) -> Iterator[Slip]:
    for word in ("then", "loop", "=", ":=", ",", "else", "in"):
        yield Slip(
            _insert(trouble, word),
            lambda word=word: Diagnostic(
                "E0101",
                f"'{word}' is missing",
                trouble.after_previous(),
                expected=f"'{word}'",
                found=found(trouble),
            ),
        )


# ----------------------------------------------------------------- operands


def _missing_operand(trouble: Trouble) -> Iterator[Slip]:
    if trouble.before in _WANT_OPERAND:
        where = trouble.tokens.texts[trouble.at - 1]
        yield Slip(
            _insert(trouble, "IDENT"),
            lambda: Diagnostic(
                "E0117",
                f"something is missing after '{where}'",
                trouble.after_previous(),
                expected=expectation(trouble),
                found=found(trouble),
            ),
        )


def _missing_operator(trouble: Trouble) -> Iterator[Slip]:
    if trouble.before in _OPERAND_ENDS and trouble.found in _OPERAND_STARTS:
        yield Slip(
            _insert(trouble, "*"),
            lambda: Diagnostic(
                "E0119",
                f"an operator is missing between '{_text(trouble, -1)}' and '{_text(trouble, 0)}'",
                trouble.after_previous(),
                hint="a product is written with '*'",
            ),
        )


def _text(trouble: Trouble, offset: int) -> str:
    return trouble.tokens.texts[trouble.at + offset]


def _missing_name(trouble: Trouble) -> Iterator[Slip]:
    yield Slip(
        _insert(trouble, "IDENT"),
        lambda: Diagnostic(
            "E0101",
            "a name is missing",
            trouble.after_previous(),
            expected=expectation(trouble),
            found=found(trouble),
        ),
    )


def _stray_token(trouble: Trouble) -> Iterator[Slip]:
    if trouble.found != END_OF_TEXT:
        yield Slip(Edit(trouble.at, 1, ()), lambda: unexpected(trouble))
