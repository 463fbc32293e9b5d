"""Every part has as many equations as unknowns (Modelica specification, 4.7).

Counted is what a class says itself: its own variables and those of its own connectors against its own equations.
Each flow of an own connector is given from outside, and each connector that is connected inside brings one equation a
flow. A port of a part inside adds one unknown and one equation, whether it is connected or not: it need not be counted.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from math import prod

import numpy as np

from lmoc.ir.flat import Kind
from lmoc.messages.diagnostics import Label, Report
from lmoc.messages.source import Span
from lmoc.semantics.classes.scope import Scope
from lmoc.semantics.connections.components import components
from lmoc.semantics.connections.connect import Connections, Edges, owner_of
from lmoc.semantics.connections.overdetermined import constraint_of, residues
from lmoc.semantics.drafts.draft import Drafts
from lmoc.semantics.nodes.instance import Instance, Variable
from lmoc.semantics.values.context import Model
from lmoc.support.distinct import distinct


def check_connectors(instances: Sequence[Instance], model: Model) -> None:
    """A connector has as many flows as potentials; an overdetermined record counts as its residues (9.4)."""
    report = model.report
    seen: set[int] = set()
    for instance in instances:
        if not instance.connector or instance.expandable or id(instance.cls) in seen:
            continue
        seen.add(id(instance.cls))
        own = [v for v in _without_constraint(instance) if v.kind > Kind.PARAMETER]
        size = [prod(v.total[len(instance.total) :]) for v in own]
        flows = sum(n for v, n in zip(own, size) if v.flow)
        potentials = sum(n for v, n in zip(own, size) if not v.flow and not v.causality)
        for record in instance.children.values():
            if constraint_of(record) is not None and not record.component.flow:
                potentials += residues(model, record) * prod(record.total[len(instance.total) :])
        if flows != potentials:
            report.error(
                "E0308",
                f"the connector '{instance.cls.name}' has {potentials} potential{'s' * (potentials != 1)} "
                f"but {flows} flow{'s' * (flows != 1)}",
                instance.cls.definition.name_span,
                expected="as many flows as potentials",
            )


def _without_constraint(node: Instance) -> Iterator[Variable]:
    """The variables of a connector, and of records in it that are not overdetermined."""
    for child in node.children.values():
        if isinstance(child, Variable):
            yield child
        elif isinstance(child, Instance) and child.kind == "record" and constraint_of(child) is None:
            yield from _without_constraint(child)


class _Count:
    """Unknowns and equations that one instance says itself, over all elements of its array."""

    def __init__(self):
        self.unknowns = 0
        self.equations = 0
        self.used: set[int] = set()  # ids of variables that its equations mention
        self.given_outside: list[Span] = []  # values that the part around gives to its variables
        self.given_variables: list[Variable] = []  # those
        self.written: list[Span] = []  # its own equations
        self.inputs: list[Variable] = []  # of parts inside, which it has to give


def check_balance(
    parts: Sequence[Instance], drafts: Drafts, connections: Connections, variables: Sequence[Variable], report: Report
) -> None:
    """Report inputs that nobody gives, and each class whose instance has too few or too many equations."""
    counts: dict[int, _Count] = defaultdict(_Count)
    given = _connected_signals(connections)
    taken = _taken_from_outside(drafts, given)
    _count_equations(counts, drafts, taken)
    _count_connections(counts, connections)
    bound = {id(d.columns[0][0]) for d in drafts.groups if d.origin == "binding"} - taken
    unbound = [v for v in variables if _is_input(v) and id(v) not in bound]
    missing = [v for v in unbound if not _is_given(v, counts, given)]
    for variable in missing:
        part = variable.parent.owner
        report.error(
            "E0310",
            f"the input '{variable.label}' has no value",
            part.span,
            hint=f"write {part.name}({variable.name} = …), or an equation or a connect for it",
        )
    for variable in variables:
        if variable.kind in (Kind.UNKNOWN, Kind.DISCRETE) and not _is_input(variable):
            count = counts[id(variable.parent.owner)]
            count.unknowns += variable.size
            count.equations += variable.size * variable.flow_from_outside
    for variable in unbound:
        around = variable.parent.owner.parent
        counts[id(around.owner)].unknowns += variable.size
        counts[id(around.owner)].inputs.append(variable)
    silent = {id(v.parent.owner) for v in variables if v.connector and constraint_of(v.parent) is not None}
    silent |= {id(v.parent.owner.parent.owner) for v in missing}
    seen: set[int] = set()
    for part in parts:
        count = counts[id(part)]
        if count.unknowns != count.equations and id(part) not in silent and id(part.cls) not in seen:
            seen.add(id(part.cls))
            _report(part, count, variables, report)


def _is_input(variable: Variable) -> bool:
    """Return whether an unknown is a public input of a part, and there is any in an array of parts."""
    if not variable.size or variable.causality != "input" or variable.kind not in (Kind.UNKNOWN, Kind.DISCRETE):
        return False
    return variable.parent.owner.parent is not None and not variable.hidden


def _taken_from_outside(drafts: Drafts, connected: np.ndarray) -> set[int]:
    """Inputs that are connected, and bound in their own class: ``input Real u = inner_u`` gives inner_u its value."""
    found = set()
    for draft in drafts.groups:
        variable = draft.columns[0][0] if draft.origin == "binding" else None
        if variable is not None and _is_input(variable) and variable.value.node is variable.parent.owner:
            if connected[variable.offset : variable.offset + variable.size].any():
                found.add(id(variable))
    return found


def _count_equations(counts: dict[int, _Count], drafts: Drafts, taken: set[int]) -> None:
    for draft in drafts.groups:
        count = counts[id(draft.node)]
        own = draft.columns[0][0] if draft.origin == "binding" else None
        if own is not None and _is_input(own) and id(own) not in taken:
            continue  # given from outside, like the input itself
        # these come with a variable of their own; those of loops of overdetermined connectors stand for others
        own = draft.origin in ("sum", "argument", "condition", "connection")
        count.equations += draft.rows * (not own)
        if draft.origin == "binding" and draft.span is not None:
            binding = draft.columns[0][0].value
            if binding.node is not None and binding.node is not draft.node:
                count.given_outside.append(draft.span)
                count.given_variables.append(draft.columns[0][0])
        if draft.origin == "equation" and draft.span is not None and draft.span not in count.written:
            count.written.append(draft.span)
        count.used.update(id(v) for v, _ in draft.columns if v is not None)
    for law in drafts.laws:
        count = counts[id(law.node)]
        count.equations += law.rows
        count.written.append(law.span)
        count.used.update(id(v) for v, _ in law.columns.values() if v is not None)


def _count_connections(counts: dict[int, _Count], connections: Connections) -> None:
    """Own connectors that are connected inside, and signals, for each part in whose class the connects stand."""
    owner = np.array([id(c.node) for c in connections.connects], object)
    flows = defaultdict(list)
    edges = connections.through
    for ends, side in ((edges.left, "left"), (edges.right, "right")):
        inside = ends >= connections.count
        for k in distinct(edges.connect[inside]):
            node = owner_of(getattr(connections.connects[k], side))  # another one where an outer declaration brings it
            flows[id(node)].append(ends[inside & (edges.connect == k)])
    for node, ends in flows.items():
        counts[node].equations += len(distinct(np.concatenate(ends)))
    signals = defaultdict(list)
    for k, left, right in _signal_edges(connections):
        signals[owner[k]].append((left, right, k))
    for node, parts in signals.items():
        joined = Edges.join(parts)
        nodes, label, _, _ = components(joined.left, joined.right)
        counts[node].equations += len(nodes) - (int(label.max()) + 1)


def _signal_edges(connections: Connections):
    edges = connections.across
    for k, draft in enumerate(connections.connects):
        if _carries_signal(draft.left):
            own = edges.connect == k
            yield k, edges.left[own], edges.right[own]


def _carries_signal(end: Instance | Variable) -> bool:
    return isinstance(end, Variable) or any(v.causality for v in end.variables())


def _connected_signals(connections: Connections) -> np.ndarray:
    """Mask over all variables: connected by a signal connection."""
    found = np.zeros(connections.count, bool)
    for _, left, right in _signal_edges(connections):
        found[left] = found[right] = True
    return found


def _is_given(variable: Variable, counts: dict[int, _Count], connected: np.ndarray) -> bool:
    """Return whether an equation outside its part mentions an input, or a connection reaches it."""
    if connected[variable.offset : variable.offset + variable.size].any():
        return True
    around = variable.parent.owner.parent
    while around is not None:
        if id(variable) in counts[id(around.owner)].used:
            return True
        around = around.parent
    return False


def _report(part: Instance, count: _Count, variables: Sequence[Variable], report: Report) -> None:
    cls: Scope = part.cls
    elements = max(1, part.size)
    unknowns, equations = count.unknowns / elements, count.equations / elements
    flows = sum(v.size for v in variables if v.flow_from_outside and v.parent.owner is part) / elements
    unknowns, equations = f"{unknowns:g}", f"{equations:g}"
    labels: tuple[Label, ...] = ()
    if count.equations < count.unknowns:
        hint = _why_few(part, count, variables, flows)
    else:
        hint = "" if part.parent else "its parts and their connections have their own equations: they need no others"
        labels = tuple(Label(span, "this is one equation too many") for span in count.given_outside[:3])
        if not labels and len(count.written) <= 3:
            labels = tuple(Label(span, "an equation of its own") for span in count.written)
    what = "model" if part.parent is None else "part"
    place = cls.definition.name_span
    if cls.library and count.given_outside and count.equations > count.unknowns:
        place, hint, labels = count.given_outside[0], _start_hint(count), labels[1:]
    report.error(
        "E0307",
        f"the {what} '{cls.name}' has {unknowns} unknown{'s' * (unknowns != '1')} "
        f"but {equations} equation{'s' * (equations != '1')}",
        place,
        expected="as many equations as unknowns",
        hint=hint,
        labels=labels,
    )


def _start_hint(count: _Count) -> str:
    """Return a hint for a value given to an unknown that already has an equation."""
    variable, text = count.given_variables[0], count.given_outside[0].text
    start = f"'{variable.name}(start = {text}, fixed = true)'"
    return f"its own equations determine '{variable.name}': for a start write {start}"


def _why_few(part: Instance, count: _Count, variables: Sequence[Variable], flows: float) -> str:
    """Return a hint at what may be missing."""
    own = [v for v in variables if v.parent.owner is part and v.kind in (Kind.UNKNOWN, Kind.DISCRETE) and not v.flow]
    unused = [v for v in own if id(v) not in count.used and v.causality != "input" and not v.connector]
    if unused:
        names = ", ".join(f"'{v.name}'" for v in unused[:5])
        return f"{names} {'occurs' if len(unused) == 1 else 'occur'} in no equation of the class"
    if count.inputs:
        names = ", ".join(f"'{v.label}'" for v in count.inputs[:5])
        return f"the inputs of its parts are among the unknowns: {names}"
    if flows:
        return f"{flows:g} of the equations {'comes' if flows == 1 else 'come'} from its connections, one for each flow"
    if 1 < len(own) <= 5:
        return "the unknowns are " + ", ".join(f"'{v.name}'" for v in own)
    return ""
