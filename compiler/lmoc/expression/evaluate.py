"""Evaluate shapes on numpy arrays: one vector operation a node, whatever the number of rows."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from lmoc.expression.dag import Expr, postorder
from lmoc.expression.functions import FUNCTIONS, resolve

OPERATIONS: dict[str, Callable[..., Any]] = {name: resolve(f.numpy, np) for name, f in FUNCTIONS.items()}


def evaluate(root: Expr, column: Callable[[int, int], Any], time: Any = np.nan) -> Any:
    """Value of a shape for many rows at once.

    Parameters
    ----------
    root : Expr
    column : callable
        ``column(k, order)`` gives the array (or number) of a slot; arrays broadcast.
    time : float or array

    Returns
    -------
    array or number of the broadcast shape; a shape without slots gives a number.
    """
    if not root.args:  # the most frequent shapes: a variable, a number
        return _leaf(root, column, time)
    with np.errstate(all="ignore"):  # a NaN or infinity is found, with its place, by whoever asked
        return evaluate_quietly(root, column, time)


def evaluate_quietly(root: Expr, column: Callable[[int, int], Any], time: Any = np.nan) -> Any:
    """`evaluate` where numpy has been told already to keep its warnings to itself."""
    if not root.args:
        return _leaf(root, column, time)
    return _values((root,), column, time)[0]


def evaluate_together(roots: tuple[Expr, ...], column: Callable[[int, int], Any], time: Any = np.nan) -> list[Any]:
    """Return the values of several shapes of the same rows; what they share is evaluated once."""
    with np.errstate(all="ignore"):
        return _values(roots, column, time)


def _values(roots: tuple[Expr, ...], column: Callable[[int, int], Any], time: Any) -> list[Any]:
    filled, slots, operations, ends = _steps(roots)
    values = filled.copy()
    for place, (k, order) in slots:
        values[place] = column(k, order) if k >= 0 else time
    for place, operation, a, b, c in operations:  # spelled out by the number of arguments: nothing runs more often
        if c >= 0:
            values[place] = operation(values[a], values[b], values[c])
        elif b >= 0:
            values[place] = operation(values[a], values[b])
        else:
            values[place] = operation(values[a])
    return [values[k] for k in ends]


_Operation = tuple[int, Callable[..., Any], int, int, int]


@cache
def _steps(
    roots: tuple[Expr, ...],
) -> tuple[list[Any], tuple[tuple[int, tuple[int, int]], ...], tuple[_Operation, ...], tuple[int, ...]]:
    """Return how to compute the nodes of some shapes, kept with these.

    Returns
    -------
    filled : a value for each node, the constants with theirs
    slots : the place of each slot, with its arguments; -1 stands for the time
    operations : place and operation of each other node in order, and the places of its arguments; -1 without
    ends : the places of the roots
    """
    nodes = list({id(node): node for root in roots for node in postorder(root)}.values())
    place = {id(node): k for k, node in enumerate(nodes)}
    filled = [node.value if node.op == "const" else None for node in nodes]
    slots, operations = [], []
    for k, node in enumerate(nodes):
        if node.args:
            a, b, c = (*(place[id(arg)] for arg in node.args), -1, -1)[:3]
            operations.append((k, OPERATIONS[node.op], a, b, c))
        elif node.op != "const":
            slots.append((k, (-1, 0) if node.op == "time" else node.value))
    return filled, tuple(slots), tuple(operations), tuple(place[id(root)] for root in roots)


def _leaf(node: Expr, column: Callable[[int, int], Any], time: Any) -> Any:
    if node.op == "const":
        return node.value
    return time if node.op == "time" else column(*node.value)
