"""Laws in equation position: ``Law.unilateral(force, gap, e);`` becomes a row of `lmoc.ir.law.Laws`.

The functions that stand for laws are marked in the library by ``annotation(__lmoc(law = "…"))``. Their inputs are the
arguments; everything else about them is here.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import prod

from lmoc.expression.units import parse_unit
from lmoc.ir.flat import Kind
from lmoc.ir.law import COMPLEMENTARY, LawKind
from lmoc.messages.diagnostics import nearest
from lmoc.messages.source import Span
from lmoc.semantics.classes.resolve import resolve
from lmoc.semantics.classes.scope import Member, Scope
from lmoc.semantics.classes.vendor import vendor_entry
from lmoc.semantics.drafts.draft import Column, Drafts, GroupDraft, LawDraft, compact, flat_column
from lmoc.semantics.mistakes.wrong import Wrong
from lmoc.semantics.values.context import Context
from lmoc.semantics.values.rows import Leaf
from lmoc.semantics.values.translate import changes, dims_text
from lmoc.semantics.values.unit_inference import unit_of_value
from lmoc.semantics.values.value import Value
from lmoc.syntax import tree

# the library's names of the arguments, and what they are in `Laws`
COLUMNS = {
    "force": "force",
    "gap": "motion",
    "velocity": "motion",
    "e": "restitution",
    "slip": "slip",
    "stick": "stick",
    "mu": "friction",
    "normal": "normal",
}
TEXTS = ("closing", "opening")


def law_function(context: Context, call: tree.Call) -> Scope | None:
    """The function that a call names, where it stands for a law."""
    try:
        found = resolve(context.scope.find_class(call.function)).base
    except Wrong:
        return None
    if not isinstance(found, Scope) or found.kind != "function":
        return None
    return found if vendor_entry(found.definition.annotation, "law") is not None else None


def misplaced(where: str, span: Span) -> Wrong:
    """Return the mistake of a law that is written where equations do not hold all the time."""
    return Wrong(
        "E0252",
        f"a law holds all the time: it is not allowed in {where}",
        span,
        expected="a law among the equations of the model, outside of 'when' and of 'if' on what changes in time",
        hint="let its arguments change: a limit of friction that is zero at times, a gap that is longer",
    )


def add_law(drafts: Drafts, context: Context, function: Scope, e: tree.CallEquation) -> None:
    """Draft the law that a call in equation position stands for.

    Parameters
    ----------
    context : where the call stands, with columns of its own

    Raises
    ------
    Wrong
        The arguments do not fit.
    """
    kind = _kind(function)
    given = _arguments(context, function, e.call)
    columns: dict[str, Column] = {}
    for name, (value, span) in given.items():
        if name not in TEXTS:
            columns[COLUMNS[name]] = _column(drafts, context, value, f"{name} of {e.call.span.text}", span)
    _check_unknown(context, given)
    _check_power(context, given, kind, e)
    if kind not in COMPLEMENTARY:
        name = f"direction of {e.call.span.text}"
        variable, index, _ = drafts.helpers.add(context.node, context.space, context.leaves, name, Kind.DISCRETE)
        columns["direction"] = flat_column(Leaf(variable, index), context.space.shape)
    if "e" in given and changes(context, given["e"][0]):
        raise Wrong("E0211", "the coefficient of restitution must be known before the run, but changes in time",
                    given["e"][1])  # fmt: skip
    texts = {name: given[name][0].text for name in TEXTS}
    drafts.laws.append(LawDraft(kind, columns, texts, prod(context.space.shape), e.span, context.node))


def _kind(function: Scope) -> LawKind:
    entry = vendor_entry(function.definition.annotation, "law")
    text = entry.value if isinstance(entry, tree.String) else ""
    try:
        return LawKind(text)
    except ValueError:
        raise Wrong("E0232", f"there is no law '{text}'", entry.span,
                    hint=nearest(text, [k.value for k in LawKind])) from None  # fmt: skip


def _inputs(function: Scope) -> dict[str, tree.Component]:
    """The inputs of a function, in their order."""
    members = function.table.items()
    return {n: m.component for n, m in members if isinstance(m, Member) and m.component.causality == "input"}


def _arguments(context: Context, function: Scope, call: tree.Call) -> dict[str, tuple[Value, Span]]:
    """Return the argument of each input, defaults included."""
    inputs = _inputs(function)
    given: dict[str, tuple[Value, Span]] = {}
    for name, argument in _pairs(list(inputs), call):
        if name in given:
            raise Wrong("E0217", f"the argument '{name}' is given twice", call.span)
        given[name] = context.value(argument), argument.span
    names: dict[str, Value] = {name: value for name, (value, _) in given.items()}
    inside = context.inside_function(function, names)
    for name, component in inputs.items():
        default = component.modification.value if component.modification else None
        if name not in given:
            if default is None:
                raise Wrong("E0217", f"the argument '{name}' of '{call.function}' is missing", call.span,
                            expected=", ".join(n for n in inputs if n not in TEXTS))  # fmt: skip
            names[name] = inside.value(default)
            given[name] = names[name], call.span
        _check_type(name, str(component.type), *given[name])
    return {name: given[name] for name in inputs}


def _pairs(names: list[str], call: tree.Call) -> Iterator[tuple[str, tree.Expression]]:
    if len(call.arguments) > len(names):
        raise Wrong("E0217", f"'{call.function}' is called with {len(call.arguments)} arguments", call.span,
                    expected=", ".join(names), found=str(len(call.arguments)))  # fmt: skip
    for name, argument in [*zip(names, call.arguments), *call.named]:
        if name not in names:
            raise Wrong("E0217", f"'{call.function}' has no argument '{name}'", call.span,
                        hint=nearest(name, names))  # fmt: skip
        yield name, argument


def _check_type(name: str, expected: str, value: Value, span: Span) -> None:
    text = expected == "String"
    if (value.type == "String") != text or value.type not in ("String", "Real", "Integer"):
        raise Wrong("E0301", f"the argument '{name}' of a law must be of type {expected}", span,
                    expected=expected, found=value.type)  # fmt: skip
    if value.dims:
        raise Wrong("E0302", f"the argument '{name}' of a law must be a single value", span,
                    found=dims_text(value.dims), hint="write the call in a 'for' loop")  # fmt: skip


def _check_unknown(context: Context, given: dict[str, tuple[Value, Span]]) -> None:
    """Force and motion of a law change in time: else it has nothing to determine."""
    for name in ("force", "gap", "velocity"):
        if name in given and not changes(context, given[name][0]):
            raise Wrong("E0233", f"the {name} of this law does not change: the law has nothing to determine",
                        given[name][1])  # fmt: skip


def _check_power(context: Context, given: dict[str, tuple[Value, Span]], kind: LawKind, e: tree.CallEquation) -> None:
    """Force times gap is an energy, force times velocity a power, where the units are known."""
    motion, power, unit = ("gap", "an energy", "J") if kind is LawKind.UNILATERAL else ("velocity", "a power", "W")
    units = [unit_of_value(context, given[name][0]) for name in ("force", motion)]
    if None in units:
        return
    if (units[0] * units[1]).exponents != parse_unit(unit).exponents:
        raise Wrong("E0303", f"the force times the {motion} of a law must be {power}", e.span,
                    expected=unit, found=f"({units[0]})·({units[1]})")  # fmt: skip


def _column(drafts: Drafts, context: Context, value: Value, name: str, span: Span) -> Column:
    """The variable that an argument is; an expression gets one of its own, with an equation."""
    shape, expr = context.space.shape, value.expr
    if expr.op == "slot" and expr.value[1] == 0:
        return flat_column(context.leaves[expr.value[0]], shape)
    if expr.is_const:
        return None, expr.value
    variable, index, slot = drafts.helpers.add(context.node, context.space, context.leaves, name)
    leaves, (left, right) = compact(context.leaves.items, slot, expr)
    columns = tuple(flat_column(leaf, shape) for leaf in leaves)
    drafts.groups.append(
        GroupDraft(left, right, columns, prod(shape), span, context.node, "argument", context.scope.library)
    )
    return flat_column(Leaf(variable, index), shape)
