"""Syntax in words a person uses: what was found, what could stand at a place, what a ';' would end."""

from __future__ import annotations

from lmoc.syntax.tables import END_OF_TEXT
from lmoc.syntax.trouble import Trouble

# What a ';' ends, by the rules that it completes.
_ENDED = {
    "component_clause": "the declaration",
    "import_one": "the import",
    "import_all": "the import",
    "import_alias": "the import",
    "import_some": "the import",
    "extends_clause": "'extends'",
    "class_annotation": "the annotation",
    "equality": "the equation",
    "wrong_equality": "the equation",
    "lone_expression": "the equation",
    "connect": "'connect'",
    "assignment": "the statement",
    "wrong_assignment": "the statement",
    "lone_statement": "the statement",
    "return_statement": "'return'",
    "break_statement": "'break'",
    "short_class": "the definition",
    "enumeration": "the definition",
}
# Sets of symbols with a name of their own: where all are possible, the name stands for them and for all of the second.
_CLASS_WORDS = {"class", "model", "block", "connector", "type", "record", "package", "function"}
_PREFIXES = set(
    "redeclare final inner outer replaceable encapsulated partial flow stream discrete parameter constant input output "
    "expandable operator pure impure each".split()
)
_DECLARATION = _CLASS_WORDS | _PREFIXES | {"IDENT", ".", "import", "extends", "annotation"}
_EXPRESSION = set("IDENT NUMBER STRING true false ( { [ INDEX_END not + - .+ .- . if der initial".split())
_OPERATORS = set("+ - * / ^ .+ .- .* ./ .^ < <= > >= == <> and or :".split())
_SECTIONS = {
    "public", "protected", "equation", "algorithm", "_INITIAL_EQUATION", "_INITIAL_ALGORITHM", "external",
}  # fmt: skip
_CONCEPTS = (
    ({"connect", "for", "when"}, _EXPRESSION | {"connect", "for", "when", "if", "annotation"}, "an equation"),
    ({"while", "break"}, _EXPRESSION | {"while", "break", "return", "for", "when", "if", "annotation"}, "a statement"),
    ({"IDENT", "parameter", "model", "import"}, _DECLARATION, "a declaration"),
    ({"model", "package"}, _CLASS_WORDS | _PREFIXES, "a class (for instance 'model Name')"),
    ({"IDENT", "NUMBER", "("}, _EXPRESSION, "an expression"),
    ({"+", "*", "<"}, _OPERATORS, "an operator"),
    ({"equation", "algorithm"}, _SECTIONS, "'equation'"),
)  # fmt: skip
_NAMES = {
    "IDENT": "a name",
    "NUMBER": "a number",
    "STRING": "a description in quotes",
    END_OF_TEXT: "the end of the text",
    "INDEX_END": "'end'",
    "_INITIAL_EQUATION": "'initial equation'",
    "_INITIAL_ALGORITHM": "'initial algorithm'",
}


def is_word(symbol: str) -> bool:
    """Return whether a symbol is a keyword."""
    return symbol[0].islower()


def found(trouble: Trouble, token: int | None = None) -> str:
    """A token (the wrong one by default) in words."""
    token = trouble.at if token is None else token
    symbol, text = trouble.tokens.symbols[token], trouble.tokens.texts[token]
    if symbol == END_OF_TEXT:  # or that of the part that is read
        ends = trouble.tokens.ends[token] == len(trouble.source.text) and not trouble.source.goes_on
        return _NAMES[symbol] if ends else "the next class"
    if symbol == "STRING":
        return "a string"
    if symbol == "IDENT":
        return f"the name '{text.strip(chr(39))}'"
    if symbol == "NUMBER":
        return f"the number {text}"
    return f"'{text}'"


def completed(trouble: Trouble) -> str:
    """Return what a ';' would end here."""
    tokens = trouble.tokens
    if trouble.at > 1 and tokens.symbols[trouble.at - 2] == "end":
        return f"'end {tokens.texts[trouble.at - 1]}'"
    for rule in reversed(trouble.completed_by(";")):
        if rule in _ENDED:
            return _ENDED[rule]
    return f"'{tokens.texts[trouble.at - 1]}'"


def expectation(trouble: Trouble) -> str:
    """Return the tokens allowed at the place, in words."""
    possible = trouble.can_follow()
    words = []
    for needed, covered, name in _CONCEPTS:
        if needed <= possible:
            words.append(name)
            possible -= covered
    words += [_NAMES.get(symbol, f"'{symbol}'") for symbol in sorted(possible, key=_importance)]
    words = words[:6]
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " or " + words[-1]


def _importance(symbol: str) -> tuple[bool, bool, str]:
    """Names first, then punctuation, then keywords."""
    return (symbol not in _NAMES, is_word(symbol), symbol)
