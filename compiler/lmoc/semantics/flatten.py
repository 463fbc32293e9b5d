"""From syntax trees to the flat model."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import reduce
from pathlib import Path

import numpy as np

from lmoc.expression import dag
from lmoc.ir.flat import Assignments, Block, FlatDAE, Group, Kind, Simplified, StateSelect
from lmoc.messages.diagnostics import Report, Subject
from lmoc.messages.source import Source, Span
from lmoc.semantics.algorithms import add_algorithm, assigned_at_events
from lmoc.semantics.assembly.assemble import (
    Assembler,
    all_columns,
    in_order,
    lay_out,
    make_blocks,
    make_parts,
    pool_literals,
)
from lmoc.semantics.assembly.ledger import join_sums, ledger
from lmoc.semantics.classes.choose import choose_model, left_out, mistakes_in, open_scopes
from lmoc.semantics.classes.looks import Looks
from lmoc.semantics.classes.vendor import vendor_entry
from lmoc.semantics.connections.balance import check_balance, check_connectors
from lmoc.semantics.connections.connect import balances, collect, equalities, unconnected
from lmoc.semantics.connections.overdetermined import graph, residue_groups
from lmoc.semantics.drafts.draft import Drafts, GroupDraft, with_one, without_ones
from lmoc.semantics.drafts.long_sums import LongSums
from lmoc.semantics.drafts.unit_check import check_units, report_unknown_units
from lmoc.semantics.equations import EquationSection
from lmoc.semantics.events import functions as _events  # noqa: F401  registers pre, edge, …
from lmoc.semantics.events import impure as _impure  # noqa: F401  registers a generator with a hidden state
from lmoc.semantics.events.assemble import with_events
from lmoc.semantics.events.whens import mark
from lmoc.semantics.instances.declarations import declare, settle_computed, settle_explicit, settle_from_start
from lmoc.semantics.instances.elaboration import Elaboration
from lmoc.semantics.instances.experiment import experiment_of
from lmoc.semantics.instances.slider import sliders_of
from lmoc.semantics.mistakes.wrong import NoModel, SeveralModels, Wrong
from lmoc.semantics.nodes.class_check import check_classes
from lmoc.semantics.nodes.instance import Instance, InstanceNode, Variable, root_instance
from lmoc.semantics.nodes.overrides import Overrides
from lmoc.semantics.topology import Topology, expand
from lmoc.semantics.values import array_builtins as _arrays  # noqa: F401  registers functions of arrays
from lmoc.semantics.values import functions as _functions  # noqa: F401  registers the translation of calls
from lmoc.semantics.values import generators as _generators  # noqa: F401  registers random numbers
from lmoc.semantics.values import texts as _texts  # noqa: F401  registers String
from lmoc.semantics.values import variable_subscripts as _names  # noqa: F401  registers that of names
from lmoc.semantics.values.context import Context
from lmoc.semantics.values.helpers import WEIGHT
from lmoc.semantics.values.reference import named_variables
from lmoc.sources.packages import Folder
from lmoc.support.distinct import distinct
from lmoc.syntax import tree

MANY_ALONE = 1000  # so many parts of an array are not left without connection on purpose


def flatten(
    files: Sequence[tree.File],
    library: Sequence[tree.File],
    model: str | None,
    parameters: Mapping[str, object],
    report: Report,
    folders: Sequence[Folder] = (),
) -> FlatDAE:
    """The flat model.

    Parameters
    ----------
    files : the user's files
    library : those of the library, whose classes are global names
    model : name of the model; None: the only one that no other class uses
    parameters : {dotted name: value}, applied over everything else
    report : collects what is wrong
    folders : where classes are looked for that the files do not define

    Raises
    ------
    ModelError
        With everything that is wrong, as far as one mistake does not follow from another.
    """
    try:
        cls = choose_model(open_scopes(files, library, report, folders), files, model)
    except Wrong as wrong:
        refused = mistakes_in(files)  # which may be the reason
        report.diagnostics += refused
        if not refused or not isinstance(wrong, NoModel | SeveralModels):
            wrong.put_into(report)
    report.check()
    overrides = Overrides(parameters)
    drafts = Drafts()
    root = root_instance(cls, overrides.modifier())
    elaboration = Elaboration(root, report, overrides.elements, LongSums(drafts))
    named = tuple(file.span.source for file in files)
    own = (*named, *_if_own(cls.definition.span.source, folders))
    try:
        flat = _Flattening(elaboration, overrides, drafts, named, own).run()
    except Wrong as wrong:  # nothing of the model can be made: it extends itself, for instance
        wrong.put_into(report)
    except RecursionError:
        hint = "hundreds of classes are nested, or hundreds of values use each other"
        message = f"what '{cls.full_name}' is made of is nested too deeply"
        report.error("E0227", message, cls.definition.name_span, hint=hint)
    report.check()
    notes = (d for d in flat.notes if d.subject is not Subject.WRITING or _is_in(d.span, own))
    return replace(flat, notes=(*notes, *left_out(files, report)))


def _if_own(source: Source, folders: Sequence[Folder]) -> tuple[Source, ...]:
    """Return the text of a class that is only named, unless it has been found in a folder of libraries."""
    place = Path(source.name).absolute()
    around = [folder for folder in folders if place.is_relative_to(folder.path.absolute())]
    nearest = max(around, key=lambda folder: len(folder.path.absolute().parts), default=None)
    return () if nearest is None or nearest.library else (source,)


def _is_in(span: Span | None, sources: Sequence[Source]) -> bool:
    return span is None or any(span.source is source for source in sources)


class _Flattening:
    """The steps from the instance tree to the flat model."""

    def __init__(
        self,
        model: Elaboration,
        overrides: Overrides,
        drafts: Drafts,
        named: tuple[Source, ...],
        own: tuple[Source, ...],
    ):
        self.model = model
        self.named = named  # the texts that the user has named
        self.own = own  # those, and that of a class named that is the user's to change
        self.report = model.report
        self.overrides = overrides
        self.drafts = drafts
        self._unconnected: dict[InstanceNode, tuple[Variable, np.ndarray]] = {}

    def run(self) -> FlatDAE:
        """From the instance tree to the flat model."""
        model, root = self.model, self.model.root
        self._draft()
        layout = self.layout.extended(model.long_sums.variables).extended(self.drafts.helpers.variables)
        literals = pool_literals(all_columns(self.drafts), layout.count)
        count = layout.count + (literals.size if literals else 0)
        assembler = Assembler(literals, self.own)
        sliders = sliders_of(model, layout.variables, layout.instances)
        blocks = make_blocks(layout, sliders) + ([literals] if literals else [])
        kinds = np.repeat(np.array([b.kind for b in blocks], np.uint8), [b.size for b in blocks])
        written = self.drafts.groups, self.drafts.initial
        self._take_actual()
        groups = assembler.groups(self.drafts.groups)
        connections = self._connections(kinds)
        groups += connections
        self._check_balance()
        bindings = assembler.literal_values() + assembler.assignments(self.drafts.bindings)
        bindings = self.overrides.apply(bindings, root)
        ordered = in_order(bindings, count, blocks, self.report)
        parts = make_parts(layout, Looks(self.report))
        entries = ledger(blocks, parts, count, _zeros(self.drafts, count))
        flat = FlatDAE(
            name=root.cls.full_name,
            description=root.cls.definition.description,
            blocks=(*blocks, *entries.blocks),
            parts=tuple(parts),
            groups=(*groups, *entries.groups),
            sums=join_sums(join_sums(self.sums, model.long_sums.rows()), entries.sums),
            initial_groups=tuple(assembler.groups(self.drafts.initial)),
            bindings=ordered,
            starts=tuple(assembler.starts(self.drafts.starts)),
            fixed=tuple(assembler.assignments(self.drafts.fixed)),
            nominals=tuple(assembler.assignments(self.drafts.nominals)),
            checks=tuple(assembler.checks(self.drafts.checks)),
            decisions=tuple(assembler.decisions(self.drafts.decisions)),
            laws=tuple(assembler.laws(self.drafts.laws)),
            experiment=experiment_of(root.cls, model),
            overrides=dict(self.overrides.given),
            notes=tuple(d for d in self.report.diagnostics if d.severity != "error"),
        )
        if self._weight is None:
            return with_events(flat, self.drafts, assembler, self.report)
        groups, initial = (assembler.groups(drafts) for drafts in written)
        other = replace(flat, groups=(*groups, *connections, *entries.groups), initial_groups=tuple(initial))
        weight = self._weight.offset
        found = with_events(_with_constant(flat, weight, 1.0), self.drafts, assembler, self.report)
        return replace(found, simplified=Simplified(with_events(other, self.drafts, assembler, Report()), weight))

    @property
    def _weight(self) -> Variable | None:
        """The weight of the actual expressions of homotopies, which is 1 in a run."""
        return self.drafts.helpers.single.get(WEIGHT)

    def _take_actual(self) -> None:
        """Leave homotopies with their actual expressions."""
        weight, drafts = self._weight, self.drafts
        if weight is not None:
            for name in ("groups", "initial", "bindings", "starts", "fixed", "nominals", "checks", "reinits",
                         "terminations"):  # fmt: skip
                setattr(drafts, name, [with_one(draft, weight) for draft in getattr(drafts, name)])

    def _draft(self) -> None:
        """The instance tree, and what its declarations and equations say."""
        model, root = self.model, self.model.root
        model.populate(root)
        check_classes(root.instances(), self.report)
        self.overrides.check(root, self.report)
        if "ledger" in root.children:
            span = root.children["ledger"].name_span
            self.report.error("E0204", "'ledger' is the name of the energy ledger that every model has", span)
        expand(model)
        self.layout = lay_out(root)
        model.topology = Topology(model)
        self._mark_discrete()
        settle_computed(model, root.variables())
        settle_from_start(model, root.variables())
        for variable in root.variables():
            declare(model, self.drafts, variable)
        for instance in root.instances():
            self._equations(instance)
        try:
            model.topology.check(self.drafts)
        except Wrong as wrong:
            wrong.put_into(self.report)
        settle_explicit(self.drafts)
        report_unknown_units(self.layout.variables, self.report)
        check_units(self.drafts, self.report, self.named)
        for drafts in (self.drafts.groups, self.drafts.initial, self.drafts.bindings, self.drafts.starts):
            drafts[:] = map(without_ones, drafts)
        self.connections = collect(self.drafts.connects, self.layout.count, self.report, self._break_loops())
        self.drafts.checks += self.connections.equal
        given = {id(v) for draft in self.drafts.groups for v, _ in draft.columns}
        for variable in root.variables():  # with an equation for its flow, a node needs no other
            variable.is_node = variable.is_node and id(variable) not in given
        self.report.check()  # what follows needs all equations

    def _break_loops(self) -> dict[tuple[int, int], set[int]]:
        """Add what loops of overdetermined connectors say, and return which equations of theirs are left out for it."""
        try:
            found = graph(self.drafts.connects, self.drafts.roots)
            self.drafts.groups += residue_groups(self.model, found, self.drafts.connects)
        except Wrong as wrong:
            wrong.put_into(self.report)
            return {}
        return found.left_out

    def _mark_discrete(self) -> None:
        """Mark variables assigned in when-equations as discrete (3.8.4), and those of reinit as states (4.4.4.2)."""
        for instance in self.model.root.instances():
            for scope in instance.cls.lineage():
                context = Context(self.model, instance, scope)
                found = (
                    *mark(context, scope.definition.equations, named_variables),
                    *assigned_at_events(context, scope.definition.statements),
                )
                for what, variable in found:
                    if what == "state":
                        variable.state_select = max(variable.state_select, StateSelect.always)
                    elif variable.kind == Kind.UNKNOWN:
                        variable.kind = Kind.DISCRETE

    def _equations(self, instance: Instance) -> None:
        for scope in instance.cls.lineage():
            definition = scope.definition
            for equations, initial in ((definition.equations, False), (definition.initial_equations, True)):
                section = EquationSection(self.drafts, instance, initial)
                context = Context(self.model, instance, scope)
                for equation in equations:
                    section.add(context, equation)
            for initial in (False, True):
                for statements in definition.algorithms(initial):
                    add_algorithm(self.drafts, Context(self.model, instance, scope), statements, initial)

    def _connections(self, kinds: np.ndarray) -> list[Group]:
        layout = self.layout
        groups = equalities(self.connections, kinds)
        self.sums, connected = balances(self.connections)
        flows = [v for v in layout.variables if v.flow_from_outside]
        for variable, positions in unconnected(flows, connected, layout.count):
            slots = (variable.offset + positions)[:, None]
            part = variable.parent.owner.part
            groups.append(Group(dag.slot(0), dag.ZERO, slots, variable.component.span, part, "unconnected"))
            self._unconnected.setdefault(variable.parent, (variable, positions))
        self._refuse_unconnected()
        self._warn_unconnected()
        return groups

    def _refuse_unconnected(self) -> None:
        """Thousands of parts without any connection are a wrong number: this is reported before they are reduced."""
        moving = {id(v.parent.owner) for d in self.drafts.groups for v in _derived(d)}
        ports: dict[Instance, list[np.ndarray]] = {}
        for port, (variable, positions) in self._unconnected.items():
            elements = distinct(positions // (variable.size // port.owner.size))
            ports.setdefault(port.owner, []).append(elements)
        for part, open_ends in ports.items():
            own = [c for c in part.children.values() if isinstance(c, Instance) and c.connector and c.parent is part]
            if len(own) < 2 or len(open_ends) < len(own) or id(part) in moving:
                continue
            alone = reduce(np.intersect1d, open_ends)
            if len(alone) >= MANY_ALONE:
                self.report.error(
                    "E0402",
                    f"{len(alone)} elements of '{part.label}' are connected to nothing: nothing fixes where they are",
                    part.name_span,
                    hint="connect them, or declare fewer",
                )

    def _warn_unconnected(self) -> None:
        """Ports to which nothing is connected: said once for each, at the declaration of its part."""
        for port, (variable, positions) in self._unconnected.items():
            part = port.owner
            if not isinstance(port, Instance) or part.parent is None or part.parent.cls.library:
                continue
            if variable.is_node or _may_be_open(port):
                continue
            first = int(positions[0]) // (variable.size // port.size)
            more = len(positions) * port.size // variable.size - 1
            name = Block(port.path, 0, port.size, Kind.UNKNOWN).name(first)
            self.report.warning(
                "W0312",
                f"'{name}' is connected to nothing" + (f", nor are {more} more of its array" if more else ""),
                part.name_span,
                hint="its flows are zero; connect it if it should be held or driven",
                subject=Subject.WRITING,
            )

    def _check_balance(self) -> None:
        if self.report.errors:
            return  # equations are missing because they are wrong
        check_connectors(self.model.root.instances(), self.model)
        if not self.report.errors:
            check_balance(self.layout.instances, self.drafts, self.connections, self.layout.variables, self.report)


def _may_be_open(port: Instance) -> bool:
    """Return whether ``annotation(__lmoc(open = true))`` says that a port works unconnected as well."""
    value = vendor_entry(port.component.annotation, "open")
    return isinstance(value, tree.Boolean) and value.value


def _derived(draft: GroupDraft) -> Iterator[Variable]:
    """The variables of whose derivatives a group speaks."""
    for side in (draft.left, draft.right):
        for leaf in dag.slots(side):
            variable = draft.columns[leaf.value[0]][0]
            if leaf.value[1] and variable is not None:
                yield variable


def _with_constant(flat: FlatDAE, variable: int, value: float) -> FlatDAE:
    """The flat model with a constant in the place of a parameter."""
    blocks = (replace(b, kind=Kind.CONSTANT) if b.offset == variable else b for b in flat.blocks)
    binding = Assignments(np.array([variable]), dag.const(value), np.zeros((1, 0), int))
    return replace(flat, blocks=tuple(blocks), bindings=(binding, *flat.bindings))


def _zeros(drafts: Drafts, count: int) -> np.ndarray:
    """Return which constants and parameters are written as zero: they add nothing to the ledger."""
    zero = np.zeros(count, bool)
    for draft in drafts.bindings:
        if draft.shape is dag.ZERO and draft.variable.kind == Kind.CONSTANT:
            zero[draft.target + draft.variable.offset] = True
    return zero
