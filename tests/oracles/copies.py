"""Scenes of many parts that have nothing to do with each other, with a linear block each and with a nonlinear one."""

from __future__ import annotations

import numpy as np

import lmoc
from lmoc.messages.diagnostics import Report
from lmoc.numerics.plan.plan import Plan, build_plan
from lmoc.numerics.signals.signals import bind_signals

PENDULUMS = """model M
  import Planar.*;
  parameter Integer n = 10;
  inner World world;
  Ground ground[n];
  Revolute shoulder[n](phi(each start = 0, each fixed = true), omega(each start = 0, each fixed = true));
  Bar upper[n](l = {1 + 0.1*i for i in 1:n}, each m = 1);
  Revolute elbow[n](phi(each start = 1, each fixed = true), omega(each start = 0, each fixed = true));
  Bar lower[n](each l = 0.7, each m = 0.5);
equation
  for i in 1:n loop
    connect(ground[i].frame, shoulder[i].a);
    connect(shoulder[i].b, upper[i].a);
    connect(upper[i].b, elbow[i].a);
    connect(elbow[i].b, lower[i].a);
  end for;
end M;
"""
PAIRS = """model M
  parameter Integer n = 10;
  Fixed wall;
  CubicSpring inner_[n](k = {1 + 0.5*sin(i) for i in 1:n});
  CubicSpring outer_[n](k = {2 + 0.5*cos(i) for i in 1:n});
  Mass mass[n](each m = 1, q(each start = 1, each fixed = true), v(each start = 0, each fixed = true));
equation
  for i in 1:n loop
    connect(wall.flange, inner_[i].a);
    connect(inner_[i].b, outer_[i].a);
    connect(outer_[i].b, mass[i].flange);
  end for;
end M;
"""


def plan_of(text: str, n: int) -> tuple[Plan, np.ndarray, list[str]]:
    """Plan, registers at the start, and states of n copies."""
    dae = lmoc.compile_text(text, parameters={"n": n})
    report = Report()
    signals = bind_signals(dae.flat, None, report)
    plan = build_plan(dae.reduced, signals, False, report)
    return plan, plan.base(dae.values, signals), dae.states
