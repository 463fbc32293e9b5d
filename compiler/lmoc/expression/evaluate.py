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
    values: list[Any] = []
    steps, ends = _steps(roots)
    for node, operation, places in steps:
        values.append(_leaf(node, column, time) if operation is None else operation(*[values[k] for k in places]))
    return [values[k] for k in ends]


_Step = tuple[Expr, Callable[..., Any] | None, tuple[int, ...]]


@cache
def _steps(roots: tuple[Expr, ...]) -> tuple[tuple[_Step, ...], tuple[int, ...]]:
    """Return each node with its operation and the places of its arguments, and the places of the roots.

    Leaves have no operation. Kept with the nodes.
    """
    nodes = list({id(node): node for root in roots for node in postorder(root)}.values())
    place = {id(node): k for k, node in enumerate(nodes)}
    steps = tuple((n, OPERATIONS[n.op] if n.args else None, tuple(place[id(a)] for a in n.args)) for n in nodes)
    return steps, tuple(place[id(root)] for root in roots)


def _leaf(node: Expr, column: Callable[[int, int], Any], time: Any) -> Any:
    if node.op == "const":
        return node.value
    return time if node.op == "time" else column(*node.value)
