"""The events of a scene for a page: its discrete equations as programs, and the tables of what happens at instants."""

from __future__ import annotations

from typing import Any

import numpy as np

from lmoc.expression.dag import ONE, ZERO, Expr, if_, slot
from lmoc.ir.flat import Kind
from lmoc.ir.program import Apply, Program, needed_steps
from lmoc.numerics.events.event_handler import told_variables
from lmoc.numerics.events.layout import EventLayout
from lmoc.numerics.events.steps import Steps
from lmoc.numerics.observe.observer import Observer
from lmoc.view.javascript.laws import ledger_states
from lmoc.view.javascript.programs import Programs
from lmoc.view.javascript.registers import VariableRegisters


def write_events(observer: Observer, places: VariableRegisters) -> tuple[Programs, dict[str, Any]]:
    """Return the programs of the events, and what `discrete_state.js`, `clock.js` and `event_handler.js` read."""
    return _Events(observer, places).written()


class _Events:
    def __init__(self, observer: Observer, places: VariableRegisters) -> None:
        self.plan, self.places = observer.plan, places
        self.flat = observer.flat
        self.layout: EventLayout = self.plan.once(EventLayout)
        self.events = self.layout.events
        self.absent = int(places.add(1)[0])  # a register without a value
        self.zeros = places.add(self.layout.zero_count)
        self.first = {t.relation: k for k, t in enumerate(self.layout.timed)}

    def of(self, variables: np.ndarray) -> np.ndarray:
        found = self.places.of_variables(np.asarray(variables, int))
        return np.where(found >= 0, found, self.absent)

    def computed(self, shape: Expr, table: np.ndarray) -> tuple[Apply, np.ndarray]:
        """Return a step that computes an expression for all rows of a table of variables, and where it puts it."""
        out = self.places.add(len(table))
        return Apply(shape, self.of(table), out), out

    def written(self) -> tuple[Programs, dict[str, Any]]:
        events, flat, plan = self.events, self.flat, self.plan
        assign, steps = self.discrete_steps()
        timed, timed_data = self.timed()
        reinits, reinit_data = self.reinits()
        judge, endings, checks = self.judged()
        initial, initial_data = self.initial()
        jumps = plan.once(Steps)
        stored = flat.find("ledger.stored")
        stored_register = -1 if stored is None else int(plan.reduced.register_of[stored[0]])
        jumping = [*jumps.registers.tolist(), *([stored_register] if jumps.stored else [])]
        programs: Programs = {
            "look": self.looked(),
            "assign": assign,
            "timed": timed,
            "reinits": reinits,
            "judge": judge,
            "discreteStarts": self.starts(),
            "initialEquations": initial,
            "jumps": needed_steps(plan.full_program, np.array(jumping, int), plan.count),
        }
        before = self.of(events.before)
        data = {
            "discrete": self.of(events.discrete).tolist(),
            "before": before.T.tolist(),
            "held": np.isin(events.before[0], events.discrete).tolist(),
            "zeros": self.zeros.tolist(),
            "zeroTargets": self.of(self.layout.zero_target).tolist(),
            "rounded": self.layout.rounded.tolist(),
            "zeroOps": [self.layout.relation_at(k).op for k in range(self.layout.zero_count)],
            "texts": [self.layout.relation_at(k).text for k in range(self.layout.zero_count)],
            "steps": steps,
            "timed": timed_data,
            "samples": [{k: self.of(getattr(s, k)).tolist() for k in _SAMPLES} for s in events.samples],
            "reinits": reinit_data,
            "whens": self.whens(),
            "terminations": endings,
            "checks": checks,
            "initialEquations": initial_data,
            "initial": self.single(events.initial),
            "terminal": self.single(events.terminal),
            "told": self.told(),
            "looksAtTime": self.layout.looks_at_time,
            "jumps": {
                "registers": jumps.registers.tolist(),
                "moving": jumps.moving.tolist(),
                "stored": [stored_register] if jumps.stored else [],
                "names": [plan.reduced.register_name(int(r)) for r in jumps.registers],
            },
            "stored": stored_register if events.reinits else -1,
            **ledger_states(plan),
        }
        return programs, data

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

    def discrete_steps(self) -> tuple[list[Program], list[dict]]:
        programs: list[Program] = []
        steps: list[dict] = []
        for step in self.plan.reduced.discrete:
            if step.relation < 0:
                steps.append({"run": len(programs)})
                programs.append((Apply(step.value, self.of(step.slots), self.of(step.target)),))
                continue
            rows = self.layout.first[step.relation] + step.rows
            zeros = self.layout.zero_row[rows]
            data = {"op": step.op, "targets": self.of(step.target).tolist(), "rows": np.asarray(step.rows).tolist()}
            timed = step.relation in self.first
            data["zeros"] = None if timed else zeros.tolist()
            data["timed"] = self.first.get(step.relation, -1)
            steps.append(data)
        return programs, steps

    def timed(self) -> tuple[Program, list[dict]]:
        """Return what computes the relations of time alone: slope, offset, and the relation as it is written."""
        program, data = [], []
        for t in self.layout.timed:
            r = self.events.relations[t.relation]
            entry: dict[str, Any] = {"op": r.op}
            for name, shape in (("slope", t.slope), ("offset", t.offset), ("literal", r.zero)):
                step, out = self.computed(shape, r.slots)
                program.append(step)
                entry[name] = out.tolist()
            data.append(entry)
        return tuple(program), data

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
        """Return the equations of discrete variables that hold at the start only, one a row."""
        now = {b: a for a, b in self.events.before.T.tolist()}
        past = {a: b for a, b in self.events.before.T.tolist()}
        programs: list[Program] = []
        data: list[dict] = []
        for e in self.events.start:
            left = e.left.op == "slot" and self.flat.kind[e.slots[0, e.left.value[0]]] == Kind.DISCRETE
            side, value = (e.left, e.right) if left else (e.right, e.left)
            for row in range(e.rows):
                step, out = self.computed(value, e.slots[row : row + 1])
                variable = int(e.slots[row, side.value[0]])
                targets = {variable, now.get(variable, variable), past.get(variable, variable)}
                programs.append((step,))
                data.append({"value": int(out[0]), "targets": [self.single(v) for v in targets]})
        return programs, data

    # ------------------------------------------------------------------ what happens

    def reinits(self) -> tuple[Program, list[dict]]:
        """Return the new values, and for each its guard and which state it is, or where the variable is seen."""
        program, data = [], []
        states = {int(r): k for k, r in enumerate(self.plan.states)}
        register = self.plan.reduced.register_of
        for r in self.events.reinits:
            step, out = self.computed(r.value, r.slots)
            program.append(step)
            for guard, value, variable in zip(self.of(r.guard), out, r.target, strict=True):
                own = int(register[variable])
                name = self.flat.variable_name(int(variable))
                entry = {"guard": int(guard), "value": int(value), "state": states.get(own, -1), "seen": own}
                data.append(entry | {"name": name})
        return tuple(program), data

    def whens(self) -> list[dict]:
        found = []
        for when in self.events.whens:
            name = self.flat.parts[when.part].pattern or self.flat.name
            for row, active in enumerate(self.of(when.active).tolist()):
                text = when.text if len(when.active) == 1 else f"{when.text} [{row + 1}]"
                found.append({"active": active, "name": name, "text": text})
        return found

    def judged(self) -> tuple[Program, list[dict], list[dict]]:
        """Return what computes the conditions of `terminate` and of assertions at events, and their texts."""
        program, endings, checks = [], [], []
        for t in self.events.terminations:
            step, out = self.computed(t.guard, t.slots)
            program.append(step)
            endings.append({"guards": out.tolist(), "message": t.message})
        for check in self.flat.checks:
            if check.at_events:
                step, out = self.computed(if_(check.condition, ONE, ZERO), check.slots)
                program.append(step)
                texts = (self.flat.message_of(check, row) for row in range(len(out)))
                checks += [{"register": int(r), "message": t, "error": check.error} for r, t in zip(out, texts)]
        return tuple(program), endings, checks

    def told(self) -> list[dict]:
        """Return the discrete variables whose changes are recorded."""
        found = []
        for variable in self.plan.once(told_variables).tolist():
            block = self.flat.block_at(variable)
            entry = {"register": self.single(variable), "name": self.flat.variable_name(variable)}
            found.append(entry | {"boolean": block.quantity == "Boolean", "hidden": bool(block.protected)})
        return found


_SAMPLES = ("target", "start", "interval")
