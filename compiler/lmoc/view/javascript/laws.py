"""The laws of a scene for a page: where their quantities stand among the registers, and what computes them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from lmoc.ir.law import COMPLEMENTARY, NONE, LawKind, Switched
from lmoc.ir.mode import law_names, law_rows, mode_word
from lmoc.ir.program import Program, needed_steps
from lmoc.numerics.laws.free_dynamics import free_dynamics, limits_of
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.signals.signals import Signal
from lmoc.view.javascript.registers import VariableRegisters
from lmoc.view.javascript.tangent import tangent


def write_laws(
    plan: Plan, signals: Mapping[int, Signal], places: VariableRegisters
) -> tuple[dict[str, Program], dict[str, Any]]:
    """Return the programs of the laws, and what `instant.js` and `switching.js` read."""
    form, flat = plan.reduced.switched, plan.reduced.flat
    assert form is not None
    of, register = places.of_variables, plan.reduced.register_of
    slip, stick = limits_of(form)
    named = {"gap": form.gap, "rate": form.rate, "level": form.level, "slip": slip, "stick": stick}
    found = {name: of(variables) for name, variables in named.items()}
    force, push = register[form.force], register[form.push]
    stored = _single(plan, "ledger.stored")
    motions = [found[name][found[name] >= 0] for name in found]
    wanted = np.concatenate([*motions, force, plan.derivatives, [stored]]).astype(int)
    kinematics = needed_steps(plan.full_program, _own(wanted, plan), plan.count)
    by_force = tangent(kinematics, push, plan.count, places)
    moving = _own(np.concatenate(motions[:2]), plan)
    by_state = tangent(needed_steps(plan.full_program, moving, plan.count), plan.states, plan.count, places)
    judged = np.concatenate([*motions[:2], motions[4], force])
    roots = needed_steps(plan.full_program, _own(judged, plan), plan.count)

    def slopes(of: np.ndarray, registers: np.ndarray) -> list[int]:
        inside = (registers >= 0) & (registers < plan.count)
        return np.where(inside, of[np.where(inside, registers, 0)], -1).tolist()

    scene = free_dynamics(plan, signals)
    kinds = np.array([g.kind.value for g in form.laws for _ in range(g.rows)])
    rows = law_rows(flat, form.laws)
    data: dict[str, Any] = {name: registers.tolist() for name, registers in found.items()}
    data |= {
        "force": force.tolist(),
        "push": push.tolist(),
        "closed": register[form.closed].tolist(),
        "direction": np.where(form.direction == NONE, -1, register[form.direction]).tolist(),
        "degree": form.degree.tolist(),
        "held": plan.held.tolist(),
        "linearRates": scene.linear[1].tolist(),
        "curvedGaps": scene.curved[0].tolist(),
        "curvedRates": scene.curved[1].tolist(),
        "unilateral": (kinds == LawKind.UNILATERAL.value).tolist(),
        "complementary": np.isin(kinds, [k.value for k in COMPLEMENTARY]).tolist(),
        "dry": (kinds == LawKind.DRY_FRICTION.value).tolist(),
        "contact": (kinds == LawKind.CONTACT_FRICTION.value).tolist(),
        "normal": _normal(form),
        "restitution": of(_restitution(form)).tolist(),
        "stateSeeds": by_state.seeds.tolist(),
        "pushSeeds": by_force.seeds.tolist(),
        "gapTangents": slopes(by_state.of, found["gap"]),
        "rateTangents": slopes(by_state.of, found["rate"]),
        "levelTangents": slopes(by_force.of, found["level"]),
        "derivativeTangents": slopes(by_force.of, plan.derivatives),
        "stored": stored,
        "ledger": plan.ledger.tolist(),
        **ledger_states(plan),
        "names": [name for name, _ in rows],
        "labels": law_names(flat, form.laws),
        "closing": [laws.closing for _, laws in rows],
        "opening": [laws.opening for _, laws in rows],
        "closedWords": [mode_word(laws, True) for _, laws in rows],
        "openWords": [mode_word(laws, False) for _, laws in rows],
    }
    programs = {"kinematics": kinematics, "byForce": by_force.program, "byState": by_state.program, "lawRoots": roots}
    return programs, data


def _own(registers: np.ndarray, plan: Plan) -> np.ndarray:
    """Return those that are registers of the plan."""
    return registers[(registers >= 0) & (registers < plan.count)]


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


def _single(plan: Plan, name: str) -> int:
    found = plan.reduced.flat.find(name)
    return -1 if found is None else int(plan.reduced.register_of[int(found[0])])


def _restitution(form: Switched) -> np.ndarray:
    nothing = [np.full(g.rows, NONE) if g.restitution is None else g.restitution for g in form.laws]
    return np.concatenate(nothing)


def _normal(form: Switched) -> list[int]:
    by_force = {int(v): k for k, v in enumerate(form.force)}
    normals = [[NONE] * g.rows if g.normal is None else g.normal.tolist() for g in form.laws]
    return [by_force.get(v, NONE) for group in normals for v in group]
