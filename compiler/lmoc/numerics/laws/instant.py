"""The laws of a scene at one instant: gaps, rates, the effect of their forces, and their limits."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lmoc.ir.law import COMPLEMENTARY, NONE, LawKind, Switched
from lmoc.numerics.laws.free_dynamics import Interpreted, free_dynamics, quantities_of
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.signals.signals import Signal
from lmoc.structure.laws.switched import POSITION
from lmoc.support.records import dataclass

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
KINDS = tuple(LawKind)


@dataclass(frozen=True, eq=False)
class LawTable:
    """The constants of a run, an entry for each law.

    Attributes
    ----------
    kind : index into KINDS
    degree : 0, 1, 2 or JENKINS (`structure.laws.degree`)
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

    @cached_property
    def acceleration(self) -> Array:
        """(n,) sizes of the levels that the states and the law's own friction make."""
        held = self.delassus.diagonal() * self.stick
        return np.abs(self.bias) + np.where(np.isfinite(held), held, 0.0)


class ContactKinematics:
    """Evaluates the laws' quantities for one run.

    Attributes
    ----------
    errors : (states,) what the integrator allows itself in a step

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
        own = quantities_of(plan, form, form.degree)
        self.registers, self.known = own.registers, own.known(plan, values)
        self.force = plan.reduced.register_of[form.force]
        self.table = _table(form, values)
        self.scene = free_dynamics(plan, signals)
        self.stored = self.scene.has_stored
        self.errors: Array | float = 0.0
        self._present = self.scene.quantities.registers >= 0
        self._evaluate = self.scene.bind(self.scene.base(base, signals), signals)
        self._last: Instant | None = None
        self._forms: Array | None = None

    def stand_at(self, unknowns: NDArray[np.int64], solutions: Array) -> None:
        """Start again from these solutions of nonlinear blocks."""
        self.base[unknowns] = solutions
        self._last = None
        if isinstance(self._evaluate, Interpreted) and self.scene.plan is self.plan:
            self._evaluate.stand_at(unknowns, solutions)

    @property
    def rate_forms(self) -> Array:
        """(n, states) the rates as linear forms in velocities, with coefficients that never change; NaN for others."""
        if self._forms is None:
            self._forms = self._find_rate_forms()
        return self._forms

    def _find_rate_forms(self) -> Array:
        count = len(self.plan.states)
        forms = np.full((self.form.count, count), np.nan)
        linear = self.scene.linear[1]
        if not linear.any():
            return forms
        rest = self._at(0.0, np.zeros(count))
        of_velocities = ~rest.slope[1][:, self.plan.held < 0].any(axis=1)
        own = linear & of_velocities & (rest.rate == 0.0) & (self.table.degree == POSITION)
        forms[own] = rest.slope[1][own]
        return forms

    def at(self, t: float, x: Array) -> Instant:
        """Return the laws' quantities at a time and state."""
        last = self._last
        if last is not None and last.t == t and (last.x == x).all():
            return last
        self._last = self._at(t, x)
        return self._last

    def _at(self, t: float, x: Array) -> Instant:
        found, force, own = self._evaluate(t, x)
        n, present = self.form.count, self._present
        value = self.known.copy()
        value[present] = found[: int(present.sum())]
        gap, rate, bias, slip, stick = value
        slope, scale = np.zeros((2, n, len(x))), np.zeros((2, n))
        slope[present[:2]] = own
        motion = value[:2][present[:2]]
        scale[present[:2]] = np.abs(own) @ np.abs(x) + np.abs(motion - own @ x)
        limits = np.maximum(slip, 0.0), np.maximum(stick, 0.0)
        stored = float(found[-1]) if self.stored else np.nan
        return Instant(t, x, gap, rate, scale[0], scale[1], slope, bias, force[:n], force[n:], *limits, stored)


def _table(form: Switched, values: Array) -> LawTable:
    kind = np.concatenate([np.full(g.rows, KINDS.index(g.kind)) for g in form.laws])
    restitution = [np.zeros(g.rows) if g.restitution is None else values[g.restitution] for g in form.laws]
    by_force = {int(v): k for k, v in enumerate(form.force)}
    normal = [
        np.full(g.rows, NONE) if g.normal is None else np.array([by_force.get(int(v), NONE) for v in g.normal])
        for g in form.laws
    ]
    return LawTable(kind, form.degree, np.concatenate(restitution), np.concatenate(normal))
