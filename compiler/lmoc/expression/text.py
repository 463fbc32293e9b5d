"""Expressions as text in the language's own syntax."""

from __future__ import annotations

from collections.abc import Callable

from lmoc.expression.dag import Expr, postorder
from lmoc.expression.functions import FUNCTIONS

# binding strength, loosest first; a child that binds no tighter than its parent needs is put in brackets
_STRENGTH = {
    "if": 0, "or": 1, "and": 2, "not": 3,
    "lt": 4, "le": 4, "gt": 4, "ge": 4, "eq": 4, "ne": 4,
    "add": 5, "sub": 5, "neg": 5.5, "mul": 6, "div": 6, "pow": 8,
}  # fmt: skip
_SYMBOL = {
    "add": " + ", "sub": " - ", "mul": "*", "div": "/", "pow": "^", "or": " or ", "and": " and ",
    "lt": " < ", "le": " <= ", "gt": " > ", "ge": " >= ", "eq": " == ", "ne": " <> ",
}  # fmt: skip
_ATOM = 10.0


def number_text(value: float) -> str:
    """Shortest text that reads back as the same number; ``inf`` and ``nan`` for what no text is."""
    if abs(value) < 1e15 and value == int(value):
        return str(int(value))
    return repr(value)


def default_name(column: int, order: int) -> str:
    name = f"#{column}"
    for _ in range(order):
        name = f"der({name})"
    return name


def to_text(root: Expr, name: Callable[[int, int], str] = default_name) -> str:
    """The expression with ``name(column, order)`` for its slots."""
    text: dict[int, tuple[str, float]] = {}
    for node in postorder(root):
        text[id(node)] = _node_text(node, [text[id(a)] for a in node.args], name)
    return text[id(root)][0]


def _node_text(node: Expr, args: list[tuple[str, float]], name: Callable[[int, int], str]) -> tuple[str, float]:
    op = node.op
    if op == "const":
        return number_text(node.value), _ATOM if node.value >= 0 else _STRENGTH["neg"]
    if op == "slot":
        return name(*node.value), _ATOM
    if op == "time":
        return "time", _ATOM
    if op in ("event", "given"):
        return args[0]
    if op == "if":
        parts = [_bracket(a, 0.5) for a in args]
        return f"if {parts[0]} then {parts[1]} else {parts[2]}", _STRENGTH["if"]
    if op in ("neg", "not"):
        strength = _STRENGTH[op]
        return ("-" if op == "neg" else "not ") + _bracket(args[0], strength + 0.1), strength
    if op in _SYMBOL:
        strength = _STRENGTH[op]
        # relations and powers do not chain; the others group to the left
        left = _bracket(args[0], strength + (0.1 if strength in (4, 8) else 0))
        right = _bracket(args[1], strength + 0.1)
        return left + _SYMBOL[op] + right, strength
    return f"{FUNCTIONS[op].text}({', '.join(a[0] for a in args)})", _ATOM


def _bracket(arg: tuple[str, float], needed: float) -> str:
    return arg[0] if arg[1] >= needed else f"({arg[0]})"
