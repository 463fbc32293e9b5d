"""Properties of a shape in its unknowns, found once for each shape: linear form, aliases, factors that may vanish."""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from functools import cache

import numpy as np

from lmoc.expression.calculus import linear_parts
from lmoc.expression.dag import ONE, ZERO, Expr, add, const, div, mul, neg, postorder, rebuild, slot, slots
from lmoc.expression.evaluate import OPERATIONS
from lmoc.ir.flat import FlatDAE, Kind
from lmoc.support.records import dataclass

# Kinds of a group's columns; constants, parameters and derived parameters are one kind here.
KNOWN, INPUT, UNKNOWN = 0, int(Kind.INPUT), int(Kind.UNKNOWN)
Kinds = tuple[int, ...]


def kinds_of(flat: FlatDAE) -> np.ndarray:
    """The kind of each variable: one that changes at events only is an input whose derivatives are zero."""
    kind = np.where(flat.kind < Kind.INPUT, KNOWN, flat.kind)
    return np.where(kind == Kind.DISCRETE, INPUT, kind)


# A sum that should vanish does, when it is this small beside its terms.
ROUNDOFF = 1e-12


class Role(IntEnum):
    """The role of a row in elimination."""

    NONE = 0
    ALIAS = 1  # a·x + b·y + c = 0 with y an unknown, an input, or absent
    DERIVATIVE = 2  # a·v + b·der(x) + c = 0
    CLOSED = 3  # no unknown appears in it


@dataclass(frozen=True, eq=False)
class Form:
    """A shape as ``Σ coefficients[i]·leaves[i] + rest``, where it plays a role in elimination.

    Attributes
    ----------
    leaves : the jets in question; for an alias or derivative the first is an unknown of order 0
    coefficients, rest : over constants and parameters
    """

    role: Role
    leaves: tuple[Expr, ...] = ()
    coefficients: tuple[Expr, ...] = ()
    rest: Expr = ZERO

    @cache  # noqa: B019 - forms are few and live as long as their shapes
    def link(self, child: int) -> tuple[int, Expr, int, Expr]:
        """The row solved for leaf `child`: ``leaf = sign·factor·other + offset_sign·offset``."""
        pivot = self.coefficients[child]
        others = [c for i, c in enumerate(self.coefficients) if i != child]
        sign, factor = ratio(neg(others[0]), pivot) if others else (1, ONE)
        return sign, factor, *ratio(neg(self.rest), pivot)


def leaves_of(shape: Expr, kinds: Kinds, *wanted: int) -> tuple[Expr, ...]:
    return tuple(leaf for leaf in slots(shape) if kinds[leaf.value[0]] in wanted)


def is_constant(expr: Expr, kinds: Kinds) -> bool:
    """Only numbers and parameters stand in it."""
    return all(n.args or _is_constant_leaf(n, kinds) for n in postorder(expr))


def constant_nodes(expr: Expr, kinds: Kinds) -> dict[int, bool]:
    """For each node, by its id, whether only numbers and parameters stand below it."""
    constant: dict[int, bool] = {}
    for node in postorder(expr):
        below = [constant[id(a)] for a in node.args]
        constant[id(node)] = all(below) if below else _is_constant_leaf(node, kinds)
    return constant


def _is_constant_leaf(node: Expr, kinds: Kinds) -> bool:
    return node.op == "const" or (node.op == "slot" and kinds[node.value[0]] == KNOWN and node.value[1] == 0)


@cache
def linear_form(shape: Expr, kinds: Kinds, inputs: bool = False) -> tuple[dict[Expr, Expr], Expr] | None:
    """Coefficients of the unknown jets (and of the inputs') and the rest, where all coefficients are constant."""
    wanted = leaves_of(shape, kinds, UNKNOWN, INPUT) if inputs else leaves_of(shape, kinds, UNKNOWN)
    parts = linear_parts(shape, wanted)
    if parts is None or not all(is_constant(c, kinds) for c in parts[0].values()):
        return None
    return parts


@cache
def form_of(shape: Expr, kinds: Kinds) -> Form:
    """The role of a shape in elimination."""
    unknown = leaves_of(shape, kinds, UNKNOWN)
    if not unknown:
        return Form(Role.CLOSED, rest=shape)
    inputs = leaves_of(shape, kinds, INPUT)
    if len(unknown) + len(inputs) > 2:
        return Form(Role.NONE)
    parts = linear_form(shape, kinds, inputs=True)
    if parts is None or not is_constant(parts[1], kinds):
        return Form(Role.NONE)
    coefficients, rest = parts
    found = sorted(coefficients, key=lambda leaf: (kinds[leaf.value[0]] != UNKNOWN, leaf.value[1]))
    if not found or kinds[found[0].value[0]] != UNKNOWN or found[0].value[1] != 0:
        return Form(Role.NONE)
    if len(found) == 2 and found[0].value[0] == found[1].value[0]:
        return Form(Role.NONE)  # x and der(x)
    role = Role.DERIVATIVE if len(found) == 2 and found[1].value[1] > 0 else Role.ALIAS
    return Form(role, tuple(found), tuple(coefficients[leaf] for leaf in found), rest)


# ------------------------------------------------------------------ quotients


def signed(expr: Expr) -> tuple[int, Expr]:
    """A sign taken out of products and quotients: ``-(a*b)`` is (-1, ``a*b``)."""
    if expr.op not in ("neg", "const", "mul", "div"):
        return 1, expr
    found: dict[Expr, tuple[int, Expr]] = {}
    for node in postorder(expr):  # a product of many factors is deep: no recursion
        found[node] = _signed(node, [found[a] for a in node.args] if node.op in ("neg", "mul", "div") else [])
    return found[expr]


def _signed(node: Expr, args: list[tuple[int, Expr]]) -> tuple[int, Expr]:
    """`signed` of a node whose arguments are known."""
    if node.op == "neg":
        return -args[0][0], args[0][1]
    if node.op == "const":
        return (-1, const(-node.value)) if node.value < 0 else (1, node)
    if not args:
        return 1, node
    (sa, a), (sb, b) = args
    return (sa * sb, rebuild(node.op, (a, b))) if sa * sb < 0 or sa < 0 else (1, node)


def ratio(numerator: Expr, denominator: Expr) -> tuple[int, Expr]:
    """``numerator/denominator`` as a sign and an expression, with what cancels at sight cancelled."""
    (sn, n), (sd, d) = signed(numerator), signed(denominator)
    if n is d:
        result = ONE
    elif d.op == "div" and d.args[0] is ONE:
        result = mul(n, d.args[1])
    elif n.op == "mul" and d in n.args:
        result = n.args[1] if n.args[0] is d else n.args[0]
    else:
        result = div(n, d)
    return sn * sd, result


def linear_sum(coefficients: dict[Expr, Expr], rest: Expr) -> Expr:
    """The expression ``Σ coefficient·leaf + rest``."""
    total = ZERO
    for leaf, coefficient in coefficients.items():
        sign, size = signed(coefficient)
        term = mul(size, leaf)
        total = add(total, term) if sign > 0 else add(total, neg(term))
    return add(total, rest)


# ----------------------------------------------------------- vanishing factors


@cache
def factors_of(shape: Expr, kinds: Kinds) -> tuple[Expr, ...]:
    """The parameter expressions that multiply something unknown: zero, they change the structure."""
    constant = constant_nodes(shape, kinds)
    found: dict[Expr, None] = {}
    for node in postorder(shape):
        state = [constant[id(a)] for a in node.args]
        if node.op == "mul" and sum(state) == 1:
            found[node.args[state.index(True)]] = None
        elif node.op == "div" and state == [True, False]:
            found[node.args[0]] = None
    return tuple(f for f in found if slots(f))


@cache
def without_factors(shape: Expr, zero: tuple[Expr, ...]) -> Expr:
    """The shape with these factors replaced by zero where they multiply something."""
    new: dict[int, Expr] = {}
    for node in postorder(shape):
        if not node.args:
            new[id(node)] = node
        elif node.op == "mul" and (node.args[0] in zero or node.args[1] in zero):
            new[id(node)] = ZERO
        elif node.op == "div" and node.args[0] in zero:
            new[id(node)] = ZERO
        else:
            new[id(node)] = rebuild(node.op, tuple(new[id(a)] for a in node.args))
    return new[id(shape)]


@cache
def compound_coefficients(shape: Expr, kinds: Kinds) -> tuple[tuple[Expr, Expr], ...]:
    """Pairs (unknown jet, coefficient) of a linear shape where terms inside the coefficient may cancel."""
    parts = linear_form(shape, kinds)
    if parts is None:
        return ()
    return tuple((leaf, c) for leaf, c in parts[0].items() if any(n.op in ("add", "sub") for n in postorder(c)))


Numbers = np.ndarray | float  # of all rows, or one for all of them


def value_and_size(
    root: Expr, value: np.ndarray, size: np.ndarray, time: float = np.nan
) -> tuple[Numbers, Numbers]:
    """Value of an expression without derivatives, and the sum of the magnitudes of the terms it is made of.

    Parameters
    ----------
    value, size : (n, columns)
        The jets of the columns, and the magnitude behind it (of a derived parameter: of its terms).
    """
    pair: dict[int, tuple[Numbers, Numbers]] = {}
    with np.errstate(all="ignore"):
        for node in postorder(root):
            if node.op == "const":
                pair[id(node)] = node.value, abs(node.value)
            elif node.op == "slot":
                pair[id(node)] = value[:, node.value[0]], size[:, node.value[0]]
            elif node.op == "time":
                pair[id(node)] = time, abs(time)
            else:
                args = [pair[id(a)] for a in node.args]
                number = OPERATIONS[node.op](*(a[0] for a in args))
                pair[id(node)] = number, _size(node.op, number, args)
    return pair[id(root)]


def _size(op: str, number: Numbers, args: list[tuple[Numbers, Numbers]]) -> Numbers:
    if op in ("add", "sub"):
        return args[0][1] + args[1][1]
    if op == "neg":
        return args[0][1]
    if op == "mul":
        return args[0][1] * args[1][1]
    if op == "div":
        return args[0][1] / np.abs(args[1][0])
    if op in _SLOPES:  # their zeros are no machine numbers: sin(pi) is the rounding of pi
        return np.abs(number) + np.abs(_SLOPES[op](args[0][0])) * args[0][1]
    return np.abs(number)


_SLOPES: dict[str, Callable[[Numbers], Numbers]] = {"sin": np.cos, "cos": np.sin, "tan": lambda x: 1 / np.cos(x) ** 2}


# --------------------------------------------------------------- column order


@cache
def renumbered(shape: Expr) -> tuple[Expr, tuple[int, ...]]:
    """The shape with columns numbered as they first appear, and the old column of each new one."""
    order: dict[int, int] = {}
    for node in postorder(shape):
        if node.op == "slot":
            order.setdefault(node.value[0], len(order))
    columns = tuple(order)
    if columns == tuple(range(len(columns))):
        return shape, columns
    return moved(shape, order), columns


def moved(shape: Expr, column: dict[int, int]) -> Expr:
    """The shape with every slot's column replaced by ``column[old]``."""
    new: dict[int, Expr] = {}
    for node in postorder(shape):
        if node.op == "slot":
            new[id(node)] = slot(column[node.value[0]], node.value[1])
        elif node.args:
            new[id(node)] = rebuild(node.op, tuple(new[id(a)] for a in node.args))
        else:
            new[id(node)] = node
    return new[id(shape)]
