"""Scenes with laws made ready by hand: the switched form, its plan, and what evaluates its laws."""

import numpy as np
from oracles.flattening import flat

from lmoc.ir.reduced import Reduced
from lmoc.messages.diagnostics import Report
from lmoc.numerics.laws.instant import ContactKinematics
from lmoc.numerics.plan.plan import build_plan
from lmoc.numerics.signals.signals import Constant, bind_signals
from lmoc.structure.laws.reduce import reduce_with_laws


def reduced_of(text: str) -> Reduced:
    """Return the reduction of a scene with laws."""
    report = Report()
    reduced = reduce_with_laws(flat(text), report=report)
    report.check()
    return reduced


def kinematics_of(text: str) -> ContactKinematics:
    """Return what evaluates the laws of a scene, with its default parameters and signals."""
    reduced, report = reduced_of(text), Report()
    form, values = reduced.switched, reduced.flat.parameter_values()
    signals = dict(bind_signals(reduced.flat, None, report))
    held = np.concatenate([form.closed, form.push, form.direction[form.direction >= 0]])
    signals |= {int(v): Constant(0.0) for v in held}
    plan = build_plan(reduced, signals, True, report)
    report.check()
    return ContactKinematics(plan, values, plan.base(values, signals), signals)


def state(kinematics: ContactKinematics, **values: float) -> np.ndarray:
    """Return a state vector, by names with ``_`` for dots; the others are zero."""
    names = kinematics.plan.reduced.state_names
    x = np.zeros(len(kinematics.plan.states))
    for name, value in values.items():
        x[names.index(name.replace("_", "."))] = value
    return x
