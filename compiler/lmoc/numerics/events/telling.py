"""What is told of the events of a run: their records, the warnings and assertions that belong to them."""

from __future__ import annotations

import numpy as np

from lmoc.engine.book import Entry
from lmoc.engine.event_walk import START, TERMINAL, TIME, WHEN
from lmoc.expression.dag import slots
from lmoc.ir.flat import Kind
from lmoc.messages.diagnostics import Report, Subject
from lmoc.numerics.events.chatter import where
from lmoc.numerics.events.happened import Happened
from lmoc.numerics.events.layout import EventLayout
from lmoc.numerics.events.tables import PlanTables
from lmoc.numerics.observe.event import Event
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.status import Status, Stopped

_KINDS = {WHEN: "when", START: "when", TIME: "time", TERMINAL: "when"}


class Teller:
    """Tells of what has been written down of events."""

    def __init__(self, layout: EventLayout, report: Report) -> None:
        self._layout, self._report = layout, report
        self._tables, self._told = layout.plan.once(PlanTables), layout.plan.once(told_variables)

    def tell(self, entry: Entry, records: list[Event]) -> None:
        """Record what has happened, warn of assertions, and stop where that is an end.

        Raises
        ------
        Stopped
        """
        self._warn_of_lost(entry)
        happened = self._tables.happened(entry.conditions)
        self._record(entry, happened, records)
        self._judge(entry.time, happened)
        for k in happened.terminations:
            raise Stopped(Status.OK, self._layout.events.terminations[k].message)

    def _record(self, entry: Entry, happened: Happened, records: list[Event]) -> None:
        """Record branches of `when`, and changes that are told of.

        These are relations that decide about continuous equations, and the model's own discrete variables that are
        counted or true; these where no `when` tells of the event.
        """
        flat, events, t, lost = self._layout.flat, self._layout.events, entry.time, entry.lost
        for k, row in happened.whens:
            when = events.whens[k]
            name = flat.parts[when.part].pattern or flat.name
            text = when.text if len(when.active) == 1 else f"{when.text} [{row + 1}]"
            records.append(Event(t, name, _KINDS[entry.kind], "", text, 0.0, lost))
            lost = 0.0
        for k, *change in entry.changes:
            variable = int(self._told[k])
            block = flat.block_at(variable)
            if block.protected or not happened.whens:
                before, after = (_shown(block.quantity, value) for value in change)
                kind = "relation" if block.protected else "change"
                records.append(Event(t, flat.variable_name(variable), kind, before, after))

    def _judge(self, t: float, happened: Happened) -> None:
        """Assertions that belong to events."""
        for k, row in happened.broken:
            check = self._layout.flat.checks[k]
            message = self._layout.flat.message_of(check, row)
            if check.error:
                raise Stopped(Status.ASSERTION, f"an assertion does not hold: {where(message, check.span)}")
            self._report.warning("W0551", f"{message} (t = {t:.6g} s)", check.span)

    def _warn_of_lost(self, entry: Entry) -> None:
        """Warn of a discrete variable that has no finite value, once in a run."""
        which, value = entry.wrong
        if which < 0 or self._report.says(Subject.NOT_FINITE):
            return
        first, flat = int(self._layout.events.discrete[which]), self._layout.flat
        message = f"{flat.variable_name(first)} has no finite value ({value:g}) at t = {entry.time:g} s"
        self._report.warning("W0537", message, flat.block_at(first).span, subject=Subject.NOT_FINITE)


def told_variables(plan: Plan) -> np.ndarray:
    flat = plan.reduced.flat
    own = [b for b in flat.blocks if b.kind == Kind.DISCRETE and not b.protected and b.quantity != "Real"]
    targets = [r.target for r in flat.events.relations]
    used = np.zeros(flat.count, bool)
    for group in flat.groups:
        columns = sorted({leaf.value[0] for side in (group.left, group.right) for leaf in slots(side)})
        used[group.slots[:, columns]] = True
    every = np.concatenate([*targets, np.zeros(0, int)])
    found = np.concatenate([every[used[every]], *(b.offset + np.arange(b.size) for b in own)]).astype(int)
    return found[np.isin(found, flat.events.discrete)]


def _shown(quantity: str, value: float) -> str:
    if quantity == "Boolean":
        return "true" if value else "false"
    return f"{value + 0.0:g}"  # no negative zero
