"""Expressions as shapes: literals, operators, if-expressions (Modelica specification, chapters 3 and 10)."""

from __future__ import annotations

from collections.abc import Callable
from math import prod

import numpy as np

from lmoc.expression import dag
from lmoc.expression.dag import Expr
from lmoc.ir.flat import Kind
from lmoc.messages.diagnostics import Subject
from lmoc.messages.source import Span
from lmoc.semantics.mistakes.wrong import CallsItself, OutOfRange, RowsDiffer, Wrong
from lmoc.semantics.values.context import Context, translates
from lmoc.semantics.values.rows import align
from lmoc.semantics.values.value import Value, common_type, number, record, stack, text
from lmoc.syntax import tree

ARITHMETIC: dict[str, Callable[[Expr, Expr], Expr]] = {
    "+": dag.add, "-": dag.sub, "*": dag.mul, "/": dag.div, "^": dag.power,
    ".+": dag.add, ".-": dag.sub, ".*": dag.mul, "./": dag.div, ".^": dag.power,
}  # fmt: skip
RELATION = {"<": "lt", "<=": "le", ">": "gt", ">=": "ge", "==": "eq", "<>": "ne"}
MAX_UNROLLED = 10_000  # a longer loop must be one group


# ------------------------------------------------------------------------- literals


@translates(tree.Number)
def _number(context: Context, e: tree.Number) -> Value:
    return number(e.value, "Integer" if e.integer else "Real")


@translates(tree.String)
def _text(context: Context, e: tree.String) -> Value:
    return text(e.value)


@translates(tree.Boolean)
def _boolean(context: Context, e: tree.Boolean) -> Value:
    return number(e.value, "Boolean")


@translates(tree.EndSubscript)
def _end(context: Context, e: tree.EndSubscript) -> Value:
    if context.end is None:
        raise Wrong("E0301", "'end' has a meaning only in a subscript", e.span)
    return number(context.end, "Integer")


@translates(tree.Field)
def _field(context: Context, e: tree.Field) -> Value:
    value = context.value(e.record)
    found = None if value.fields is None else value.fields.get(e.name)
    if found is None:
        raise Wrong("E0301", f"a record with the field '{e.name}' is needed here", e.span, found=value.type)
    return found


@translates(tree.Colon, tree.Tuple)
def _misplaced(context: Context, e: tree.Colon | tree.Tuple) -> Value:
    raise Wrong("E0301", "this cannot be used as a value", e.span)


# ------------------------------------------------------------------------ operators


@translates(tree.Unary)
def _unary(context: Context, e: tree.Unary) -> Value:
    operand = context.value(e.operand)
    if e.op == "not":
        _need(operand, "Boolean", e.operand.span)
        return context.arrays.map(lambda x: dag.function("not", x), operand, type="Boolean")
    need_number(operand, e.operand.span)
    if e.op == "+":
        return operand
    return context.arrays.map(dag.neg, operand, type=operand.type)


@translates(tree.Binary)
def _binary(context: Context, e: tree.Binary) -> Value:
    # a sum of many terms is a deep tree to the left: go down it without recursion
    chain = [e]
    while isinstance(chain[-1].left, tree.Binary):
        chain.append(chain[-1].left)
    value = context.value(chain[-1].left)
    for node in reversed(chain):
        value = combine(context, node, value, context.value(node.right))
    return value


def combine(context: Context, e: tree.Binary, left: Value, right: Value) -> Value:
    """One binary operator applied to values."""
    op = e.op
    if op in ("and", "or"):
        _need(left, "Boolean", e.left.span)
        _need(right, "Boolean", e.right.span)
        return context.arrays.map(lambda x, y: dag.function(op, x, y), left, right, type="Boolean")
    if op in RELATION:
        return _relation(context, e, left, right)
    if op == "+" and left.type == right.type == "String":
        return _joined(context, e, left, right)
    need_number(left, e.left.span)
    need_number(right, e.right.span)
    if left.dims or right.dims:
        return _array_arithmetic(context, e, left, right)
    return Value(ARITHMETIC[op](left.expr, right.expr), (), _result_type(op, left, right))


def _joined(context: Context, e: tree.Binary, left: Value, right: Value) -> Value:
    """Texts one behind the other, those of arrays element by element."""
    if left.dims != right.dims:
        raise sizes_differ("the operands of '+'", left.dims, right.dims, e.span)
    if not left.dims:
        return text(left.text + right.text)
    pairs = zip(context.arrays.elements(left), context.arrays.elements(right), strict=True)
    return stack([_joined(context, e, a, b) for a, b in pairs], left.dims[1:], "String")


def _result_type(op: str, left: Value, right: Value) -> str:
    return "Integer" if left.type == right.type == "Integer" and op not in ("/", "./", "^", ".^") else "Real"


def _array_arithmetic(context: Context, e: tree.Binary, left: Value, right: Value) -> Value:
    op = e.op
    if op == "*" and left.dims and right.dims:
        return matrix_product(context, left, right, e.span)
    if op == "^" and (left.dims or right.dims):
        return _matrix_power(context, e, left, right)
    scalar_allowed = op.startswith(".") or op == "*" or (op == "/" and not right.dims)
    same = left.dims == right.dims
    if not same and not (scalar_allowed and (not left.dims or not right.dims)):
        raise sizes_differ(f"the operands of '{op}'", left.dims, right.dims, e.span)
    return context.arrays.map(ARITHMETIC[op], left, right, type=_result_type(op, left, right))


def matrix_product(context: Context, left: Value, right: Value, span: Span) -> Value:
    """Scalar product, matrix times vector, vector times matrix, matrix times matrix (10.6.5)."""
    arrays = context.arrays
    if len(left.dims) > 2 or len(right.dims) > 2 or left.dims[-1] != right.dims[0]:
        raise sizes_differ("the factors of a matrix product", left.dims, right.dims, span)
    type_ = common_type((left, right))

    def dot(row: Value, column: Value) -> Value:
        product = arrays.map(dag.mul, row, column)
        return Value(arrays.fold(dag.add, product, dag.ZERO), (), type_)

    rows = arrays.elements(left) if len(left.dims) == 2 else [left]
    columns = arrays.elements(arrays.transpose(right)) if len(right.dims) == 2 else [right]
    table = [[dot(row, column) for column in columns] for row in rows]
    if len(left.dims) == 2:
        return stack([stack(r) if len(right.dims) == 2 else r[0] for r in table])
    return stack(table[0]) if len(right.dims) == 2 else table[0][0]


def _matrix_power(context: Context, e: tree.Binary, base: Value, exponent: Value) -> Value:
    if exponent.dims or len(base.dims) != 2 or base.dims[0] != base.dims[1]:
        raise sizes_differ("a power", base.dims, exponent.dims, e.span)
    n = context.whole(exponent, e.right.span, "the exponent of a matrix")
    if n > MAX_UNROLLED:
        raise Wrong("E0225", "the exponent of a matrix is too large", e.right.span, expected=f"at most {MAX_UNROLLED}",
                    found=str(n))  # fmt: skip
    size = base.dims[0]
    result = stack([stack([number(i == j) for j in range(size)]) for i in range(size)])
    for _ in range(n):
        result = matrix_product(context, result, base, e.span)
    return result


def _relation(context: Context, e: tree.Binary, left: Value, right: Value) -> Value:
    for side, place in ((left, e.left), (right, e.right)):
        if side.fields is not None:
            raise Wrong("E0301", f"'{e.op}' compares single values, not records", place.span, found=side.type)
    if left.dims or right.dims:
        raise Wrong("E0301", f"'{e.op}' compares single values, not arrays", e.span)
    if left.type == right.type == "String":
        order = (left.text > right.text) - (left.text < right.text)
        return Value(dag.function(RELATION[e.op], dag.const(order), dag.const(0)), (), "Boolean")
    if "String" in (left.type, right.type):
        raise Wrong("E0301", f"'{e.op}' cannot compare {left.type} and {right.type}", e.span)
    numbers = {"Real", "Integer"}
    if left.type != right.type and not {left.type, right.type} <= numbers:
        raise Wrong("E0301", f"'{e.op}' cannot compare {left.type} and {right.type}", e.span)
    relation = Value(dag.function(RELATION[e.op], left.expr, right.expr), (), "Boolean")
    return at_event(context, relation) if e.op not in ("==", "<>") else relation


# ----------------------------------------------------------------------- requirements


def need_number(value: Value, span: Span) -> None:
    """Refuse what is no number."""
    if value.type not in ("Real", "Integer"):
        raise Wrong("E0301", "a number is needed here", span, expected="Real or Integer", found=value.type)


def _need(value: Value, type_: str, span: Span) -> None:
    if value.type != type_:
        raise Wrong("E0301", f"a {type_} is needed here", span, expected=type_, found=value.type)


def dims_text(dims: tuple[int, ...]) -> str:
    """Dimensions for messages."""
    return f"[{', '.join(map(str, dims))}]" if dims else "a scalar"


def sizes_differ(what: str, left: tuple[int, ...], right: tuple[int, ...], span: Span) -> Wrong:
    """Return the mistake for two incompatible sizes."""
    return Wrong(
        "E0302", f"{what} do not fit: {dims_text(left)} and {dims_text(right)}", span,
        expected=dims_text(left), found=dims_text(right),
    )  # fmt: skip


def changes(context: Context, *values: Value) -> bool:
    """Return whether a value changes in time: it depends on a variable, an input or time."""
    for value in values:
        inside = (*(value.items or ()), *(value.fields or {}).values())
        if inside and changes(context, *inside):
            return True
        if value.expr is not None and (
            dag.depends_on_time(value.expr)
            or any(
                (v := context.leaves[leaf.value[0]].variable) is not None and not v.known
                for leaf in dag.slots(value.expr)
            )
        ):
            return True
    return False


def continuous(context: Context, value: Value) -> bool:
    """Return whether a scalar may change between events: by time, an input, or a variable that is not discrete."""
    for leaf in dag.outside_events(value.expr):
        if leaf is dag.TIME:
            return True
        variable = context.leaves[leaf.value[0]].variable if leaf.op == "slot" else None
        if variable is not None and variable.kind in (Kind.UNKNOWN, Kind.INPUT):
            return True
    return False


def at_event(context: Context, value: Value) -> Value:
    """A value that jumps does so at an event, unless nothing in it changes or ``noEvent`` stands around it (8.5).

    What time alone decides is an event inside ``noEvent``, too: its value is the same, and a run that integrated across
    the jump of a prescribed position would miss the impulse of it.
    """
    if value.items is not None:
        return Value(None, value.dims, value.type, tuple(at_event(context, item) for item in value.items))
    literal = context.quiet > context.marked or (context.marked and _changes_with_variables(context, value))
    if literal or context.depth or not continuous(context, value):
        return value
    return Value(dag.event(value.expr), value.dims, value.type)


def _changes_with_variables(context: Context, *values: Value) -> bool:
    """Return whether a value depends on more than time: where time alone decides, a run stops at the kink."""
    for value in values:
        for _, piece in context.arrays.pieces(value):
            if piece.expr is not None and any(
                (v := context.leaves[leaf.value[0]].variable) is not None and not v.known
                for leaf in dag.slots(piece.expr)
            ):
                return True
    return False


def warn_kink(context: Context, what: str, span: Span, *values: Value) -> None:
    """Say that this has a kink, if it depends on what changes, and nobody has said that it is intended."""
    if context.quiet == 0 and _changes_with_variables(context, *values):
        context.model.say_once(
            "W0311",
            f"{what} has a kink: the solver integrates across it without stopping",
            span,
            hint="write noEvent(…) or smooth(0, …) around it if that is intended",
            subject=Subject.WRITING,
        )


# -------------------------------------------------------------------- if-expressions


@translates(tree.If)
def _if(context: Context, e: tree.If) -> Value:
    values = [*(value for _, value in e.branches), e.otherwise]
    chosen = context.choices.get(id(e))
    if chosen is not None:
        return context.value(values[chosen])
    conditions: list[Value] = []
    for condition_tree, _ in e.branches:
        condition = context.value(condition_tree)
        _need(condition, "Boolean", condition_tree.span)
        if condition.dims:
            raise Wrong("E0301", "a condition must be true or false, not an array", condition_tree.span)
        if context.depth:  # relations inside functions make no events (8.5)
            warn_kink(context, "this if-expression", e.span, condition)
        conditions.append(condition)
        if condition.expr.is_const and condition.expr.value:
            break
    open_ones = [k for k, c in enumerate(conditions) if not c.expr.is_const]
    last = len(conditions) - 1 if conditions[-1].expr.is_const and conditions[-1].expr.value else len(e.branches)
    known = bool(open_ones) and not any(changes(context, conditions[k]) for k in open_ones)
    level = context.known_ifs
    context.known_ifs += known
    try:
        result = context.value(values[last])
        for k in reversed(open_ones):
            result = choose(context, conditions[k], context.value(values[k]), result, e.span)
    except (OutOfRange, RowsDiffer, CallsItself) as wrong:  # rows: from an if-expression inside of this one
        if not known or (isinstance(wrong, CallsItself) and wrong.level != level):
            raise
        context.known_ifs = level
        return _by_rows(context, e, conditions, last, wrong)
    finally:
        context.known_ifs = level
    return result


def _by_rows(context: Context, e: tree.If, conditions: list[Value], last: int, wrong: Wrong) -> Value:
    """A subscript is out of range in a branch that not all rows take: take only those branches that are needed."""
    rows = _rows_of_branches(context, e, conditions, last)
    taken = [k for k, own in enumerate(rows) if len(own)]
    if len(taken) > 1:
        raise RowsDiffer(e, rows, wrong) from None
    if not taken:
        raise wrong
    return context.value([*(value for _, value in e.branches), e.otherwise][taken[0]])


def _rows_of_branches(context: Context, e: tree.If, conditions: list[Value], last: int) -> list[np.ndarray]:
    """For each branch, the flat positions of the rows that take it."""
    shape = context.space.shape
    left = np.ones(prod(shape), bool)
    rows = [np.zeros(0, int) for _ in range(len(e.branches) + 1)]
    for k, condition in enumerate(conditions[:last] if last < len(e.branches) else conditions):
        holds = align(np.asarray(context.known(condition, e.span)), len(shape))
        holds = np.broadcast_to(holds, shape).reshape(-1).astype(bool)
        rows[k] = np.flatnonzero(left & holds)
        left &= ~holds
    rows[last] = np.flatnonzero(left)
    return rows


def choose(context: Context, condition: Value, then: Value, otherwise: Value, span: Span) -> Value:
    """``if condition then … else …``, element by element."""
    if then.dims != otherwise.dims:
        if changes(context, condition):
            raise sizes_differ("the branches of an if-expression", then.dims, otherwise.dims, span)
        return then if context.scalar(condition, span, "the condition") else otherwise
    if then.fields is not None and otherwise.fields is not None and set(then.fields) == set(otherwise.fields):
        pairs = {name: (field, otherwise.fields[name]) for name, field in then.fields.items()}
        chosen = {name: choose(context, condition, *pair, span) for name, pair in pairs.items()}
        return record(chosen, then.dims, then.type)
    if then.fields is not None or otherwise.fields is not None:
        raise Wrong("E0301", "the branches of an if-expression differ in type", span,
                    expected=then.type, found=otherwise.type)  # fmt: skip
    types = {then.type, otherwise.type}
    if len(types) > 1 and not types <= {"Real", "Integer"}:
        raise Wrong("E0301", "the branches of an if-expression differ in type", span,
                    expected=then.type, found=otherwise.type)  # fmt: skip
    if then.type == "String":
        return then if context.scalar(condition, span, "the condition") else otherwise
    type_ = common_type((then, otherwise))
    return context.arrays.map(lambda a, b: dag.if_(condition.expr, a, b), then, otherwise, type=type_)
