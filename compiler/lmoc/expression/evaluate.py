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
    values: list[Any] = []
    for node, operation, places in _steps(root):
        values.append(_leaf(node, column, time) if operation is None else operation(*[values[k] for k in places]))
    return values[-1]


@cache
def _steps(root: Expr) -> tuple[tuple[Expr, Callable[..., Any] | None, tuple[int, ...]], ...]:
    """Return each node with its operation and the places of its arguments; leaves have none. Kept with the node."""
    nodes = postorder(root)
    place = {id(node): k for k, node in enumerate(nodes)}
    return tuple((n, OPERATIONS[n.op] if n.args else None, tuple(place[id(a)] for a in n.args)) for n in nodes)


def _leaf(node: Expr, column: Callable[[int, int], Any], time: Any) -> Any:
    if node.op == "const":
        return node.value
    return time if node.op == "time" else column(*node.value)
