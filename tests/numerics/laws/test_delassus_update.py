"""The free scene with the forces of a mode against the switched form of the equations."""

import numpy as np
import pytest
from oracles.by_numpy import VectorSystem
from oracles.lawful import reduced_of

from lmoc.messages.diagnostics import Report
from lmoc.numerics.laws.delassus_update import DelassusUpdate, updatable
from lmoc.numerics.laws.switching import all_open
from lmoc.numerics.plan.plan import build_plan
from lmoc.numerics.signals.signals import Constant, bind_signals

CHAIN = """model Chain
  parameter Integer N = 12;
  Fixed wall; Mass m[N](each m = 2, each g = 3); Cable s[N - 1](each L = 0.1); Stop b[N - 1](each L = 0);
  DryFriction f[N](each F = 1.5); Force pull(f = 4*sin(time)); Spring k(k = 20); CubicSpring c(k = 5, L = 0);
equation
  connect(pull.flange, m[1].flange); connect(wall.flange, k.a); connect(k.b, m[3].flange);
  connect(wall.flange, c.a); connect(c.b, m[N].flange);
  for i in 1:N loop connect(wall.flange, f[i].a); connect(f[i].b, m[i].flange); end for;
  for i in 1:N-1 loop
    connect(m[i].flange, s[i].a); connect(s[i].b, m[i+1].flange);
    connect(m[i].flange, b[i].a); connect(b[i].b, m[i+1].flange);
  end for;
end Chain;"""
SPINNING = """model Spinning "the matrix of the laws changes with the angle"
  FixedShaft pole; Inertia j(J = 1); Arm arm(l = 1); Mass m(m = 1); Fixed wall; Stop s(L = -2); DryFriction f(F = 1);
equation
  connect(j.shaft, arm.shaft); connect(arm.flange, m.flange); connect(wall.flange, s.a); connect(s.b, m.flange);
  connect(wall.flange, f.a); connect(f.b, m.flange);
end Spinning;"""


def prepared(text):
    """Return the plan of a scene, its signals with all laws open, and parameter values."""
    reduced, report = reduced_of(text), Report()
    signals = {**bind_signals(reduced.flat, None, report), **all_open(reduced.switched)}
    return build_plan(reduced, signals, True, report), signals, reduced.flat.parameter_values()


@pytest.mark.parametrize("seed", range(4))
def test_a_mode_has_the_rates_of_the_switched_form(seed):
    plan, signals, values = prepared(CHAIN)
    form, dice = plan.reduced.switched, np.random.default_rng(seed)
    strings, stops, frictions = np.split(np.arange(form.count), [11, 22])
    closed = np.zeros(form.count, bool)
    link = dice.integers(0, 3, 11)  # a string or its stop, not both: they would depend on each other
    closed[strings], closed[stops] = link == 1, link == 2
    closed[dice.choice(frictions)] = True
    slides = (form.direction >= 0) & ~closed
    direction = np.where(slides, dice.choice([-1.0, 1.0], form.count), 0.0)
    signals |= {int(v): Constant(float(c)) for v, c in zip(form.closed, closed, strict=True)}
    signals |= {int(v): Constant(float(d)) for v, d in zip(form.direction, direction, strict=True) if v >= 0}
    update = updatable(plan, signals)
    assert update is not None
    switched, updated = VectorSystem(plan), DelassusUpdate(plan, update)
    x, found = dice.uniform(-1, 1, len(plan.states)), np.empty((2, len(plan.states)))
    for own, system in zip(found, (switched, updated), strict=True):
        system.prepare(plan.base(values, signals), signals)
        system.rhs(0.7, x, own)
    assert np.isfinite(found).all() and found[1] == pytest.approx(found[0], abs=1e-12 * np.abs(found).max())
    assert updated.jacobian(0.7, x) == pytest.approx(switched.jacobian(0.7, x), abs=1e-9)


def test_a_matrix_that_changes_on_the_way_is_not_inverted_once():
    plan, signals, _ = prepared(SPINNING)
    assert updatable(plan, signals) is None


def test_steps_are_those_of_a_system():
    plan, signals, values = prepared(CHAIN)
    system = DelassusUpdate(plan, updatable(plan, signals))
    system.prepare(plan.base(values, signals), signals)
    x, k = np.linspace(0, 1, len(plan.states)), np.empty(len(plan.states))
    stepper = system.stepper()
    stepper.start(0.3, x, 1e-6, np.full(len(x), 1e-9))
    error, _ = stepper.attempt(0.3, 1e-4)
    system.rhs(0.3, x, k)
    assert error < 1.0 and stepper.stages(0.3, 1e-4)[0] == pytest.approx(k, abs=1e-14)
    assert stepper.x_new == pytest.approx(x + 1e-4 * k, abs=1e-6)
