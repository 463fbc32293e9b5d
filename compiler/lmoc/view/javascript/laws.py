"""The laws of a scene for a page: where their quantities stand among the registers, and what computes them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from lmoc.ir.flat import Kind
from lmoc.ir.law import COMPLEMENTARY, NONE, LawKind, Switched
from lmoc.ir.mode import law_names, law_rows, mode_word
from lmoc.ir.program import Program, needed_steps
from lmoc.numerics.laws.free_dynamics import FreeDynamics, free_dynamics, quantities_of
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
    plan: Plan, signals: Mapping[int, Signal], places: VariableRegisters
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
        "ledger": plan.ledger.tolist(),
        "names": [name for name, _ in rows],
        "labels": law_names(flat, form.laws),
        "closing": [laws.closing for _, laws in rows],
        "opening": [laws.opening for _, laws in rows],
        "closedWords": [mode_word(laws, True) for _, laws in rows],
        "openWords": [mode_word(laws, False) for _, laws in rows],
    }
    programs = {"lawRoots": needed_steps(plan.full_program, _own(read, plan), plan.count)}
    return programs, data, _tables(plan, signals, places, found, read)


def _tables(
    plan: Plan, signals: Mapping[int, Signal], places: VariableRegisters, found: np.ndarray, read: np.ndarray
) -> LawTables:
    form = plan.reduced.switched
    assert form is not None
    own = FreeDynamics(plan, signals, own=False)
    limits = own.quantities.variables[4]
    kinds = np.array([g.kind.value for g in form.laws for _ in range(g.rows)])
    kind = plan.reduced.flat.kind
    scene, ledger = free_dynamics(plan, signals), ledger_states(plan)
    return LawTables(
        own.program, own.by_force, own.by_state, own.tables[:2], (own.stored, ledger["work"], ledger["heat"]),
        (
            form.degree, np.array(_normal(form)), kinds == LawKind.UNILATERAL.value,
            np.isin(kinds, [k.value for k in COMPLEMENTARY]), kinds == LawKind.DRY_FRICTION.value,
            kinds == LawKind.CONTACT_FRICTION.value, scene.linear[1], scene.curved, plan.held < 0, plan.ledger,
            (limits != NONE) & (kind[limits] <= Kind.PARAMETER), places.of_variables(_restitution(form)),
            found, read, own.inputs, plan.held,
        ),
    )  # fmt: skip


def _own(registers: np.ndarray, plan: Plan) -> np.ndarray:
    """Return those that are registers of the plan."""
    return registers[(registers >= 0) & (registers < plan.count)].astype(int)


def ledger_states(plan: Plan) -> dict[str, int]:
    """Return the components of work and heat among the states; -1 where one of them is not integrated."""
    flat, own = plan.reduced.flat, plan.reduced.registers.variable[plan.states]
    found = {}
    for name in ("work", "heat"):
        variable = flat.find(f"ledger.{name}")
        at = np.zeros(0, int) if variable is None else np.flatnonzero((own == int(variable[0])) & plan.ledger)
        found[name] = int(at[0]) if len(at) else -1
    both = min(found.values()) >= 0
    return found if both else dict.fromkeys(found, -1)


def _restitution(form: Switched) -> np.ndarray:
    nothing = [np.full(g.rows, NONE) if g.restitution is None else g.restitution for g in form.laws]
    return np.concatenate(nothing)


def _normal(form: Switched) -> list[int]:
    by_force = {int(v): k for k, v in enumerate(form.force)}
    normals = [[NONE] * g.rows if g.normal is None else g.normal.tolist() for g in form.laws]
    return [by_force.get(v, NONE) for group in normals for v in group]
