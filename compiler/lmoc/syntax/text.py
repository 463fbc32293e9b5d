"""Expressions and modifications as text, with as few parentheses as the grammar needs."""

from __future__ import annotations

import re
from collections.abc import Iterable

from lmoc.syntax import tree
from lmoc.syntax.expressions import unescape

# Levels of the grammar: an operand printed below the level that its place asks for gets parentheses.
_ANY, _RANGE, _OR, _AND, _NOT, _RELATION, _SUM, _TERM, _FACTOR, _PRIMARY = range(10)
_BINARY = {
    "or": (_OR, _OR, _AND),
    "and": (_AND, _AND, _NOT),
    **dict.fromkeys(("<", "<=", ">", ">=", "==", "<>"), (_RELATION, _SUM, _SUM)),
    **dict.fromkeys(("+", "-", ".+", ".-"), (_SUM, _SUM, _TERM)),
    **dict.fromkeys(("*", "/", ".*", "./"), (_TERM, _TERM, _FACTOR)),
    **dict.fromkeys(("^", ".^"), (_FACTOR, _PRIMARY, _PRIMARY)),
}  # level of the whole, of the left and of the right operand
_NUMBER = re.compile(r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
_TIGHT = {"*", "/", "^"}
# Functions that take an iterator as their argument; elsewhere it appears in braces.
_REDUCTIONS = {"sum", "product", "min", "max", "array"}
_ESCAPES = {"\\": "\\\\", '"': '\\"', "\t": "\\t", "\r": "\\r", "\a": "\\a", "\b": "\\b", "\f": "\\f", "\v": "\\v"}


def expression(e: tree.Expression | None, level: int = _ANY) -> str:
    """An expression as text; `level` is the least tight operator that can stand there without parentheses."""
    own, text = _LAYOUT[type(e)](e)
    return f"({text})" if own < level else text


def simple(e: tree.Expression) -> str:
    """An expression where an ``if`` needs parentheses: a side of an equation, an assigned variable."""
    return expression(e, _RANGE)


def quote(text: str) -> str:
    """A string literal; line breaks stay as they are."""
    return '"' + "".join(_ESCAPES.get(c, c) for c in text) + '"'


def subscripts(items: Iterable[tree.Expression]) -> str:
    """``[a, b]``; empty where there are none."""
    text = _list(items)
    return f"[{text}]" if text else ""


def indices(items: Iterable[tree.ForIndex]) -> str:
    """``i in r, j in s``."""
    return ", ".join(i.name if i.range is None else f"{i.name} in {expression(i.range)}" for i in items)


def _list(items: Iterable[tree.Expression]) -> str:
    return ", ".join(map(expression, items))


def _number(e: tree.Number) -> tuple[int, str]:
    written = e.span.text
    if _NUMBER.fullmatch(written) and float(written) == e.value and written.isdigit() == e.integer:
        return _PRIMARY, written  # 1e3 stays 1e3
    return _PRIMARY, str(int(e.value)) if e.integer else repr(e.value)


def _string(e: tree.String) -> tuple[int, str]:
    written = e.span.text
    same = len(written) > 1 and written[0] == written[-1] == '"' and unescape(written) == e.value
    return _PRIMARY, written if same else quote(e.value)


def _reference(e: tree.Ref) -> tuple[int, str]:
    return _PRIMARY, "." * e.absolute + ".".join(part.name + subscripts(part.subscripts) for part in e.parts)


def _unary(e: tree.Unary) -> tuple[int, str]:
    if e.op == "not":
        return _NOT, f"not {expression(e.operand, _RELATION)}"
    return _SUM, e.op + expression(e.operand, _TERM)


def _binary(e: tree.Binary) -> tuple[int, str]:
    whole, parts = _BINARY[e.op][0], []
    while True:  # along the left operands: a sum may have thousands of terms
        _, left, right = _BINARY[e.op]
        space = "" if e.op in _TIGHT else " "
        parts.append(f"{space}{e.op}{space}{expression(e.right, right)}")
        if not isinstance(e.left, tree.Binary) or _BINARY[e.left.op][0] < left:
            break
        e = e.left
    return whole, expression(e.left, left) + "".join(reversed(parts))


def _choice(e: tree.If) -> tuple[int, str]:
    cases = " elseif ".join(f"{expression(condition)} then {expression(value)}" for condition, value in e.branches)
    return _ANY, f"if {cases} else {expression(e.otherwise)}"


def _range(e: tree.Range) -> tuple[int, str]:
    parts = (e.start, e.stop) if e.step is None else (e.start, e.step, e.stop)
    return _RANGE, ":".join(expression(part, _OR) for part in parts)


def _call(e: tree.Call) -> tuple[int, str]:
    function = expression(e.function)
    if len(e.arguments) == 1 and isinstance(e.arguments[0], tree.Comprehension) and function in _REDUCTIONS:
        return _PRIMARY, f"{function}({_iteration(e.arguments[0])})"
    named = [f"{name} = {expression(value)}" for name, value in e.named]
    return _PRIMARY, f"{function}({', '.join([*map(expression, e.arguments), *named])})"


def _iteration(e: tree.Comprehension) -> str:
    return f"{expression(e.element)} for {indices(e.indices)}"


def _comprehension(e: tree.Comprehension) -> tuple[int, str]:
    return _PRIMARY, f"{{{_iteration(e)}}}"


def _array(e: tree.Array) -> tuple[int, str]:
    return _PRIMARY, f"{{{_list(e.items)}}}"


def _matrix(e: tree.Matrix) -> tuple[int, str]:
    return _PRIMARY, f"[{'; '.join(map(_list, e.rows))}]"


def _results(e: tree.Tuple) -> tuple[int, str]:
    return _PRIMARY, f"({', '.join('' if item is None else expression(item) for item in e.items)})"


_LAYOUT = {
    tree.Number: _number,
    tree.String: _string,
    tree.Boolean: lambda e: (_PRIMARY, "true" if e.value else "false"),
    tree.Ref: _reference,
    tree.Unary: _unary,
    tree.Binary: _binary,
    tree.If: _choice,
    tree.Call: _call,
    tree.Comprehension: _comprehension,
    tree.Range: _range,
    tree.Array: _array,
    tree.Matrix: _matrix,
    tree.Colon: lambda e: (_PRIMARY, ":"),
    tree.EndSubscript: lambda e: (_PRIMARY, "end"),
    tree.Tuple: _results,
}


# ------------------------------------------------------------ modifications


def modification(m: tree.Modification | None) -> str:
    """``(a = 1) = value``, as it follows a name."""
    if m is None:
        return ""
    # `x()` is not `x`: an empty list stays.
    arguments = f"({', '.join(map(_argument, m.arguments))})" if m.arguments or m.value is None else ""
    value = f" = {expression(m.value)}" if m.value is not None else ""
    return arguments + value


def _argument(argument: tree.Argument) -> str:
    if isinstance(argument, tree.Redeclaration):
        each = "each " if argument.each else ""
        element = argument.element
        text = component(element) if isinstance(element, tree.Component) else short_class(element)
        return text.replace("redeclare ", f"redeclare {each}", 1) if element.redeclare else each + text
    prefixes = "each " * argument.each + "final " * argument.final
    text = ".".join(argument.name) + modification(argument.modification)
    return prefixes + text + description(argument.description)


def description(text: str, annotation: tree.Modification | None = None) -> str:
    """Return the text after a declaration or an equation, with the space before it."""
    shown = f" {quote(text)}" if text else ""
    return shown + (f" annotation{modification(annotation)}" if annotation is not None else "")


def external(e: tree.External) -> str:
    """Return the text after the word ``external``."""
    target = f" {expression(e.target)} =" if e.target is not None else ""
    return ' "builtin"' + target + (f" {expression(e.call)}" if e.call is not None else "")


# ------------------------------------------------------------- declarations


def prefixes(element: tree.Component | tree.Class) -> str:
    """The words before a declaration, with the space after them."""
    words = "redeclare final inner outer replaceable encapsulated partial pure expandable flow"
    found = [word for word in words.split() if getattr(element, word, False)]
    found += [word for word in (getattr(element, "variability", ""), getattr(element, "causality", "")) if word]
    return "".join(f"{word} " for word in found)


def component(*group: tree.Component) -> str:
    """A component clause, without ';': one declaration or several that share type and prefixes."""
    first = group[0]
    names = ", ".join(map(_declaration, group))
    return f"{prefixes(first)}{expression(first.type)} {names}{_constraint(first)}"


def _declaration(c: tree.Component) -> str:
    condition = f" if {expression(c.condition)}" if c.condition is not None else ""
    own = c.name + subscripts(c.dimensions) + modification(c.modification)
    return own + condition + description(c.description, c.annotation)


def _constraint(element: tree.Component | tree.Class) -> str:
    if element.constrained_by is None:
        return ""
    return f" constrainedby {expression(element.constrained_by)}{modification(element.constraint)}"


def short_class(c: tree.Class) -> str:
    """A class definition of one line, without ';'."""
    head = f"{prefixes(c)}{c.kind} {c.name} = "
    if c.literals is not None:
        descriptions = c.literal_descriptions or ("",) * len(c.literals)
        literals = ", ".join(name + description(text) for name, text in zip(c.literals, descriptions, strict=True))
        body = f"enumeration({literals})"
    else:
        causality = f"{c.short.causality} " if c.short.causality else ""
        body = causality + expression(c.short.base) + subscripts(c.short.dimensions)
        body += modification(c.short.modification)
    return head + body + description(c.description, c.annotation) + _constraint(c)
