"""Usual slips: for a place where the text cannot go on, what the writer probably meant.

Each function yields changes of the tokens that would repair one kind of slip there, with the diagnostic that explains
it. `lmoc.syntax.recovery` tries them in the order of `slips`.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from functools import lru_cache, partial

from lmoc.expression.functions import CALLABLE
from lmoc.expression.units import Unit, UnitError, parse_unit, unit_text
from lmoc.messages.diagnostics import Diagnostic
from lmoc.syntax.tables import END_OF_TEXT
from lmoc.syntax.trouble import FRESH, Edit, Slip, Trouble
from lmoc.syntax.unclosed import (
    BLOCKS,
    brackets,
    missing_block_word,
    missing_end_name,
    stray_end,
    unclosed_block,
    unclosed_class,
)
from lmoc.syntax.words import completed, expectation, found, is_word

_OPERAND_ENDS = {"IDENT", "NUMBER", "STRING", ")", "]", "}", "true", "false"}
_OPERAND_STARTS = {"IDENT", "NUMBER", "(", "{", "der"}
WANT_OPERAND = set("+ - * / ^ .+ .- .* ./ .^ < <= > >= == <> = := and or not ( [ { , : if then else elseif in".split())
_SIGNS = {"=": (":=", "in", "=="), ":=": ("=", "in"), "==": ("=", ":=")}
_CONDITIONS = {"if", "elseif", "when", "elsewhen", "while", "("}
_DECLARES = {"parameter", "constant", "discrete", "input", "output", "flow", "final", "inner", "outer", "replaceable"}
_OF_UNITS = {"IDENT", "NUMBER", "*", "/", "^", ".", "(", ")", "[", "]"}
_FUNCTIONS = {"der", "pre", *CALLABLE}
_ATTRIBUTES = set("start fixed unit min max nominal stateSelect displayUnit quantity".split())
# So far back a misspelled keyword is looked for: it may have been taken for the name of a type.
_LOOK_BACK = 40


def slips(trouble: Trouble) -> Iterator[Slip]:
    """The changes that might repair a place, the most likely first."""
    for kind in (
        _capitalized_keyword,
        _semicolon_after_section,
        _decimal_comma,
        _unit_behind_a_number,
        _subscripts_of_a_number,
        _missing_semicolon_at_line_end,
        _missing_semicolon_before,
        _declaration_among_equations,
        missing_block_word,
        unclosed_block,
        unclosed_class,
        brackets,
        _wrong_sign,
        _keyword_as_name,
        _misspelled_keyword,
        _missing_section,
        missing_end_name,
        _bare_if,
        _missing_operand,
        _missing_operator,
        _missing_word,
        _missing_semicolon,
        stray_end,
        _missing_name,
        _stray_token,
    ):
        yield from kind(trouble)


def unexpected(trouble: Trouble) -> Diagnostic:
    """The plain message: this cannot stand here, that could."""
    return Diagnostic(
        "E0101",
        f"{found(trouble)} is not allowed here",
        trouble.span() if trouble.found != END_OF_TEXT else trouble.gap(),
        expected=expectation(trouble),
        found=found(trouble),
        hint=_hint(trouble),
    )


def _hint(trouble: Trouble) -> str:
    if trouble.found == "=" and "=" in trouble.tokens.symbols[trouble.statement_start() : trouble.at]:
        return "an equation has one '='; is a ';' missing on an earlier line?"
    if trouble.found == "if":
        return "an if-expression inside a larger expression needs parentheses"
    if trouble.found == "NUMBER" and "IDENT" in trouble.can_follow():
        decimal = trouble.before == "," and trouble.tokens.symbols[trouble.at - 2] == "NUMBER"
        return "a decimal number has a point: 1.5" if decimal else "a name begins with a letter"
    if trouble.before in ("der", "connect"):
        return "'connect(a, b)' joins two connectors" if trouble.before == "connect" else "a derivative is 'der(x)'"
    if trouble.found in ("{", "}", ":", ";") and "end" in trouble.can_follow():
        return "a class is written 'model Name … end Name;', with nothing after its name and no braces"
    if trouble.at == 0:
        return "everything belongs inside a class: 'model Name', its parts and equations, 'end Name;'"
    return ""


def _insert(trouble: Trouble, *symbols: str) -> Edit:
    return Edit(trouble.at, 0, symbols)


# --------------------------------------------------------------- semicolons


def _missing_semicolon_at_line_end(trouble: Trouble) -> Iterator[Slip]:
    if trouble.breaks_line or trouble.found in ("end", END_OF_TEXT):
        yield from _missing_semicolon(trouble)


def _missing_semicolon(trouble: Trouble) -> Iterator[Slip]:
    yield Slip(_insert(trouble, ";"), lambda: _no_semicolon(trouble, completed(trouble), trouble.at))


def _missing_semicolon_before(trouble: Trouble) -> Iterator[Slip]:
    """A line that begins with a sign or a parenthesis goes on with the one above: ``der(x) = v`` / ``-k*x = f;``."""
    for token in range(trouble.at - 1, trouble.statement_start(), -1):
        if trouble.breaks_before(token):
            yield Slip(
                Edit(token, 0, (";",)),
                lambda token=token: _no_semicolon(trouble, f"'{trouble.tokens.texts[token - 1]}'", token),
            )


def _no_semicolon(trouble: Trouble, what: str, token: int) -> Diagnostic:
    return Diagnostic(
        "E0102",
        f"';' is missing after {what}",
        trouble.gap(token),
        expected=f"';' after {what}",
        found=found(trouble, token),
    )


def _semicolon_after_section(trouble: Trouble) -> Iterator[Slip]:
    """``equation;``"""
    word = trouble.tokens.texts[trouble.at - 1] if trouble.at else ""
    if trouble.found == ";" and trouble.before in FRESH | {"then", "else", "loop"} and trouble.before != "end":
        explain = partial(Diagnostic, "E0101", f"there is no ';' after '{word}'", trouble.span(), hint="leave it out")
        yield Slip(Edit(trouble.at, 1, ()), explain)


# ----------------------------------------------------------------- numbers


def _decimal_comma(trouble: Trouble) -> Iterator[Slip]:
    """``k = 50,5``"""
    symbols, at = trouble.tokens.symbols, trouble.at
    if at > 1 and symbols[at - 2 : at + 1] == ["NUMBER", ",", "NUMBER"]:
        whole, digits = _text(trouble, -2), _text(trouble, 0)
        message, hint = f"'{whole},{digits}' is no number", f"a decimal number has a point: {whole}.{digits}"
        place = trouble.span(at - 2, at)
        yield Slip(Edit(at - 1, 2, ()), partial(Diagnostic, "E0101", message, place, hint=hint))


def _unit_behind_a_number(trouble: Trouble) -> Iterator[Slip]:
    """``50 N/m``, ``2kg``, ``50 [N/m]``"""
    if trouble.before != "NUMBER" or trouble.breaks_line or trouble.found not in ("IDENT", "[", "("):
        return
    symbols, at = trouble.tokens.symbols, trouble.at
    stop = at
    while symbols[stop] in _OF_UNITS:
        stop += 1
    for end in range(stop, at, -1):
        text = "".join(trouble.tokens.texts[at:end])
        unit = _unit(text)
        if unit is not None and symbols[end] not in ("*", "/", "^", "."):  # 2 m*x is a product
            explain = partial(_no_unit_here, trouble, end - 1, text, unit)
            yield Slip(Edit(at, end - at, ()), explain, sure=True)
            return


def _unit(text: str) -> Unit | None:
    """A unit as people write it behind a number; None where it is none."""
    bare = text[1:-1] if text[0] + text[-1] in ("[]", "()") else text
    try:
        return parse_unit(bare.replace("*", ".").replace("^", "")) if bare[:1].isalpha() else None
    except UnitError:
        return None


def _no_unit_here(trouble: Trouble, last: int, unit: str, meaning: Unit) -> Diagnostic:
    """In SI units the number may be another one."""
    given = _text(trouble, -1)
    bare = unit.strip("[]()").replace("*", ".").replace("^", "")
    if abs(meaning.factor - 1) > 1e-12 and bare not in ("degC", "degF"):
        bare = unit_text(Unit(meaning.exponents)) if any(meaning.exponents) else "rad"  # deg, rev
        number, same = f"{float(given) * meaning.factor:.6g}", f" (in {bare})"
    else:
        number, same = given, ""
    product = f"; a product is written with '*': {given}*{unit}" if last == trouble.at else ""
    return Diagnostic(
        "E0125",
        f"a number has no unit here: '{given} {unit}'",
        trouble.span(trouble.at, last),
        hint=f"write {number}{same}; parameters and variables have units: Real k(unit = \"{bare}\"){product}",
    )


def _subscripts_of_a_number(trouble: Trouble) -> Iterator[Slip]:
    """``3[:]``"""
    symbols, at = trouble.tokens.symbols, trouble.at
    if trouble.found != "[" or trouble.before not in ("NUMBER", "STRING", "true", "false", ")", "}"):
        return
    depth, stop = 0, at
    while symbols[stop] != END_OF_TEXT and (depth or stop == at):
        depth += (symbols[stop] == "[") - (symbols[stop] == "]")
        stop += 1
    message = f"'{_text(trouble, -1)}' cannot have subscripts"
    hint = "only names have subscripts" + (": name the array first" if trouble.before in ")}" else "")
    yield Slip(Edit(at, stop - at, ()), partial(Diagnostic, "E0101", message, trouble.span(at, stop - 1), hint=hint))


# ------------------------------------------------------------ declarations


def _section_word(trouble: Trouble) -> str:
    """The word that opened the section of equations or statements around the place; empty outside of one."""
    for node in trouble.stack():
        if node.symbol in ("equation", "algorithm", "_INITIAL_EQUATION", "_INITIAL_ALGORITHM"):
            return trouble.tokens.texts[node.token]
        if node.symbol in ("public", "protected", "class_kind") or node.symbol in BLOCKS:
            return ""
    return ""


def _declaration_among_equations(trouble: Trouble) -> Iterator[Slip]:
    section = _section_word(trouble)
    start = trouble.statement_start()
    if not section or start == trouble.at and trouble.found not in _DECLARES:
        return
    stop = start
    while (end := _declaration_end(trouble, stop)) is not None:
        stop = end
    if stop > trouble.at:
        yield Slip(
            Edit(start, stop - start, ()),
            lambda: Diagnostic(
                "E0120",
                f"a declaration is not allowed below '{section}'",
                trouble.span(start, stop - 1),
                hint=f"put it before '{section}'",
            ),
        )


def _declaration_end(trouble: Trouble, token: int) -> int | None:
    """The token after a declaration that begins at a token; None if what begins there is none."""
    symbols = trouble.tokens.symbols
    at = token
    while symbols[at] in _DECLARES:
        at += 1
    while symbols[at] == "IDENT" and symbols[at + 1] == ".":
        at += 2
    if symbols[at : at + 2] != ["IDENT", "IDENT"] or trouble.breaks_before(at + 1) or ";" not in symbols[at:]:
        return None
    return symbols.index(";", at) + 1


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


# -------------------------------------------------------------------- words


def _wrong_sign(trouble: Trouble) -> Iterator[Slip]:
    for sign in _SIGNS.get(trouble.found, ()):
        if sign == "==" and not any(node.symbol in _CONDITIONS for node in trouble.stack()):
            continue
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
    if word == "break" and any(node.symbol == "extends" for node in trouble.stack()):
        said = "an 'extends' that leaves elements out ('break') is not part of lmo"
        yield Slip(Edit(trouble.at, 1, ("IDENT",), word), lambda: Diagnostic("E0116", said, trouble.span()))
    yield Slip(
        Edit(trouble.at, 1, ("IDENT",), word),
        lambda: Diagnostic(
            "E0110",
            f"'{word}' is a word of the language and cannot be a name",
            trouble.span(),
            expected="a name",
            found=f"the keyword '{word}'",
            hint=f"use another name, or write it in quotes: \"'{word}'\"",
        ),
    )


def _capitalized_keyword(trouble: Trouble) -> Iterator[Slip]:
    """``End M;`` reads as a declaration: it is noticed when the text is over."""
    tokens = trouble.tokens
    for at in range(trouble.at, max(-1, trouble.at - _LOOK_BACK), -1):
        word = tokens.texts[at].lower()
        if tokens.symbols[at] == "IDENT" and word != tokens.texts[at] and word in trouble.tables.literals:
            yield Slip(Edit(at, 1, (word,)), partial(_misspelled, trouble, at, word))


def _misspelled_keyword(trouble: Trouble) -> Iterator[Slip]:
    tokens = trouble.tokens
    words = frozenset(s for s in trouble.tables.literals if is_word(s))
    for at in range(trouble.at, max(-1, trouble.at - _LOOK_BACK), -1):
        if tokens.symbols[at] != "IDENT":
            continue
        for word in _alike(tokens.texts[at], words):
            yield Slip(Edit(at, 1, (word,)), partial(_misspelled, trouble, at, word))


@lru_cache(maxsize=4096)
def _alike(text: str, words: frozenset[str]) -> list[str]:
    """The words that a text is like; asked for the same names again and again while a text is repaired."""
    return difflib.get_close_matches(text, words, n=2, cutoff=0.75)


def _misspelled(trouble: Trouble, at: int, word: str) -> Diagnostic:
    text = trouble.tokens.texts[at]
    return Diagnostic(
        "E0112", f"'{text}' should probably be '{word}'", trouble.span(at), hint=f"did you mean '{word}'?"
    )


def _missing_word(trouble: Trouble) -> Iterator[Slip]:
    def explain(word: str) -> Diagnostic:
        return Diagnostic(
            "E0101",
            f"'{word}' is missing",
            trouble.gap(),
            expected=f"'{word}'",
            found=found(trouble),
            hint=_hint_for_missing(trouble, word),
        )

    for inserted in (("then",), ("loop",), (",",), ("=",), (":=",), ("in",), ("else", "IDENT"), (",", "IDENT")):
        yield Slip(_insert(trouble, *inserted), lambda word=inserted[0]: explain(word))


def _hint_for_missing(trouble: Trouble, word: str) -> str:
    if word == "else":
        return "an if-expression has a value in every case: 'if c then a else b'"
    if word == "," and any(node.symbol == "connect" for node in trouble.stack()):
        return "'connect(a, b)' joins two connectors"
    if word == "," and trouble.before == "STRING" and trouble.found == "=":
        return "a description follows the value: 'x = 1 \"what it is\"'"
    if word == "," and trouble.tokens.texts[trouble.at] in _ATTRIBUTES:
        return f"attributes are written in parentheses: '{_text(trouble, -1)}({_text(trouble, 0)} = ...)'"
    return ""


# ----------------------------------------------------------------- operands


def _bare_if(trouble: Trouble) -> Iterator[Slip]:
    """``1 + if c then a else b``: what follows up to the end of the statement is taken for one operand."""
    symbols = trouble.tokens.symbols
    if trouble.found == "if" and not trouble.breaks_line and ";" in symbols[trouble.at :]:
        stop = symbols.index(";", trouble.at)
        yield Slip(Edit(trouble.at, stop - trouble.at, ("IDENT",)), lambda: unexpected(trouble))


def _missing_operand(trouble: Trouble) -> Iterator[Slip]:
    if trouble.before in WANT_OPERAND:
        where = trouble.tokens.texts[trouble.at - 1]
        yield Slip(
            _insert(trouble, "IDENT"),
            lambda: Diagnostic(
                "E0117",
                f"something is missing after '{where}'",
                trouble.gap(),
                expected=expectation(trouble),
                found=found(trouble),
            ),
        )


def _missing_operator(trouble: Trouble) -> Iterator[Slip]:
    if trouble.before in _OPERAND_ENDS and trouble.found in _OPERAND_STARTS:
        left, right = _text(trouble, -1), _text(trouble, 0)
        call = f"a call needs parentheses: '{left}({right})'"
        yield Slip(
            _insert(trouble, "*"),
            lambda: Diagnostic(
                "E0119",
                f"an operator is missing between '{left}' and '{right}'",
                trouble.gap(),
                hint=call if left in _FUNCTIONS else "a product is written with '*'",
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
            trouble.gap(),
            expected=expectation(trouble),
            found=found(trouble),
            hint=_hint_for_type(trouble),
        ),
    )


def _hint_for_type(trouble: Trouble) -> str:
    """``parameter k = 3``: the only name there is would be the type."""
    prefix, name = trouble.tokens.texts[trouble.at - 2 : trouble.at] if trouble.at > 1 else ("", "")
    return f"the type precedes the name: '{prefix} Real {name}'" if prefix in _DECLARES else ""


def _stray_token(trouble: Trouble) -> Iterator[Slip]:
    if trouble.found != END_OF_TEXT:
        yield Slip(Edit(trouble.at, 1, ()), lambda: unexpected(trouble))
