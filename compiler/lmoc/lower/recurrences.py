"""The nodes of a shape for Taylor series: with all that their recurrences need.

Sums, products and quotients have recurrences of their own. Any smooth function f follows from its derivatives in the
table of functions: with ``f' = g·x'``, ``k·f[k] = Σ j·x[j]·g[k-j]``, where g is a series like the others (Moore,
Methods and Applications of Interval Analysis, 1979; Griewank and Walther, Evaluating Derivatives, 2008, chapter 13).
What has no such series is refused. The recurrences themselves stand in ``engine/c/series.c``.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from lmoc.expression.dag import ONE, Expr, function, lift, mul, neg, postorder, rebuild
from lmoc.expression.functions import FUNCTIONS, Kind
from lmoc.ir.program import Program, written

_POWERS = 8  # whole exponents up to which a power is a product


class NoSeries(Exception):
    """The program has no Taylor series, or none that is written."""


def prepared(shape: Expr, fixed: set[int]) -> Expr:
    """Return the shape with powers written as products, or by exponential and logarithm where both parts vary.

    Squares stand apart from constant factors: they take half the operations of a product.
    """
    new: dict[int, Expr] = {}
    for node in postorder(shape):
        if not node.args:
            new[id(node)] = node
            continue
        args = tuple(new[id(a)] for a in node.args)
        exponent = args[1].value if node.op == "pow" and args[1].is_const else None
        if exponent is not None and exponent == int(exponent) and 2 <= exponent <= _POWERS:
            product = args[0]
            for _ in range(int(exponent) - 1):
                product = mul(product, args[0])
            new[id(node)] = product
        elif node.op == "pow" and not _is_constant(args[1], fixed):
            new[id(node)] = function("exp", mul(args[1], function("log", args[0])))
        elif node.op == "mul":
            (c, x), (d, y) = (_without_factor(a, fixed) for a in args)
            new[id(node)] = mul(mul(c, d), mul(x, x)) if x is y else rebuild(node.op, args)
        else:
            new[id(node)] = rebuild(node.op, args)
    return new[id(shape)]


def _without_factor(node: Expr, fixed: set[int]) -> tuple[Expr, Expr]:
    """Return the constant factor of an expression, and the rest."""
    factor: Expr = ONE
    while node.op in ("mul", "div", "neg"):
        if node.op == "neg":
            factor, node = neg(factor), node.args[0]
        elif _is_constant(node.args[1], fixed):
            factor, node = rebuild(node.op, (factor, node.args[1])), node.args[0]
        elif node.op == "mul" and _is_constant(node.args[0], fixed):
            factor, node = mul(factor, node.args[0]), node.args[1]
        else:
            break
    return factor, node


def _is_constant(node: Expr, fixed: set[int]) -> bool:
    return not any(leaf.op == "time" or _varies(leaf, fixed) for leaf in postorder(node))


def _varies(leaf: Expr, fixed: set[int]) -> bool:
    return leaf.op == "slot" and leaf.value[0] not in fixed


class Nodes:
    """The nodes of a shape, and of the derivatives of its functions, in an order in which they can be computed.

    Attributes
    ----------
    place : all of them, with their positions
    steady : whether a node keeps its value
    partials : the derivatives of a function by its arguments, for all that is no power with a constant exponent
    columns : slots that occur
    inner : those that are computed as series
    """

    def __init__(self, shape: Expr, fixed: set[int]) -> None:
        """
        Parameters
        ----------
        fixed : columns whose registers are constant

        Raises
        ------
        NoSeries
            A function has kinks or jumps.
        """
        self.fixed = fixed
        self.place: dict[Expr, int] = {}
        self.partials: dict[Expr, tuple[Expr, ...]] = {}
        self.steady: dict[Expr, bool] = {}
        ahead = [shape]
        while ahead:  # a function at order k needs its derivatives up to k - 1: these may stand behind it
            for node in postorder(ahead.pop()):
                if node not in self.place:
                    self.place[node] = len(self.place)
                    self.steady[node] = self._is_steady(node)
                    if not self.steady[node]:
                        ahead += self._derivatives(node)
        self.columns = sorted({node.value[0] for node in self.place if node.op == "slot"})
        self.inner = [node for node in self.place if node.args and not self.steady[node]]

    def _is_steady(self, node: Expr) -> bool:
        if node.op == "slot":
            return node.value[0] in self.fixed
        return node.op != "time" and all(self.steady[a] for a in node.args)

    def _derivatives(self, node: Expr) -> Iterable[Expr]:
        """The derivatives of a function by its arguments, which its own series follows from."""
        if not node.args or node.op in ("add", "sub", "mul", "div", "neg"):
            return ()
        if node.op == "pow":  # with a constant exponent
            return ()
        entry = FUNCTIONS[node.op]
        if entry.kind is not Kind.SMOOTH or entry.derivatives is None:
            raise NoSeries(f"'{entry.text}' has kinks or jumps")
        rules = entry.derivatives or ()
        partials = tuple(prepared(lift(rule(function, node, *node.args)), self.fixed) for rule in rules)
        self.partials[node] = partials
        return partials


def constant_registers(program: Program, count: int, states: np.ndarray) -> np.ndarray:
    """(count,) whether a register is neither a state nor computed by the program."""
    constant = np.ones(count, bool)
    constant[states] = False
    for step in program:
        constant[written(step)] = False
    return constant
