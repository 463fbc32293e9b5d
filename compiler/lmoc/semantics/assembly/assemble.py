"""Numbers for the variables, and the flat model's groups and assignments from their drafts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import isinf

import numpy as np

from lmoc.expression import dag
from lmoc.expression.dag import Expr
from lmoc.expression.text import number_text
from lmoc.ir.flat import Assignments, Block, Check, Decision, Group, Kind, Part, Slider, StateSelect
from lmoc.ir.law import Laws
from lmoc.messages.diagnostics import Report
from lmoc.messages.source import Source, Span
from lmoc.semantics.classes.looks import Looks
from lmoc.semantics.drafts.draft import AssignmentDraft, CheckDraft, Column, DecisionDraft, Drafts, GroupDraft, LawDraft
from lmoc.semantics.nodes.instance import Instance, Variable
from lmoc.support.distinct import distinct
from lmoc.support.indices import INDEX
from lmoc.support.records import dataclass


@dataclass(frozen=True, eq=False)
class Literals(Block):
    """Numbers that differ from row to row of a group, such as those of an iteration variable."""

    values: np.ndarray = None

    def name(self, position: int) -> str:
        """The number itself."""
        return number_text(float(self.values[position]))

    @property
    def pattern(self) -> str:
        """The range of the numbers."""
        return f"{number_text(float(self.values[0]))} … {number_text(float(self.values[-1]))}"


@dataclass(frozen=True, eq=False)
class VariableLayout:
    """The variables in their order, and the parts."""

    variables: list[Variable]
    instances: list[Instance]
    count: int

    def extended(self, variables: Sequence[Variable]) -> VariableLayout:
        """With further variables at the end."""
        offset = self.count
        for variable in variables:
            variable.offset = offset
            offset += variable.size
        return VariableLayout([*self.variables, *variables], self.instances, offset)


def lay_out(root: Instance) -> VariableLayout:
    """Give every variable its place and every part its number."""
    offset = 0
    variables = [v for v in root.variables() if v.type.name != "String"]
    for variable in variables:
        variable.offset = offset
        offset += variable.size
    instances = [i for i in root.instances() if i.owner is i]
    for number, instance in enumerate(instances):
        instance.part = number
    return VariableLayout(variables, instances, offset)


def make_blocks(layout: VariableLayout, sliders: Mapping[Variable, Slider]) -> list[Block]:
    """The table of variables; `sliders` are those that their declarations ask for."""
    return [
        Block(
            v.path, v.offset, v.size, v.kind, v.unit, v.type.name, v.description, v.flow, v.connector, v.output,
            _protected(v), v.final, v.structural, v.state_select, v.parent.owner.part, v.span, sliders.get(v),
            v.structural and not v.shaping,
        )
        for v in layout.variables
    ]  # fmt: skip


def _protected(node: Variable | Instance) -> bool:
    while node.parent is not None:
        if node.protected:
            return True
        node = node.parent
    return False


def make_parts(layout: VariableLayout, looks: Looks) -> list[Part]:
    """The table of parts."""
    position = {v: k for k, v in enumerate(layout.variables)}
    ports = [_ports(instance, position) for instance in layout.instances]
    has_ports_below = [False] * len(ports)
    for instance, own in zip(reversed(layout.instances), reversed(ports)):
        around = instance.parent
        if around is not None and (own or has_ports_below[instance.part]):
            has_ports_below[around.owner.part] = True
    return [
        Part(
            i.path, i.cls.full_name, i.description or i.cls.definition.description,
            own, not has_ports_below[i.part], i.component.span if i.component else i.cls.definition.span,
            i.parent.owner.part if i.parent else 0, looks.of(i.cls),
        )
        for i, own in zip(layout.instances, ports)
    ]  # fmt: skip


def _ports(instance: Instance, position: dict[Variable, int]) -> tuple[tuple[int, int], ...]:
    pairs: list[tuple[int, int]] = []
    for child in instance.children.values():
        if isinstance(child, Instance) and child.connector and child.parent is instance:
            for inner in child.instances():
                own = [v for v in inner.children.values() if isinstance(v, Variable) and v.kind > Kind.PARAMETER]
                flows = [v for v in own if v.flow]
                potentials = [v for v in own if not v.flow and not v.causality]
                pairs += [(position[p], position[f]) for p, f in zip(potentials, flows)]
    return tuple(pairs)


# ------------------------------------------------------------------------- literals


def pool_literals(columns: Sequence[Column], offset: int) -> Literals | None:
    """One block for all numbers that stand in columns."""
    numbers = [np.atleast_1d(np.asarray(index, float)) for variable, index in columns if variable is None]
    if not numbers:
        return None
    values = distinct(np.concatenate(numbers))
    path = (("literal", (len(values),)),)
    return Literals(path, offset, len(values), Kind.CONSTANT, protected=True, values=values)


def all_columns(drafts: Drafts) -> list[Column]:
    """The columns of everything that has been drafted."""
    lists = (
        drafts.groups,
        drafts.initial,
        drafts.bindings,
        drafts.starts,
        drafts.fixed,
        drafts.nominals,
        drafts.checks,
        drafts.decisions,
    )
    columns = [column for items in lists for item in items for column in item.columns]
    columns += [column for law in drafts.laws for column in law.columns.values()]
    actions = (*drafts.whens, *drafts.samples, *drafts.reinits, *drafts.terminations)
    return columns + [column for d in actions for column in (*d.columns.values(), *d.slots)]


# --------------------------------------------------------------------- the conversion


class Assembler:
    """Turns drafts into what the flat model holds; `own` are the texts of the user and of the model."""

    def __init__(self, literals: Literals | None, own: Sequence[Source] = ()):
        self.literals = literals
        self.own = own

    def slots(self, columns: Sequence[Column], rows: int) -> np.ndarray:
        """Variable indices, one row an instance."""
        if rows == 1:
            return np.array([[self._single(column) for column in columns]], dtype=INDEX).reshape(1, len(columns))
        result = np.empty((rows, len(columns)), INDEX)
        for k, (variable, index) in enumerate(columns):
            result[:, k] = self._literal(index) if variable is None else index + variable.offset
        return result

    def _single(self, column: Column) -> int:
        variable, index = column
        if variable is None:
            return int(np.ravel(self._literal(index))[0])
        return (int(index[0]) if isinstance(index, np.ndarray) else index) + variable.offset

    def _literal(self, numbers) -> np.ndarray:
        return self.literals.offset + np.searchsorted(self.literals.values, numbers)

    def groups(self, drafts: Sequence[GroupDraft]) -> list[Group]:
        """Groups; those of one equation that differ in their rows only become one."""
        table: dict[tuple, list] = {}
        for d in drafts:
            kinds = tuple(Kind.CONSTANT if v is None else v.kind for v, _ in d.columns)
            written = id(d.span and d.span.source), d.span and d.span.start, d.node.part, d.origin, d.smooth
            key = (d.left, d.right, *written, kinds)
            table.setdefault(key, [d]).append(self.slots(d.columns, d.rows))
        result = []
        for d, *slots in table.values():
            joined = slots[0] if len(slots) == 1 else np.concatenate(slots)
            result.append(Group(d.left, d.right, joined, d.span, d.node.part, d.origin, d.smooth))
        return result

    def assignments(self, drafts: Sequence[AssignmentDraft]) -> list[Assignments]:
        """Assignments, with variable indices."""
        result = []
        for d in drafts:
            target = np.atleast_1d(np.asarray(d.target, INDEX)) + d.variable.offset
            used = not d.library and self.is_of_package(d.span)
            given = not isinf(d.depth) and not used and not d.variable.from_start
            result.append(Assignments(target, d.shape, self.slots(d.columns, d.rows), d.span, of_class=not given))
        return result

    def is_of_package(self, span: Span | None) -> bool:
        """Return whether something is written in a text that the model only uses."""
        return span is None or not any(span.source is source for source in self.own)

    def starts(self, drafts: Sequence[AssignmentDraft]) -> list[Assignments]:
        """Start values with their ranks, those that count most last.

        Guesses of variables that shall not be states (``stateSelect`` avoid or never) come after all others. Among the
        rest those count most that are written nearest to the top of the model (Modelica's specification, 8.6.2), then
        those of variables that shall be states.
        """
        default = StateSelect.default
        keys = [(d.variable.state_select < default, d.depth, d.variable.state_select <= default) for d in drafts]
        rank = {key: k for k, key in enumerate(sorted(set(keys)))}
        ranked = [replace(a, rank=rank[key]) for a, key in zip(self.assignments(drafts), keys, strict=True)]
        return sorted(ranked, key=lambda a: -a.rank)

    def checks(self, drafts: Sequence[CheckDraft]) -> list[Check]:
        """Checks, with variable indices."""
        return [
            Check(
                d.condition, d.message, d.error, self.slots(d.columns, d.rows), d.span, d.at_events,
                0 if d.node is None else d.node.part,
            )
            for d in drafts
        ]  # fmt: skip

    def decisions(self, drafts: Sequence[DecisionDraft]) -> list[Decision]:
        """Decisions, those of one condition together."""
        table: dict[Expr, list[tuple[np.ndarray, np.ndarray]]] = {}
        for d in drafts:
            table.setdefault(d.condition, []).append((self.slots(d.columns, d.rows), d.held))
        return [Decision(c, *(np.concatenate(own) for own in zip(*found, strict=True))) for c, found in table.items()]

    def laws(self, drafts: Sequence[LawDraft]) -> list[Laws]:
        """Laws; those of one call that differ in their rows only become one."""
        table: dict[tuple, list] = {}
        for d in drafts:
            kinds = tuple(Kind.CONSTANT if v is None else v.kind for v, _ in d.columns.values())
            key = (d.kind, id(d.span.source), d.span.start, d.node.part, tuple(d.texts.values()), kinds)
            table.setdefault(key, [d]).append(self.slots(tuple(d.columns.values()), d.rows))
        result = []
        for d, *slots in table.values():
            columns = dict(zip(d.columns, np.concatenate(slots).T, strict=True))
            result.append(Laws(kind=d.kind, part=d.node.part, span=d.span, **columns, **d.texts))
        return result

    def literal_values(self) -> list[Assignments]:
        """Return the values of the literals."""
        if self.literals is None:
            return []
        at = self.literals.offset + np.arange(self.literals.size)
        return [Assignments(at, dag.const(np.nan), np.zeros((len(at), 0), int), None, self.literals.values)]


def in_order(bindings: list[Assignments], count: int, blocks: list[Block], report: Report) -> tuple[Assignments, ...]:
    """Bindings so that each uses only what precedes it; a cycle is an error."""
    owner = np.full(count, -1)
    for k, a in enumerate(bindings):
        owner[a.target] = k
    needs = [sorted(set(distinct(owner[a.slots]).tolist()) - {-1}) if a.slots.size else [] for a in bindings]
    state = [0] * len(bindings)  # 0 not seen, 1 open, 2 done
    order: list[int] = []
    for start in range(len(bindings)):
        stack = [(start, iter(needs[start]))]
        if state[start]:
            continue
        state[start] = 1
        while stack:
            k, rest = stack[-1]
            following = next((n for n in rest if state[n] != 2), None)
            if following is None:
                state[k] = 2
                order.append(k)
                stack.pop()
            elif state[following] == 1:
                _report_cycle([s for s, _ in stack], following, bindings, blocks, report)
                state[k] = 2
                stack.pop()
            else:
                state[following] = 1
                stack.append((following, iter(needs[following])))
    return tuple(bindings[k] for k in order)


def _report_cycle(
    path: list[int], again: int, bindings: list[Assignments], blocks: list[Block], report: Report
) -> None:
    def name(k: int) -> str:
        first = int(bindings[k].target[0])
        block = next(b for b in blocks if b.offset <= first < b.offset + b.size)
        return block.name(first - block.offset)

    cycle = [name(k) for k in path[path.index(again) :]]
    report.error(
        "E0207",
        f"the value of '{cycle[0]}' depends on itself",
        bindings[again].span,
        found=" → ".join([*cycle, cycle[0]]),
    )
