"""Evaluate shapes on numpy arrays: one vector operation a node, whatever the number of rows."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lmoc.expression.dag import Expr, postorder


def _integer_quotient(x, y):
    return np.trunc(np.divide(x, y))  # two plain numbers too: x / 0 is infinite, not an exception


OPERATIONS: dict[str, Callable] = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": np.divide,
    "pow": np.power,
    "neg": np.negative,
    "abs": np.abs,
    "sign": np.sign,
    "sqrt": np.sqrt,
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "sinh": np.sinh,
    "cosh": np.cosh,
    "tanh": np.tanh,
    "exp": np.exp,
    "log": np.log,
    "log10": np.log10,
    "floor": np.floor,
    "ceil": np.ceil,
    "integer": np.floor,
    "atan2": np.arctan2,
    "min": np.minimum,
    "max": np.maximum,
    "mod": np.mod,
    "rem": np.fmod,
    "div_integer": _integer_quotient,
    "lt": np.less,
    "le": np.less_equal,
    "gt": np.greater,
    "ge": np.greater_equal,
    "eq": np.equal,
    "ne": np.not_equal,
    "and": np.logical_and,
    "or": np.logical_or,
    "not": np.logical_not,
    "if": np.where,
}


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
