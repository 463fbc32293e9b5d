"""Operators of the DAG that Python's own operators give, on values of any library."""

from __future__ import annotations

import operator
from collections.abc import Callable

ARITHMETIC: dict[str, Callable] = {
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "div": operator.truediv,
    "pow": operator.pow,
    "neg": operator.neg,
}
