"""The laws of a scene for a page: where their quantities stand among the registers, and what computes them."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from lmoc.ir.law import COMPLEMENTARY, NONE, LawKind, Switched
from lmoc.ir.mode import law_rows, mode_word
from lmoc.ir.program import Program, needed_steps
from lmoc.numerics.laws.open_scene import limits_of
from lmoc.numerics.plan import Plan
from lmoc.view.javascript.tangent import tangent


class Places(Protocol):
    """Gives registers, and those of variables."""

    def add(self, count: int, values: np.ndarray | None = None) -> np.ndarray: ...

    def of_variables(self, variables: np.ndarray) -> np.ndarray: ...


def write_laws(plan: Plan, places: Places) -> tuple[dict[str, Program], dict[str, Any]]:
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
    wanted = np.concatenate([*motions, force, plan.derivatives, np.array([stored] if stored >= 0 else [], int)])
    wanted = wanted[wanted < plan.count]
    gauge = needed_steps(plan.full_program, wanted, plan.count)
    derivatives = tangent(gauge, np.concatenate([plan.states, push]), plan.count, places)
    judged = np.concatenate([*motions[:2], motions[4], force])
    roots = needed_steps(plan.full_program, judged[judged < plan.count], plan.count)

    def slopes(registers: np.ndarray) -> list[int]:
        inside = (registers >= 0) & (registers < plan.count)
        return np.where(inside, derivatives.of[np.where(inside, registers, 0)], -1).tolist()

    kinds = np.array([g.kind.value for g in form.laws for _ in range(g.rows)])
    rows = law_rows(flat, form.laws)
    n = len(plan.states)
    data: dict[str, Any] = {name: registers.tolist() for name, registers in found.items()}
    data |= {
        "force": force.tolist(),
        "push": push.tolist(),
        "closed": register[form.closed].tolist(),
        "direction": np.where(form.direction == NONE, -1, register[form.direction]).tolist(),
        "degree": form.degree.tolist(),
        "unilateral": (kinds == LawKind.UNILATERAL.value).tolist(),
        "complementary": np.isin(kinds, [k.value for k in COMPLEMENTARY]).tolist(),
        "dry": (kinds == LawKind.DRY_FRICTION.value).tolist(),
        "contact": (kinds == LawKind.CONTACT_FRICTION.value).tolist(),
        "normal": _normal(form),
        "restitution": of(_restitution(form)).tolist(),
        "stateSeeds": derivatives.seeds[:n].tolist(),
        "pushSeeds": derivatives.seeds[n:].tolist(),
        "gapTangents": slopes(found["gap"]),
        "rateTangents": slopes(found["rate"]),
        "levelTangents": slopes(found["level"]),
        "derivativeTangents": slopes(plan.derivatives),
        "stored": stored,
        "ledger": plan.ledger.tolist(),
        **ledger_states(plan),
        "names": [name for name, _ in rows],
        "closing": [laws.closing for _, laws in rows],
        "opening": [laws.opening for _, laws in rows],
        "closedWords": [mode_word(laws, True) for _, laws in rows],
        "openWords": [mode_word(laws, False) for _, laws in rows],
    }
    return {"gauge": gauge, "gaugeTangent": derivatives.program, "lawRoots": roots}, data


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
