"""Shapes as statements of the page's script, whose operators and functions are written as in C."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Protocol

from lmoc.expression.dag import Expr, postorder
from lmoc.expression.functions import FUNCTIONS

FEW = 4  # rows of a step that are written one by one


class Namer(Protocol):
    """Gives names that are used nowhere else."""

    def name(self, lead: str) -> str: ...


def expression_lines(
    shapes: Iterable[Expr], access: dict[int, str], writer: Namer | None = None, declare: str = "const double"
) -> tuple[list[str], list[str]]:
    """Statements that compute the inner nodes of some shapes, and the expressions of their values.

    Parameters
    ----------
    access : expression of what is in each column
    writer : gives names that are used nowhere else; without it names are good for one scope
    declare : what stands before a name
    """
    text: dict[int, str] = {}
    lines: list[str] = []
    results = []
    for shape in shapes:
        for node in postorder(shape):
            if id(node) in text:
                continue
            if node.op == "const":
                text[id(node)] = number_text(node.value)
            elif node.op == "slot":
                text[id(node)] = access[node.value[0]]
            elif node.op == "time":
                text[id(node)] = "time"
            else:
                name = writer.name("t") if writer else f"t{len(lines)}"
                lines.append(f"{declare} {name} = {_operation(node, [text[id(a)] for a in node.args])};")
                text[id(node)] = name
        results.append(text[id(shape)])
    return lines, results


def number_text(value: float) -> str:
    """A number as C writes it."""
    if not math.isfinite(value):
        return "NAN" if math.isnan(value) else "INFINITY" if value > 0 else "(-INFINITY)"
    return f"({value!r})" if value < 0 else repr(value)


def _operation(node: Expr, args: list[str]) -> str:
    if node.op == "pow" and node.args[1].op == "const" and node.args[1].value in (2.0, 3.0):
        return "*".join([args[0]] * int(node.args[1].value))
    return FUNCTIONS[node.op].c.format(*args)
