"""The events of a scene for a page: its discrete equations as programs, and the tables of what happens at instants."""

from __future__ import annotations

from typing import Any

import numpy as np

from lmoc.expression.dag import slot
from lmoc.ir.program import Apply, Program, needed_steps
from lmoc.numerics.events.layout import EventLayout
from lmoc.numerics.events.tables import NONE, Condition, Memory, event_tables
from lmoc.numerics.events.telling import told_variables
from lmoc.numerics.observe.observer import Observer
from lmoc.view.javascript.programs import InstantTables, Programs
from lmoc.view.javascript.registers import VariableRegisters


def write_events(observer: Observer, places: VariableRegisters) -> tuple[Programs, dict[str, Any], InstantTables]:
    """Return the programs of the events, what `event_handler.js` reads, and what the engine does."""
    return _Events(observer, places).written()


class _Registers(Memory):
    """The registers of a page as the memory of the discrete equations."""

    def __init__(self, source: VariableRegisters) -> None:
        self._source = source
        self._absent = int(source.add(1)[0])  # has no value

    def new(self, count: int) -> np.ndarray:
        return self._source.add(count)

    def places(self, variables: np.ndarray) -> np.ndarray:
        found = self._source.of_variables(np.asarray(variables, int))
        return np.where(found >= 0, found, self._absent)


class _Events:
    def __init__(self, observer: Observer, places: VariableRegisters) -> None:
        self.plan, self.places, self.flat = observer.plan, places, observer.flat
        self.memory = _Registers(places)
        self.of = self.memory.places
        self.layout: EventLayout = self.plan.once(EventLayout)
        self.events = self.layout.events
        self.zeros = places.add(self.layout.zero_count)

    def written(self) -> tuple[Programs, dict[str, Any], InstantTables]:
        events, plan = self.events, self.plan
        conditions, news = self.told_conditions()
        tables = event_tables(self.layout, self.memory, conditions)
        initial, initial_data = self.initial()
        programs: Programs = {
            "look": self.looked(),
            "assign": tables.assign,
            "lines": tables.lines,
            "discreteStarts": self.starts(),
            "initialEquations": initial,
        }
        data = {
            "discrete": self.of(events.discrete).tolist(),
            "texts": [self.layout.relation_at(k).text for k in range(self.layout.zero_count)],
            "news": news,
            "initialEquations": initial_data,
            "told": self.told(),
            "looksAtTime": self.layout.looks_at_time,
        }
        stored = plan.stored if events.reinits else -1, *plan.accounts
        single = self.single(events.initial), self.single(events.terminal), *stored
        seen = np.concatenate([NONE, *(plan.reduced.register_of[r.target] for r in events.reinits)])
        return programs, data, InstantTables(self.zeros, seen, single, tables.columns)

    def single(self, variable: int) -> int:
        return -1 if variable < 0 else int(self.of(np.array([variable]))[0])

    # ------------------------------------------------------------------ equations

    def looked(self) -> Program:
        """Return what fills the zero functions, and the continuous variables that the discrete equations read."""
        layout, plan = self.layout, self.plan
        steps = []
        for k, r in enumerate(self.events.relations):
            rows = layout.zero_row[layout.first[k] : layout.first[k + 1]]
            if len(rows) and rows[0] >= 0:
                steps.append(Apply(r.zero, self.of(r.slots), self.zeros[rows]))
        seen = plan.reduced.register_of[layout.seen]
        read = np.concatenate([seen, *(s.slots.ravel() for s in steps)]).astype(int)
        return (*needed_steps(plan.full_program, read[(read >= 0) & (read < plan.count)], plan.count), *steps)

    def starts(self) -> Program:
        """Return what fills the discrete variables at the start."""
        steps = []
        for a in self.flat.starts:
            own = np.isin(a.target, self.events.discrete)
            if own.any() and a.numbers is None:
                steps.append(Apply(a.shape, self.of(a.slots[own]), self.of(a.target[own])))
            elif own.any():
                given = self.places.add(int(own.sum()), a.numbers[own])
                steps.append(Apply(slot(0), given[:, None], self.of(a.target[own])))
        return tuple(steps)

    def initial(self) -> tuple[list[Program], list[dict]]:
        """Return the equations of discrete variables that hold at the start only, and what has the same values."""
        programs: list[Program] = []
        data: list[dict] = []
        for one in self.layout.started:
            programs.append((Apply(one.step.value, self.of(one.step.slots), self.of(one.step.target)),))
            data.append({"waits": one.waits, "same": self.of(np.stack([one.past, one.same], axis=1)).tolist()})
        return programs, data

    # ------------------------------------------------------------------ what happens

    def told_conditions(self) -> tuple[list[Condition], list[dict]]:
        """Return the conditions of which something is told at events, and that, row by row."""
        events, flat = self.events, self.flat
        conditions: list[Condition] = []
        news: list[dict] = []
        for when in events.whens:
            conditions.append(Condition(slot(0), when.active[:, None], 1))
            name = flat.parts[when.part].pattern or flat.name
            rows = range(1, len(when.active) + 1)
            texts = [when.text] if len(when.active) == 1 else [f"{when.text} [{row}]" for row in rows]
            news += [{"when": True, "name": name, "text": text} for text in texts]
        for t in events.terminations:
            conditions.append(Condition(t.guard, t.slots, 1))
            news += [{"ends": True, "message": t.message}] * len(t.slots)
        for check in flat.checks:
            if check.at_events:
                conditions.append(Condition(check.condition, check.slots, 0))
                texts = [flat.message_of(check, row) for row in range(len(check.slots))]
                news += [{"error": check.error, "message": text} for text in texts]
        return conditions, news

    def told(self) -> list[dict]:
        """Return the discrete variables whose changes are recorded."""
        found = []
        for variable in self.plan.once(told_variables).tolist():
            block = self.flat.block_at(variable)
            entry = {"register": self.single(variable), "name": self.flat.variable_name(variable)}
            found.append(entry | {"boolean": block.quantity == "Boolean", "hidden": bool(block.protected)})
        return found

