"""The laws of a scene at one instant: gaps, rates, the effect of their forces, and their limits."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lmoc.ir.flat import Kind
from lmoc.ir.law import COMPLEMENTARY, NONE, LawKind, Switched
from lmoc.ir.program import needed_steps
from lmoc.numerics.evaluate.interpreter import Interpreter
from lmoc.numerics.evaluate.jacobian import Jacobian
from lmoc.numerics.plan import Plan
from lmoc.numerics.signals.signals import Signal, sample
from lmoc.support.records import dataclass

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
KINDS = tuple(LawKind)


@dataclass(frozen=True, eq=False)
class Table:
    """The constants of a run, an entry for each law.

    Attributes
    ----------
    kind : index into KINDS
    degree : 0, 1 or 2 (`structure.laws.degree`)
    restitution : Newton's coefficient, 0 for laws without
    normal : index of the law whose force is the normal force of contact friction, NONE for others
    """

    kind: NDArray[np.int64]
    degree: NDArray[np.int64]
    restitution: Array
    normal: NDArray[np.int64]

    def _of(self, *kinds: LawKind) -> Mask:
        return np.isin(self.kind, [KINDS.index(k) for k in kinds])

    @cached_property
    def unilateral(self) -> Mask:
        return self._of(LawKind.UNILATERAL)

    @cached_property
    def complementary(self) -> Mask:
        return self._of(*COMPLEMENTARY)

    @cached_property
    def dry(self) -> Mask:
        return self._of(LawKind.DRY_FRICTION)

    @cached_property
    def contact(self) -> Mask:
        return self._of(LawKind.CONTACT_FRICTION)

    @cached_property
    def impulsive(self) -> Mask:
        """Complementarities between inertias: only these carry impulses."""
        return self.complementary & (self.degree == 2)


@dataclass(frozen=True, eq=False)
class Instant:
    """Values at a time and state, with all laws open and their forces zero.

    Attributes
    ----------
    t, x : s, (states,)
    gap, rate : (n,) NaN where a law has none
    gap_scale, rate_scale : (n,) sizes of the terms whose sums they are; 0 where there are none
    slope : (2, n, states) derivatives of gaps and rates by the states
    bias : (n,) the level quantities y (`structure.laws.switched`)
    delassus : (n, n) their derivatives by the forces
    response : (states, n) the derivatives of the states' rates by the forces
    slip, stick : (n,) limits of friction, not negative; NaN for complementarities. Those of contact friction are shares
        of the normal force.
    stored : J, NaN without a ledger
    """

    t: float
    x: Array
    gap: Array
    rate: Array
    gap_scale: Array
    rate_scale: Array
    slope: Array
    bias: Array
    delassus: Array
    response: Array
    slip: Array
    stick: Array
    stored: float


class Gauge:
    """Evaluates the laws' quantities for one run.

    Parameters
    ----------
    plan : of the reduction of a switched form
    values : (flat.count,) parameter values
    base : (plan.count,) registers with all laws open and all forces zero
    signals : of the inputs
    """

    def __init__(self, plan: Plan, values: Array, base: Array, signals: Mapping[int, Signal]) -> None:
        form = plan.reduced.switched
        self.form, self.plan, self.values, self.signals = form, plan, values, signals
        self.base = base
        self.limits = _limits(form)
        places = [form.gap, form.rate, form.level, *self.limits]
        self.registers = [np.where(v == NONE, -1, plan.reduced.register_of[v]) for v in places]
        self.known = [_known(plan, values, v) for v in places]
        self.force = plan.reduced.register_of[form.force]
        self.stored = _register(plan, "ledger.stored")
        stored = np.array([self.stored] if self.stored >= 0 else [], int)
        wanted = np.concatenate([*(r[r >= 0] for r in self.registers), self.force, stored, plan.derivatives])
        self.program = needed_steps(plan.full_program, wanted, plan.count)
        self.interpreter = Interpreter(self.program, plan.count)
        self.outputs = np.concatenate([self.registers[2], plan.derivatives])
        column, variable, order = plan.reduced.inputs
        push = column[[int(np.flatnonzero((variable == p) & (order == 0))[0]) for p in form.push]]
        self.by_force = Jacobian(self.program, push, self.outputs, plan.count)
        motions = np.stack(self.registers[:2])
        self.has_motion = motions >= 0
        self.by_state = Jacobian(self.program, plan.states, motions[self.has_motion], plan.count)
        self.table = _table(form, values)

    def stand_at(self, unknowns: NDArray[np.int64], solutions: Array) -> None:
        """Begin anew at these solutions of nonlinear blocks."""
        self.base[unknowns] = solutions
        self.interpreter.reset()

    def filled(self, t: float, x: Array) -> Array:
        """Return all registers that the laws need, at a time and state."""
        w = self.base.copy()
        w[self.plan.states] = x
        for register, (variable, order) in zip(self.plan.sampled, self.plan.samplers, strict=True):
            w[register] = sample(self.signals[variable], order, np.array([t]))[0]
        self.interpreter.run(w, t)
        return w

    def at(self, t: float, x: Array) -> Instant:
        w, n = self.filled(t, x), self.form.count
        gap, rate, bias, slip, stick = (
            np.where(r >= 0, w[r], k) for r, k in zip(self.registers, self.known, strict=True)
        )
        force = _dense(self.by_force, w, t, (len(self.outputs), n))
        slope, scale = np.zeros((2, n, len(x))), np.zeros((2, n))
        own = _dense(self.by_state, w, t, (int(self.has_motion.sum()), len(x)))
        slope[self.has_motion] = own
        value = np.stack([gap, rate])[self.has_motion]
        scale[self.has_motion] = np.abs(own) @ np.abs(x) + np.abs(value - own @ x)
        limits = np.maximum(slip, 0.0), np.maximum(stick, 0.0)
        stored = float(w[self.stored]) if self.stored >= 0 else np.nan
        return Instant(t, x, gap, rate, scale[0], scale[1], slope, bias, force[:n], force[n:], *limits, stored)


def _dense(jacobian: Jacobian, w: Array, t: float, shape: tuple[int, int]) -> Array:
    matrix = np.zeros(shape)
    matrix[jacobian.rows, jacobian.columns] = jacobian.values(w, t)
    return matrix


def _register(plan: Plan, name: str) -> int:
    """Return the register of a variable, -1 where there is none."""
    found = plan.reduced.flat.find(name)
    return -1 if found is None else int(plan.reduced.register_of[int(found[0])])


def _limits(form: Switched) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the variables of the slip and stick limits; of contact friction, its coefficient."""
    slip, stick = [], []
    for laws in form.laws:
        nothing = np.full(laws.rows, NONE)
        dry = laws.kind is LawKind.DRY_FRICTION
        coefficient = nothing if laws.friction is None else laws.friction
        slip.append(laws.slip if dry else coefficient)
        stick.append(laws.stick if dry else coefficient)
    return np.concatenate(slip), np.concatenate(stick)


def _known(plan: Plan, values: Array, variables: NDArray[np.int64]) -> Array:
    """Return the values of those variables that are constants or parameters, NaN for the others."""
    kind = plan.reduced.flat.kind[variables]
    return np.where((variables != NONE) & (kind <= Kind.PARAMETER), values[variables], np.nan)


def _table(form: Switched, values: Array) -> Table:
    kind = np.concatenate([np.full(g.rows, KINDS.index(g.kind)) for g in form.laws])
    restitution = [np.zeros(g.rows) if g.restitution is None else values[g.restitution] for g in form.laws]
    by_force = {int(v): k for k, v in enumerate(form.force)}
    normal = [
        np.full(g.rows, NONE) if g.normal is None else np.array([by_force.get(int(v), NONE) for v in g.normal])
        for g in form.laws
    ]
    return Table(kind, form.degree, np.concatenate(restitution), np.concatenate(normal))
