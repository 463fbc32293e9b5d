"""Evaluate shapes on numpy arrays: one vector operation a node, whatever the number of rows."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lmoc.expression.dag import Expr, postorder
from lmoc.expression.functions import FUNCTIONS, resolve

OPERATIONS: dict[str, Callable] = {name: resolve(f.numpy, np) for name, f in FUNCTIONS.items()}


def evaluate(root: Expr, column: Callable[[int, int], np.ndarray], time=np.nan):
    """Value of a shape for many rows at once.

    Parameters
    ----------
    root : Expr
    column : callable
        ``column(k, order)`` gives the array (or number) that stands in a slot; arrays broadcast.
    time : float or array

    Returns
    -------
    array or number of the broadcast shape; a shape without slots gives a number.
    """
    if not root.args:  # the most frequent shapes: a variable, a number
        return _leaf(root, column, time)
    values: dict[int, object] = {}
    with np.errstate(all="ignore"):  # a NaN or infinity is found, with its place, by whoever asked
        for node in postorder(root):
            if node.args:
                values[id(node)] = OPERATIONS[node.op](*[values[id(a)] for a in node.args])
            else:
                values[id(node)] = _leaf(node, column, time)
    return values[id(root)]


def _leaf(node: Expr, column: Callable[[int, int], np.ndarray], time):
    if node.op == "const":
        return node.value
    return time if node.op == "time" else column(*node.value)
