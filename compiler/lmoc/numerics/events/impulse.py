"""Impulses from derivatives of steps, and what they do to the states.

The derivative of a step Δ is an impulse, Δ·δ(t), and so is that of a kink, of one order more. Equations that are linear
in it make the states jump: of x' = f(x, u, u') those of

    dx/ds = lim f(x, u + s·Δ, Δ/ε)·ε,    0 ≤ s ≤ 1,    ε → 0,

which is what ever steeper ramps tend to (J. J. Moreau, Bounded variation in time, in Topics in Nonsmooth Mechanics,
1988). A step of a prescribed position passes through a damper as the velocity c·Δ/m; the heat in the damper, and the
work of the source, grow beyond all bounds with the steepness. A kink passes through what is rigid, and costs finite
work. What needs two derivatives of a step has no such limit, and what grows with a power of it neither.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from lmoc.ir.law import NONE, LawKind
from lmoc.ir.program import written
from lmoc.ir.reduced import Reduced
from lmoc.numerics.limits import AGREE
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.signals.signals import Signal, sample
from lmoc.numerics.solve.interpreter import Interpreter
from lmoc.support.records import dataclass

_LARGE = 1e6  # impulses per rate, so that the rates themselves are no more than their rounding
_LINEAR = 1e-6  # relative deviation of rates from being linear in an impulse
_FEW, _MANY = 8, 1024  # steps on the way, where what an impulse does depends on the place

Array = NDArray[np.float64]
Values = Mapping[int, float]  # by register


class NoImpulse(Exception):
    """A step has no finite effect; the text says why."""


class PlanValues:
    """All values of a plan with some of them given from outside, and all laws open."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.interpreter = Interpreter(plan.full_program, plan.count)
        self.written = [written(step) for step in plan.full_program]
        form = plan.reduced.switched
        laws = [] if form is None else [form.closed, form.push, form.direction[form.direction != NONE]]
        closing = plan.reduced.register_of[np.concatenate([*laws, np.zeros(0, int)]).astype(int)]
        self.laws = np.concatenate([closing, plan.held[plan.held >= 0]])

    def __call__(self, place: JumpInstant, x: Array, given: Values) -> Array:
        """Return all registers, those given whatever the program says about them."""
        plan, w = self.plan, place.base.copy()
        w[self.laws] = 0.0
        w[plan.states] = x
        for register, (variable, order) in zip(plan.sampled, plan.samplers, strict=True):
            w[register] = sample(place.signals[variable], order, np.array([place.t]))[0]
        registers, values = np.array(list(given), int), np.array(list(given.values()))
        w[registers] = values
        with np.errstate(all="ignore"):
            for step, out in zip(plan.full_program, self.written, strict=True):
                self.interpreter.steps((step,), w, place.t)
                if np.isin(registers, out).any():
                    w[registers] = values
        return w[: plan.count]


@dataclass(frozen=True, eq=False)
class JumpInstant:
    """Where something steps.

    Attributes
    ----------
    t : s
    base : registers that do not change between events, as they are after it
    signals : of the inputs
    """

    t: float
    base: Array
    signals: Mapping[int, Signal]


class Push:
    """The effect of impulses on the rates, at one place.

    Parameters
    ----------
    old, change : {register: value} of what steps
    impulse, double : {register: value} of derivatives: impulses, and derivatives of impulses
    """

    def __init__(
        self, rates: PlanValues, place: JumpInstant, old: Values, change: Values, impulse: Values, double: Values
    ) -> None:
        self.rates, self.place, self.old, self.change = rates, place, old, change
        self.impulse, self.double = impulse, double

    def _at(self, x: Array, s: float, impulses: Values, times: float) -> Array:
        given = {r: v + s * self.change[r] for r, v in self.old.items()}
        for r, v in impulses.items():
            given[r] = given.get(r, 0.0) + times * v
        return self.rates(self.place, x, given)[self.rates.plan.derivatives]

    def __call__(self, x: Array, s: float) -> Array:
        """Return how fast the states change on their way, s from 0 to 1. Raises `NoImpulse`."""
        ledger = self.rates.plan.ledger
        still, one, two = (self._at(x, s, self.impulse, k * _LARGE) for k in (0.0, 1.0, 2.0))
        one, two = (np.where(ledger, 0.0, (f - still) / _LARGE) for f in (one, two))
        size = np.abs(one).max(initial=0.0)
        if not (np.abs(two - 2 * one) <= _LINEAR * size).all():
            raise NoImpulse("what follows from it is not proportional to its velocity (give a ramp of finite length)")
        rounding = np.finfo(float).eps * (size + np.abs(still).max(initial=0.0) / _LARGE)
        return np.where(np.abs(one) <= 10 * rounding, 0.0, one)

    def is_endless(self, x: Array) -> bool:
        """Return whether the ledger grows with a power of the impulses."""
        ledger = self.rates.plan.ledger
        still, one, two = (self._at(x, 0.0, self.impulse, k * _LARGE)[ledger] for k in (0.0, 1.0, 2.0))
        return bool((np.abs(two - 2 * one + still) > _LINEAR * np.abs(one - still)).any())

    def needs_second(self, x: Array) -> bool:
        """Return whether anything but derivatives depends on the derivative of an impulse, such as a force."""
        reduced = self.rates.plan.reduced
        judged = np.zeros(self.rates.plan.count, bool)
        judged[reduced.register_of[reduced.register_of >= 0]] = True
        judged[list({*self.double, *self.impulse})] = False
        judged[_gaps(reduced)] = False  # how fast a gap opens is no motion; what is closed is looked at afterwards
        judged[self.rates.plan.derivatives] = True
        still, pushed = (
            self.rates(self.place, x, {**self.old, **{r: k * v for r, v in self.double.items()}})[judged]
            for k in (0.0, _LARGE)
        )
        return bool((np.abs(pushed - still) > _LINEAR * (1.0 + np.abs(still))).any())


def _gaps(reduced: Reduced) -> Array:
    """Return the registers in which unilateral laws have the accelerations of their gaps."""
    form = reduced.switched
    if form is None:
        return np.zeros(0, int)
    unilateral = np.concatenate([np.full(laws.rows, laws.kind is LawKind.UNILATERAL) for laws in form.laws])
    found = reduced.register_of[form.level[unilateral]]
    return found[found >= 0]


def way(effect: Callable[[Array, float], Array], x: Array) -> Array:
    """Return the change of the states from s = 0 to 1: by the classical Runge-Kutta method where it depends on them."""
    first = effect(x, 0.0)
    last = effect(x + first, 1.0)
    if (np.abs(last - first) <= AGREE * np.abs(first).max(initial=0.0)).all():
        return first
    before, steps = first, _FEW
    while steps <= _MANY:
        at, h = x.copy(), 1.0 / steps
        for k in range(steps):
            a = effect(at, k * h)
            b = effect(at + h / 2 * a, (k + 0.5) * h)
            c = effect(at + h / 2 * b, (k + 0.5) * h)
            at += h / 6 * (a + 2 * b + 2 * c + effect(at + h * c, (k + 1) * h))
        if (np.abs(at - x - before) <= AGREE * np.abs(at - x).max()).all():
            return at - x
        before, steps = at - x, 2 * steps
    raise NoImpulse("its effect cannot be determined: give a ramp of finite length")
