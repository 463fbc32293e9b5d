"""Derivatives and linear parts of shapes."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

from lmoc.expression.dag import (
    ONE,
    TIME,
    ZERO,
    Expr,
    add,
    div,
    function,
    if_,
    lift,
    mul,
    neg,
    postorder,
    rebuild,
    slot,
    sub,
)
from lmoc.expression.functions import FUNCTIONS


def _push(root: Expr, seed: Callable[[Expr], Expr], chain: Callable[[Expr, list[Expr]], Expr] | None = None) -> Expr:
    """Forward differentiation: `seed` gives the derivative of every leaf, `chain` of a node from its arguments'."""
    chain = chain or _chain
    d: dict[int, Expr] = {}
    for node in postorder(root):
        if not node.args:
            d[id(node)] = seed(node)
            continue
        da = [d[id(a)] for a in node.args]
        d[id(node)] = ZERO if all(x is ZERO for x in da) else chain(node, da)
    return d[id(root)]


def _chain(node: Expr, da: list[Expr]) -> Expr:
    op, args = node.op, node.args
    if op == "neg":
        return neg(da[0])
    if op == "add":
        return add(da[0], da[1])
    if op == "sub":
        return sub(da[0], da[1])
    if op == "mul":
        return add(mul(da[0], args[1]), mul(args[0], da[1]))
    if op == "div":
        return sub(div(da[0], args[1]), mul(div(node, args[1]), da[1]))
    if op == "if":
        return if_(args[0], da[1], da[2])
    if op in ("min", "max"):
        relation = function("le" if op == "min" else "ge", args[0], args[1])
        return if_(relation, da[0], da[1])
    total = ZERO
    for rule, inner in zip(FUNCTIONS[op].derivatives or (), da):  # no rules at all: piecewise constant
        if inner is not ZERO:
            total = add(total, mul(lift(rule(function, node, *args)), inner))
    return total


def differentiate(root: Expr, leaf: Expr) -> Expr:
    """Partial derivative by one leaf."""
    return _push(root, lambda node: ONE if node is leaf else ZERO)


def total_derivative(root: Expr, constant: Collection[int] = ()) -> Expr:
    """Derivative by time: every slot goes to its next order, except the columns in `constant`; `given` says its own."""

    def seed(node: Expr) -> Expr:
        if node is TIME:
            return ONE
        if node.op == "slot" and node.value[0] not in constant:
            return slot(node.value[0], node.value[1] + 1)
        return ZERO

    return _push(root, seed, lambda node, da: node.args[1] if node.op == "given" else _chain(node, da))


def without_rates(root: Expr, instead: Expr | None = None) -> Expr:
    """Put its value in the place of each `given` of an expression that is not differentiated any more, or `instead`."""
    new: dict[int, Expr] = {}
    for node in postorder(root):
        args = tuple(new[id(a)] for a in node.args)
        same = all(a is b for a, b in zip(args, node.args, strict=True))
        if node.op == "given":
            new[id(node)] = args[0] if instead is None else instead
        else:
            new[id(node)] = node if same else rebuild(node.op, args)
    return new[id(root)]


Linear = tuple[dict[Expr, Expr], Expr]  # coefficients of leaves, and the rest


def linear_parts(root: Expr, leaves: Collection[Expr], in_branches: bool = False) -> Linear | None:
    """Coefficients and rest of an expression that is linear in the given leaves together.

    Parameters
    ----------
    in_branches : whether an ``if`` counts that is linear in each branch, and whose condition has none of the leaves;
        such a coefficient may vanish in one of them

    Returns
    -------
    (coefficients, rest) with ``root = Σ coefficient·leaf + rest`` and nothing of `leaves` in either,
    or None where the expression is not linear in them. Leaves that cancel have no entry.
    """
    parts: dict[int, Linear | None] = {}
    wanted = set(leaves)
    for node in postorder(root):
        parts[id(node)] = _linear_node(node, wanted, parts, in_branches)
    return parts[id(root)]


def _linear_node(node: Expr, wanted: set[Expr], parts: Mapping[int, Linear | None], in_branches: bool) -> Linear | None:
    if not node.args:
        return ({node: ONE}, ZERO) if node in wanted else ({}, node)
    got: list[Linear] = []
    for a in node.args:
        part = parts[id(a)]
        if part is None:
            return None
        got.append(part)
    if not any(g[0] for g in got):
        rests = tuple(g[1] for g in got)  # leaves may have cancelled below
        return {}, node if rests == node.args else rebuild(node.op, rests)
    op = node.op
    if op == "neg":
        return {k: neg(c) for k, c in got[0][0].items()}, neg(got[0][1])
    if op in ("add", "sub"):
        (ca, ra), (cb, rb) = got
        combine = add if op == "add" else sub
        coefficients = {k: combine(ca.get(k, ZERO), cb.get(k, ZERO)) for k in {**ca, **cb}}
        return {k: c for k, c in coefficients.items() if c is not ZERO}, combine(ra, rb)
    if op == "mul":
        (ca, ra), (cb, rb) = got
        if ca and cb:
            return None
        if ca:
            return {k: mul(c, rb) for k, c in ca.items()}, mul(ra, rb)
        return {k: mul(ra, c) for k, c in cb.items()}, mul(ra, rb)
    if op == "div" and not got[1][0]:
        (ca, ra), (_, rb) = got
        return {k: div(c, rb) for k, c in ca.items()}, div(ra, rb)
    if op == "if" and in_branches and not got[0][0]:
        (_, condition), (ca, ra), (cb, rb) = got
        both = {**ca, **cb}
        return {k: if_(condition, ca.get(k, ZERO), cb.get(k, ZERO)) for k in both}, if_(condition, ra, rb)
    return None
