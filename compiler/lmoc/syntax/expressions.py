"""Actions of the grammar's rules for expressions, names and modifications.

One method for each rule or alias of ``grammar/lmo.lark``, of the same name. A method takes the list of its symbols'
values and the range of characters that they cover. Tokens come as their text; what is no node of the tree (a name, a
comment, a list of subscripts) is a small value of its own type, so that optional parts can be told apart.
"""

from __future__ import annotations

import re
from collections import namedtuple
from math import inf
from typing import Any

from lmoc.messages.diagnostics import Report
from lmoc.messages.source import Source, Span
from lmoc.syntax import tree

# Made by hundreds of reductions, so plain named tuples: `typing.NamedTuple` takes 1 ms each to set up.
Word = namedtuple("Word", "text start end")  # a name, an operator or a prefix, and its place
Comment = namedtuple("Comment", "description annotation")


class Subscripts(list):
    """The items between ``[`` and ``]``."""


class Named(tuple):
    """A named argument of a call: a `Word` and an expression."""


_ESCAPE = r"\\([\s\S])"
_ESCAPES = {
    **{c: c for c in "'\"?\\"},
    **{"n": "\n", "t": "\t", "r": "\r", "a": "\a", "b": "\b", "f": "\f", "v": "\v"},
}


def unescape(literal: str) -> str:
    """The value of a string literal."""
    return re.sub(_ESCAPE, lambda match: _ESCAPES.get(match[1], match[1]), literal[1:-1])


class ExpressionActions:
    """Expressions, names, comments."""

    def __init__(self, source: Source, report: Report):
        self.source = source
        self.report = report

    def span(self, start: int, end: int) -> Span:
        return Span(self.source, start, end)

    # ------------------------------------------------------------- names

    def name(self, v: list, start: int, end: int) -> Word:
        return Word(v[0], start, end)

    def path(self, v: list, start: int, end: int) -> list[Word]:
        return v

    def type_name(self, v: list, start: int, end: int, absolute: bool = False) -> tree.Ref:
        source = self.source
        parts = tuple([tree.RefPart(n.text, (), Span(source, n.start, n.end)) for n in v[0]])
        return tree.Ref(parts, absolute, Span(source, start, end))

    def absolute_type_name(self, v: list, start: int, end: int) -> tree.Ref:
        return self.type_name(v, start, end, absolute=True)

    def reference(self, v: list, start: int, end: int) -> tree.Ref:
        return tree.Ref(tuple(v), False, Span(self.source, start, end))

    def absolute_reference(self, v: list, start: int, end: int) -> tree.Ref:
        return tree.Ref(tuple(v), True, Span(self.source, start, end))

    def part(self, v: list, start: int, end: int) -> tree.RefPart:
        subscripts = tuple(v[1]) if len(v) > 1 else ()
        return tree.RefPart(v[0].text, subscripts, Span(self.source, start, end))

    def subscripts(self, v: list, start: int, end: int) -> Subscripts:
        return Subscripts(v)

    def colon(self, v: list, start: int, end: int) -> tree.Colon:
        return tree.Colon(self.span(start, end))

    # ------------------------------------------------------------ comments

    def description(self, v: list, start: int, end: int) -> str:
        return "".join([self.unquote(s, start) for s in v])

    def annotation(self, v: list, start: int, end: int) -> tree.Modification:
        return v[0]

    def comment(self, v: list, start: int, end: int) -> Comment:
        description, annotation = "", None
        for value in v:
            if isinstance(value, str):
                description = value
            else:
                annotation = value
        return Comment(description, annotation)

    def unquote(self, literal: str, start: int) -> str:
        """The value of a string literal that stands at or after `start`, its escapes replaced."""
        if "\\" not in literal:
            return literal[1:-1]
        at = self.source.text.find(literal, start)
        for match in re.finditer(_ESCAPE, literal):
            if match[1] not in _ESCAPES:
                self.report.error(
                    "E0121",
                    f"'{match[0]}' has no meaning in a string",
                    self.span(at + match.start(), at + match.end()),
                    expected="one of \\\\ \\\" \\' \\? \\n \\t \\r \\a \\b \\f \\v",
                    hint="a backslash itself is written '\\\\'",
                )
        return unescape(literal)

    # ------------------------------------------------------------ literals

    def number(self, v: list, start: int, end: int) -> tree.Number:
        value = float(v[0])
        if value == inf:
            self.report.error("E0124", "this number is too large", self.span(start, end), expected="at most 1.8e308")
        return tree.Number(value, v[0].isdigit(), Span(self.source, start, end))

    def string(self, v: list, start: int, end: int) -> tree.String:
        return tree.String(self.unquote(v[0], start), self.span(start, end))

    def true(self, v: list, start: int, end: int) -> tree.Boolean:
        return tree.Boolean(True, self.span(start, end))

    def false(self, v: list, start: int, end: int) -> tree.Boolean:
        return tree.Boolean(False, self.span(start, end))

    def last(self, v: list, start: int, end: int) -> tree.EndSubscript:
        return tree.EndSubscript(self.span(start, end))

    # ----------------------------------------------------------- operators

    def _operator(self, v: list, start: int, end: int) -> Word:
        return Word(v[0], start, end)

    additive = multiplicative = power = relational = and_ = or_ = not_ = _operator

    def binary(self, v: list, start: int, end: int) -> tree.Binary:
        left, op, right = v
        return tree.Binary(op.text, left, right, Span(self.source, start, end))

    def unary(self, v: list, start: int, end: int) -> tree.Unary:
        op, operand = v
        if op.text in (".+", ".-"):
            op = Word(op.text[1], op.start, op.end)  # before a single operand the dot makes no difference
        return tree.Unary(op.text, operand, Span(self.source, start, end))

    def wrong_signed_factor(self, v: list, start: int, end: int) -> tree.Binary:
        left, op, sign, operand = v
        at, stop = sign.start, operand.span.end
        self.report.error(
            "E0115",
            f"a sign directly after '{op.text}' needs parentheses",
            self.span(at, stop),
            hint=f"write '{op.text} ({self.source.text[at:stop]})'",
        )
        right = self.unary([sign, operand], at, stop)
        return self.binary([left, op, right], start, end)

    wrong_signed_exponent = wrong_signed_term = wrong_signed_factor

    def wrong_power(self, v: list, start: int, end: int) -> tree.Expression:
        self.report.error(
            "E0114",
            f"'{v[1].text}' cannot be chained: the order is not fixed",
            self.span(start, end),
            hint="write '(a^b)^c' or 'a^(b^c)'",
        )
        return self._chain(v, start)

    def wrong_relation(self, v: list, start: int, end: int) -> tree.Expression:
        self.report.error(
            "E0114",
            f"comparisons cannot be chained: '{v[1].text}' gives true or false",
            self.span(start, end),
            hint="write 'a < b and b < c'",
        )
        return self._chain(v, start)

    def _chain(self, v: list, start: int) -> tree.Expression:
        result = v[0]
        for op, right in zip(v[1::2], v[2::2], strict=True):
            result = tree.Binary(op.text, result, right, self.span(start, right.span.end))
        return result

    # -------------------------------------------------------- larger ones

    def branch(self, v: list, start: int, end: int) -> tuple:
        return tuple(v)

    def if_expression(self, v: list, start: int, end: int) -> tree.If:
        return tree.If(tuple(v[:-1]), v[-1], self.span(start, end))

    def range(self, v: list, start: int, end: int) -> tree.Range:
        return tree.Range(v[0], None, v[1], self.span(start, end))

    def stepped_range(self, v: list, start: int, end: int) -> tree.Range:
        return tree.Range(v[0], v[1], v[2], self.span(start, end))

    def array(self, v: list, start: int, end: int) -> tree.Array:
        return tree.Array(tuple(v), self.span(start, end))

    def array_comprehension(self, v: list, start: int, end: int) -> tree.Comprehension:
        return tree.Comprehension(v[0], tuple(v[1:]), self.span(start, end))

    def row(self, v: list, start: int, end: int) -> tuple:
        return tuple(v)

    def matrix(self, v: list, start: int, end: int) -> tree.Matrix:
        return tree.Matrix(tuple(v), self.span(start, end))

    def result(self, v: list, start: int, end: int) -> tree.Expression | None:
        return v[0] if v else None

    def parenthesized(self, v: list, start: int, end: int) -> tree.Expression:
        if len(v) == 1 and v[0] is not None:
            return v[0]
        return tree.Tuple(tuple(v), self.span(start, end))

    def index(self, v: list, start: int, end: int) -> tree.ForIndex:
        return tree.ForIndex(v[0].text, v[1] if len(v) > 1 else None, self.span(start, end))

    # ---------------------------------------------------------------- calls

    def special_name(self, v: list, start: int, end: int) -> tree.Ref:
        place = self.span(start, end)
        return tree.Ref((tree.RefPart(v[0], (), place),), False, place)

    def named_argument(self, v: list, start: int, end: int) -> Named:
        return Named(v)

    def call_arguments(self, v: list, start: int, end: int) -> tuple[tuple, tuple]:
        positional: list[Any] = []
        named: dict[str, tree.Expression] = {}
        for argument in v:
            if isinstance(argument, Named):
                name, value = argument
                if name.text in named:
                    self.report.error(
                        "E0118", f"the argument '{name.text}' is given twice", self.span(name.start, name.end)
                    )
                named[name.text] = value
            elif named:
                self.report.error(
                    "E0118",
                    "an argument without a name follows one with a name",
                    argument.span,
                    hint="arguments without names come first",
                )
            else:
                positional.append(argument)
        return tuple(positional), tuple(named.items())

    def reduction(self, v: list, start: int, end: int) -> tuple[tuple, tuple]:
        first, last = v[0].span, v[-1].span
        return (tree.Comprehension(v[0], tuple(v[1:]), first.to(last)),), ()

    def call(self, v: list, start: int, end: int) -> tree.Call:
        function, (positional, named) = v
        return tree.Call(function, positional, named, Span(self.source, start, end))
