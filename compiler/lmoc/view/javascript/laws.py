"""The laws of a scene for a page: where their quantities stand among the registers, and what computes them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from lmoc.ir.flat import Kind
from lmoc.ir.law import NONE
from lmoc.ir.mode import law_names, law_rows, mode_word
from lmoc.ir.program import Program, needed_steps
from lmoc.numerics.laws.free_dynamics import FreeDynamics, free_dynamics, quantities_of
from lmoc.numerics.laws.instant import law_table, restitutions
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.signals.signals import Signal
from lmoc.numerics.solve.jacobian import Jacobian
from lmoc.support.records import dataclass
from lmoc.view.javascript.registers import VariableRegisters


@dataclass(frozen=True, eq=False)
class LawTables:
    """What the engine reads of laws (``engine/c/page_laws.c``).

    Attributes
    ----------
    program : their quantities with all of them open, and the rates of the states
    by_force, by_state : its derivatives; where they stand in the matrices of ``lmoc_free_dynamics``
    single : register of the stored energy, which states of the ledger are work and heat
    tables : in the order in which they are read
    """

    program: Program
    by_force: Jacobian
    by_state: Jacobian
    entries: tuple[np.ndarray, ...]
    single: tuple[int, int, int]
    tables: tuple[np.ndarray, ...]

    @property
    def registers(self) -> tuple[np.ndarray, ...]:
        """Return the tables of what may be parameters: restitution, and the quantities."""
        return self.tables[11], self.tables[12]


def write_laws(
    plan: Plan, values: np.ndarray, signals: Mapping[int, Signal], places: VariableRegisters
) -> tuple[dict[str, Program], dict[str, Any], LawTables]:
    """Return the program of what ends a mode, what `switching.js` reads, and what the engine does."""
    form, flat = plan.reduced.switched, plan.reduced.flat
    assert form is not None
    rows = law_rows(flat, form.laws)
    found = places.of_variables(quantities_of(plan, form, form.degree).variables.ravel()).reshape(6, -1)
    gap, rate, _, _, stick, _ = found
    motion = np.where(gap >= 0, gap, rate)
    read = np.concatenate([motion, rate, plan.reduced.register_of[form.force], stick])
    data: dict[str, Any] = {
        "gap": gap.tolist(),
        "names": [name for name, _ in rows],
        "labels": law_names(flat, form.laws),
        "closing": [laws.closing for _, laws in rows],
        "opening": [laws.opening for _, laws in rows],
        "closedWords": [mode_word(laws, True) for _, laws in rows],
        "openWords": [mode_word(laws, False) for _, laws in rows],
    }
    programs = {"lawRoots": needed_steps(plan.full_program, _own(read, plan), plan.count)}
    return programs, data, _tables(plan, values, signals, places, found, read)


def _tables(
    plan: Plan,
    values: np.ndarray,
    signals: Mapping[int, Signal],
    places: VariableRegisters,
    found: np.ndarray,
    read: np.ndarray,
) -> LawTables:
    form = plan.reduced.switched
    assert form is not None
    own = FreeDynamics(plan, signals, own=False)
    limits = own.quantities.variables[4]
    table, scene, kind = law_table(form, values), free_dynamics(plan, signals), plan.reduced.flat.kind
    return LawTables(
        own.program, own.by_force, own.by_state, own.tables[:2], (own.stored, *plan.accounts),
        (
            table.degree, table.normal, table.unilateral, table.complementary, table.dry, table.contact,
            scene.linear[1], scene.curved, plan.held < 0, plan.ledger,
            (limits != NONE) & (kind[limits] <= Kind.PARAMETER), places.of_variables(restitutions(form)),
            found, read, own.inputs, plan.held,
        ),
    )  # fmt: skip


def _own(registers: np.ndarray, plan: Plan) -> np.ndarray:
    """Return those that are registers of the plan."""
    return registers[(registers >= 0) & (registers < plan.count)].astype(int)
