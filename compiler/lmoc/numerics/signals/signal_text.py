"""Formulas for inputs as text in the language's own syntax, over time and parameters."""

from __future__ import annotations

import math

from lmoc.expression import dag
from lmoc.expression.dag import Expr
from lmoc.expression.functions import CALLABLE
from lmoc.ir.flat import FlatDAE, Kind
from lmoc.messages.diagnostics import Report, nearest
from lmoc.messages.source import Source
from lmoc.syntax import tree

_OPERATORS = {
    "+": dag.add, "-": dag.sub, "*": dag.mul, "/": dag.div, "^": dag.power,
    ".+": dag.add, ".-": dag.sub, ".*": dag.mul, "./": dag.div, ".^": dag.power,
}  # fmt: skip
_RELATIONS = {"<": "lt", "<=": "le", ">": "gt", ">=": "ge", "==": "eq", "<>": "ne", "and": "and", "or": "or"}
_NAMES = {"pi": math.pi, "e": math.e, "Modelica.Constants.pi": math.pi}
_BEFORE = "model Signal\n  Real signal = "


class _NotUnderstood(Exception):
    def __init__(self, text: str, node, hint: str = "") -> None:
        self.text, self.node, self.hint = text, node, hint


def formula_from_text(text: str, flat: FlatDAE, name: str, report: Report) -> tuple[Expr, tuple[int, ...]] | None:
    """A shape over time and parameters, and the parameters in its columns; None with an error in the report."""
    from lmoc.syntax.parse import parse

    own = Report()
    file = parse(Source(f"the signal for '{name}'", f"{_BEFORE}{text};\nend Signal;\n"), own)
    if own.errors:
        report.error("E0521", f"the signal for input '{name}' is not a formula: {text}", found=own.errors[0].message)
        return None
    value = _binding(file)
    columns: dict[int, int] = {}
    try:
        if value is None:
            raise _NotUnderstood(text, None)
        return _lower(value, flat, columns), tuple(columns)
    except _NotUnderstood as problem:
        report.error(
            "E0521",
            f"the signal for input '{name}' is not understood at '{problem.text}'",
            expected="a formula in time with numbers, parameters of the model and elementary functions",
            found=text,
            hint=problem.hint,
        )
        return None


def _binding(file: tree.File) -> tree.Expression | None:
    """The expression behind the equals sign of the only declaration; None where the text holds anything else."""
    if len(file.classes) != 1:
        return None
    (model,) = file.classes
    if model.equations or model.initial_equations or model.statements or len(model.elements) != 1:
        return None
    (item,) = model.elements
    if not isinstance(item, tree.Component) or item.modification is None or item.condition is not None:
        return None
    return item.modification.value


def _lower(node, flat: FlatDAE, columns: dict[int, int]) -> Expr:
    def lower(child) -> Expr:
        return _lower(child, flat, columns)

    if isinstance(node, tree.Number | tree.Boolean):
        return dag.const(float(node.value))
    if isinstance(node, tree.Ref):
        return _reference(node, flat, columns)
    if isinstance(node, tree.Unary):
        inner = lower(node.operand)
        return {"-": dag.neg, "+": lambda x: x, "not": lambda x: dag.function("not", x)}[node.op](inner)
    if isinstance(node, tree.Binary):
        chain = [node]  # a sum of many terms is a deep tree to the left: go down it without recursion
        while isinstance(chain[-1].left, tree.Binary):
            chain.append(chain[-1].left)
        value = lower(chain[-1].left)
        for binary in reversed(chain):
            value = _operation(binary.op, value, lower(binary.right))
        return value
    if isinstance(node, tree.If):
        result = lower(node.otherwise)
        for condition, value in reversed(node.branches):
            result = dag.if_(lower(condition), lower(value), result)
        return result
    if isinstance(node, tree.Call):
        return _call(node, [lower(a) for a in node.arguments])
    raise _NotUnderstood(node.span.text, node)


def _operation(op: str, left: Expr, right: Expr) -> Expr:
    return _OPERATORS[op](left, right) if op in _OPERATORS else dag.function(_RELATIONS[op], left, right)


def _call(node: tree.Call, arguments: list[Expr]) -> Expr:
    name = str(node.function)
    if name in ("noEvent", "smooth") and arguments:
        return arguments[-1]
    known = CALLABLE.get(name)
    if known is None or len(arguments) != known.arity:
        raise _NotUnderstood(node.span.text, node, nearest(name, [*CALLABLE]))
    return dag.function(known.name, *arguments)


def _reference(node: tree.Ref, flat: FlatDAE, columns: dict[int, int]) -> Expr:
    name = str(node)
    if name == "time":
        return dag.TIME
    found = flat.find(name)
    if found is not None and len(found) == 1 and flat.kind[found[0]] in (Kind.CONSTANT, Kind.PARAMETER):
        return dag.slot(columns.setdefault(int(found[0]), len(columns)))
    if name in _NAMES:
        return dag.const(_NAMES[name])
    parameters = [b.pattern for b in flat.blocks if b.kind == Kind.PARAMETER]
    raise _NotUnderstood(name, node, nearest(name, ["time", *parameters]))
