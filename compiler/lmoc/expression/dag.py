"""The expression DAG: interned nodes whose leaves are slots, constants and time.

A *shape* is an expression over numbered slots. Equations that differ only in the variables they name share
one shape; a table gives the variable of each slot for each of them. `slot(k, n)` stands for the n-th time
derivative of the variable in column k: the *jet* of order n. Because nodes are interned, equal expressions
are the same object, `is` compares them, and every function over the DAG can be memoized by node.

Constructors fold constants and drop neutral elements (0 + x, 1·x, x^1), and do nothing else: what the user
wrote stays recognizable.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

from lmoc.expression.functions import FUNCTIONS

Number = int | float


class Expr:
    """A node. Never construct one directly: use the functions of this module.

    Attributes
    ----------
    op : str
        ``const``, ``slot``, ``time`` or the name of an entry of `functions.FUNCTIONS`.
    args : tuple of Expr
    value : float | tuple[int, int] | None
        The number of a ``const``; (column, order) of a ``slot``.
    """

    __slots__ = ("op", "args", "value", "_memo")

    op: str
    args: tuple[Expr, ...]
    value: Any
    _memo: Any

    def __add__(self, other: Expr | Number) -> Expr:
        return add(self, lift(other))

    def __radd__(self, other: Number) -> Expr:
        return add(lift(other), self)

    def __sub__(self, other: Expr | Number) -> Expr:
        return sub(self, lift(other))

    def __rsub__(self, other: Number) -> Expr:
        return sub(lift(other), self)

    def __mul__(self, other: Expr | Number) -> Expr:
        return mul(self, lift(other))

    def __rmul__(self, other: Number) -> Expr:
        return mul(lift(other), self)

    def __truediv__(self, other: Expr | Number) -> Expr:
        return div(self, lift(other))

    def __rtruediv__(self, other: Number) -> Expr:
        return div(lift(other), self)

    def __pow__(self, other: Expr | Number) -> Expr:
        return power(self, lift(other))

    def __neg__(self) -> Expr:
        return neg(self)

    @property
    def is_const(self) -> bool:
        return self.op == "const"

    def __reduce__(self) -> tuple[Any, ...]:
        nodes = postorder(self)
        number = {id(node): k for k, node in enumerate(nodes)}
        return _of_records, ([(node.op, [number[id(a)] for a in node.args], node.value) for node in nodes],)

    def __repr__(self) -> str:
        """Return the node in prefix form, such as ``mul(#0, der(#1))``; `lmoc.expression.text` writes it for users."""
        made: dict[int, str] = {}
        for node in postorder(self):
            made[id(node)] = _prefix_text(node, [made[id(a)] for a in node.args])
        return made[id(self)]


def _prefix_text(node: Expr, args: list[str]) -> str:
    if node.op == "slot":
        column, order = node.value
        return str("der(" * order + f"#{column}" + ")" * order)
    if node.op == "const":
        return f"{node.value:g}"
    return f"{node.op}({', '.join(args)})" if args else str(node.op)


_TABLE: dict[tuple[Any, ...], Expr] = {}


def interned(op: str, args: tuple[Expr, ...], value: Any = None) -> Expr:
    key = (op, value, *map(id, args))
    node = _TABLE.get(key)
    if node is None:
        node = object.__new__(Expr)
        node.op, node.args, node.value, node._memo = op, args, value, None
        node = _TABLE.setdefault(key, node)  # one step: of two threads that make it, both get the same node
    return node


# ------------------------------------------------------------------ leaves


def _of_records(records: list[tuple[str, list[int], Any]]) -> Expr:
    """Return a pickled expression: nodes in order, since pickle would go down a deep one by recursion."""
    made: list[Expr] = []
    for op, args, value in records:
        made.append(interned(op, tuple([made[k] for k in args]), value))
    return made[-1]


def const(value: Number | bool) -> Expr:
    number = float(value)
    # the sign of a zero is part of the key: 0.0 == -0.0, but atan2 and 1/x tell them apart
    return interned("const", (), number) if number != 0.0 or math.copysign(1.0, number) > 0 else ZERO


def slot(column: int, order: int = 0) -> Expr:
    return interned("slot", (), (column, order))


def lift(value: Expr | Number) -> Expr:
    return value if isinstance(value, Expr) else const(value)


ZERO = interned("const", (), 0.0)
ONE = interned("const", (), 1.0)
TIME = interned("time", ())


# -------------------------------------------------------------- arithmetic


def add(a: Expr, b: Expr) -> Expr:
    if a is ZERO:
        return b
    if b is ZERO:
        return a
    if a.op == b.op == "const":
        return const(a.value + b.value)
    if b.op == "neg":
        return sub(a, b.args[0])
    return interned("add", (a, b))


def sub(a: Expr, b: Expr) -> Expr:
    if b is ZERO:
        return a
    if a is ZERO:
        return neg(b)
    if a is b:
        return ZERO
    if a.op == b.op == "const":
        return const(a.value - b.value)
    if b.op == "neg":
        return add(a, b.args[0])
    return interned("sub", (a, b))


def mul(a: Expr, b: Expr) -> Expr:
    if a is ZERO or b is ZERO:
        return ZERO
    if a is ONE:
        return b
    if b is ONE:
        return a
    if a.op == b.op == "const":
        return const(a.value * b.value)
    if a.op == "const" and a.value == -1.0:
        return neg(b)
    if b.op == "const" and b.value == -1.0:
        return neg(a)
    return interned("mul", (a, b))


def div(a: Expr, b: Expr) -> Expr:
    if b is ONE:
        return a
    if a is ZERO and b is not ZERO:
        return ZERO
    if a.op == b.op == "const" and b.value != 0.0:
        return const(a.value / b.value)
    return interned("div", (a, b))


def power(a: Expr, b: Expr) -> Expr:
    if b is ZERO:
        return ONE
    if b is ONE:
        return a
    if a.op == b.op == "const" and a.value != 0:
        value = _finite(math.pow, a.value, b.value)
        if value is not None:
            return const(value)
    return interned("pow", (a, b))


def _finite(operation: Callable[..., float], *numbers: float) -> float | None:
    """The result of an operation; None where it is no finite number: then the node is kept."""
    try:
        value = float(operation(*numbers))
    except (ValueError, OverflowError, ZeroDivisionError):
        return None
    return value if math.isfinite(value) else None


def neg(a: Expr) -> Expr:
    if a.op == "const":
        return const(-a.value)
    if a.op == "neg":
        return a.args[0]
    if a.op == "sub":
        return sub(a.args[1], a.args[0])
    return interned("neg", (a,))


def if_(condition: Expr, then: Expr, otherwise: Expr) -> Expr:
    if condition.op == "const":
        return then if condition.value else otherwise
    if then is otherwise:
        return then
    return interned("if", (condition, then, otherwise))


def event(a: Expr) -> Expr:
    """The expression, whose jumps are events; what is known, or says so already, as it stands."""
    return a if a.op in ("const", "event") else interned("event", (a,))


def nodes_outside_events(root: Expr) -> Iterator[Expr]:
    """Yield each node of an expression that is not inside `event`."""
    seen, stack = set(), [root]
    while stack:
        node = stack.pop()
        if id(node) in seen or node.op == "event":
            continue
        seen.add(id(node))
        stack += node.args
        yield node


def outside_events(root: Expr) -> list[Expr]:
    """Return the leaves of an expression that change it between events: `mod` and `rem` jump at them, and move on."""
    leaves: list[Expr] = []
    seen, stack = set(), [root]
    while stack:
        node = stack.pop()
        if id(node) in seen or (node.op == "event" and node.args[0].op not in ("mod", "rem")):
            continue
        seen.add(id(node))
        stack += node.args
        if not node.args:
            leaves.append(node)
    return leaves


# ------------------------------------------------- functions and relations


def function(name: str, *args: Expr) -> Expr:
    """An elementary function, relation or logical operator applied to nodes.

    Folds constants where the value is finite; keeps the node where it is not.
    """
    if all(a.op == "const" for a in args):
        of_numbers = FUNCTIONS[name].value
        value = None if of_numbers is None else _finite(of_numbers, *(a.value for a in args))
        if value is not None:
            return const(value)
    return interned(name, args)


# Build any inner node again with other arguments (used by every rewriting pass).
_REBUILD: dict[str, Callable[..., Expr]] = {
    "add": add,
    "sub": sub,
    "mul": mul,
    "div": div,
    "pow": power,
    "neg": neg,
    "if": if_,
    "event": event,
}


def rebuild(op: str, args: tuple[Expr, ...]) -> Expr:
    maker = _REBUILD.get(op)
    return maker(*args) if maker else function(op, *args)


# ---------------------------------------------------------------- traversal


def postorder(root: Expr) -> tuple[Expr, ...]:
    """Every node once, arguments before their users; no recursion, so depth is no limit. Kept with the root."""
    found: tuple[Expr, ...] | None = root._memo
    if found is None:
        found = root._memo = _walk(root) if root.args else (root,)
    return found


def _walk(root: Expr) -> tuple[Expr, ...]:
    order: list[Expr] = []
    seen: set[int] = set()
    stack: list[tuple[Expr, bool]] = [(root, False)]
    while stack:
        node, ready = stack.pop()
        if ready:
            order.append(node)
        elif id(node) not in seen:
            seen.add(id(node))
            stack.append((node, True))
            stack.extend((a, False) for a in reversed(node.args) if id(a) not in seen)
    return tuple(order)


def slots(root: Expr) -> tuple[Expr, ...]:
    """The slot leaves of an expression, ordered by (column, order)."""
    found = {node for node in postorder(root) if node.op == "slot"}
    return tuple(sorted(found, key=lambda leaf: leaf.value))


def depends_on_time(root: Expr) -> bool:
    return any(node is TIME for node in postorder(root))


def transform(root: Expr, leaf: Callable[[Expr], Expr]) -> Expr:
    """Replace every leaf by ``leaf(node)`` and build the rest again."""
    new: dict[int, Expr] = {}
    for node in postorder(root):
        if node.args:
            args = tuple(new[id(a)] for a in node.args)
            same = all(x is y for x, y in zip(args, node.args, strict=True))
            new[id(node)] = node if same else rebuild(node.op, args)
        else:
            new[id(node)] = leaf(node)
    return new[id(root)]


def substitute(root: Expr, replacement: dict[Expr, Expr]) -> Expr:
    """Replace leaves (slots, time) by expressions."""
    return transform(root, lambda node: replacement.get(node, node))
