"""``String(…)``: texts of numbers, logical values and literals (Modelica specification, 3.7.2.2)."""

from __future__ import annotations

import re

from lmoc.messages.source import Span
from lmoc.semantics.classes.predefined import BUILTINS, ENUMERATIONS
from lmoc.semantics.classes.resolve import resolve
from lmoc.semantics.mistakes.wrong import Wrong
from lmoc.semantics.values.builtins import arguments, builtin
from lmoc.semantics.values.context import Context
from lmoc.semantics.values.translate import changes
from lmoc.semantics.values.value import Value, number, text
from lmoc.syntax import tree

_OPTIONS = {"significantDigits": "Integer", "minimumLength": "Integer", "leftJustified": "Boolean", "format": "String"}
_FORMAT = re.compile(r"%?([-+ #0]*)(\d*)(?:\.(\d+))?(?:ll|[hlLqjzt])?([diouxXfeEgGcs])")
_WHOLE = "diouxXc"


@builtin("String")
def _string(context: Context, call: tree.Call) -> Value:
    if not call.arguments:
        raise Wrong("E0217", "'String' needs a value", call.span)
    x = context.value(call.arguments[0])
    if x.dims:
        raise Wrong("E0301", "'String' takes a single value", call.arguments[0].span, found="an array")
    options = _options(context, call, x)
    if x.type == "String":
        return text(_padded(x.text, options))
    if changes(context, x):
        return text(f"({call.arguments[0].span.text})")  # its value is not known when the text is made
    return text(_text_of(context, x, options, call.span))


@builtin("__lmoc_length")
def _length(context: Context, call: tree.Call) -> Value:
    (x,) = arguments(context, call, 1)
    return number(len(_known_text(x, call)), "Integer")


@builtin("__lmoc_substring")
def _substring(context: Context, call: tree.Call) -> Value:
    x, first, last = arguments(context, call, 3)
    found = _known_text(x, call)
    begin, end = (int(context.known(k, call.span, "a place in a text")) for k in (first, last))
    if not 1 <= begin <= end <= len(found):
        raise Wrong("E0215", f"'{found}' has no characters from {begin} to {end}", call.span,
                    expected=f"1 … {len(found)}")  # fmt: skip
    return text(found[begin - 1 : end])


def _known_text(x: Value, call: tree.Call) -> str:
    if x.type != "String" or x.dims:
        raise Wrong("E0301", f"'{call.function}' takes a text", call.span, found=x.type)
    return str(x.text)


def _options(context: Context, call: tree.Call, x: Value) -> dict[str, object]:
    """The options of a call by name, with their values."""
    order = ["minimumLength", "leftJustified"]
    if x.type == "Real":
        order.insert(0, "significantDigits")
    elif x.type not in ("Integer", "Boolean", "String") and not _literals(context, x):
        raise Wrong("E0301", "'String' takes a number, a logical value or a literal", call.span, found=x.type)
    given = dict(zip(order, call.arguments[1:], strict=False))
    if len(call.arguments) == 2 and context.value(call.arguments[1]).type == "String":
        given = {"format": call.arguments[1]}
    elif len(call.arguments) > 1 + len(order):
        raise Wrong("E0217", f"'String' is called with {len(call.arguments)} arguments", call.span,
                    expected=", ".join(["the value", *order]))  # fmt: skip
    for name, expression in call.named:
        if name in given or name not in (*order, "format") or (name == "format" and x.type not in ("Real", "Integer")):
            known = [*order, "format"] if x.type in ("Real", "Integer") else order
            message = f"'String' of a {x.type} has no option '{name}'" if name not in given else f"'{name}' twice"
            raise Wrong("E0217", message, expression.span, expected=", ".join(known))
        given[name] = expression
    if "format" in given and len(given) > 1:
        raise Wrong("E0217", "'format' says all: the other options go with numbers alone", call.span)
    return {name: _option(context, name, expression) for name, expression in given.items()}


def _option(context: Context, name: str, expression: tree.Expression) -> object:
    value = context.value(expression)
    if value.type != _OPTIONS[name]:
        raise Wrong("E0301", f"'{name}' is of type {_OPTIONS[name]}", expression.span, found=value.type)
    if name == "format":
        if _FORMAT.fullmatch(value.text) is None:
            raise Wrong("E0301", f"'{value.text}' is no format", expression.span, expected='as in C, ".2f"')
        return value.text
    if name == "leftJustified":
        return bool(context.scalar(value, expression.span, name))
    return context.whole(value, expression.span, name, int(name == "significantDigits"))


def _text_of(context: Context, x: Value, options: dict[str, object], span: Span) -> str:
    known = context.scalar(x, span, "a text")
    if x.type == "Boolean":
        return _padded("true" if known else "false", options)
    if x.type == "Integer":
        return _formatted(options["format"], known) if "format" in options else _padded(str(int(known)), options)
    if x.type == "Real":
        if "format" in options:
            return _formatted(options["format"], known)
        return _padded(f"{known:.{options.get('significantDigits', 6)}g}", options)
    return _padded(_literals(context, x)[int(known) - 1], options)


def _literals(context: Context, x: Value) -> tuple[str, ...]:
    """The names of the literals of an enumeration, one of the user's own included; empty for what is none."""
    if x.type in ENUMERATIONS or x.type in BUILTINS:
        return ENUMERATIONS.get(x.type, ())
    found = context.model.root.cls.root
    for name in x.type.split("."):
        found = found.element(name) or found.find(name)
    return resolve(found).base.literals


def _padded(found: str, options: dict[str, object]) -> str:
    length = options.get("minimumLength", 0)
    return found.ljust(length) if options.get("leftJustified", True) else found.rjust(length)


def _formatted(form: object, value: float) -> str:
    """A number as C's printf writes it; formats of whole numbers round those that are none."""
    flags, width, precision, kind = _FORMAT.fullmatch(str(form)).groups()
    number = round(value) if kind in _WHOLE else value
    digits = "" if precision is None else f".{precision}"
    return f"%{flags}{width}{digits}{'d' if kind in 'iu' else kind}" % number
