"""What steps in a scene of a page while the equations hold derivatives of it, such as a prescribed position."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from lmoc.engine.jump import REASONS, reason
from lmoc.ir.program import Program, needed_steps
from lmoc.numerics.events.steps import Steps, moving_relations
from lmoc.numerics.observe.slices import renumber
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.plan.steps import stepping_inputs
from lmoc.numerics.signals.signals import Formula, Signal, Table
from lmoc.support.records import dataclass
from lmoc.view.javascript.registers import RegisterSource


@dataclass(frozen=True, eq=False)
class JumpTables:
    """What the engine reads of steps (``engine/c/page_jumps.c``).

    Attributes
    ----------
    single : register of the stored energy, which state of the ledger is work, how many registers may step
    tables : in the order in which they are read
    """

    single: tuple[int, int, int]
    tables: tuple[np.ndarray, ...]


def write_jumps(
    plan: Plan, signals: Mapping[int, Signal], places: RegisterSource
) -> tuple[dict[str, Program], dict[str, Any] | None, JumpTables | None]:
    """Return the programs of what steps, what `hybrid_dynamics.js` reads, and what the engine does; None where nothing
    steps in a run."""
    steps, inputs = plan.once(Steps), stepping_inputs(plan, signals)
    events = plan.reduced.flat.events
    if not steps or not (inputs or events is not None):
        return {}, None, None
    own, given = steps.program, steps.given
    new = np.concatenate([np.arange(plan.count), places.add(own.count - plan.count)])
    looked = np.append(steps.registers, plan.stored) if steps.stored else steps.registers
    programs: dict[str, Program] = {
        "jumps": needed_steps(plan.full_program, looked.astype(int), plan.count),
        "jumped": tuple(renumber(step, new) for step in own.steps),
    }
    lower, upper, origin, second = steps.tables
    early = np.zeros(0, int) if events is None else moving_relations(plan)
    own_tables = new[own.which], new[own.given], new[own.own], upper, origin, second, plan.ledger
    tables = given, lower, *own_tables, new[own.results], early
    driven = [signals[v] for v in inputs]
    data = {
        "names": [plan.reduced.register_name(int(r)) for r in steps.registers],
        "reasons": [reason(status) for status in range(REASONS)],
        "times": sorted({float(t) for s in driven if isinstance(s, Table) for t in s.jumps}),
        "formulas": any(isinstance(s, Formula) for s in driven),
    }
    stored = plan.stored if steps.stored else -1
    return programs, data, JumpTables((stored, plan.accounts[0], len(steps.registers)), tables)
