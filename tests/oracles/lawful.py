"""Scenes with laws made ready by hand: the switched form, its plan, and what evaluates its laws."""

import numpy as np
from oracles.flattening import flat

from lmoc.messages.diagnostics import Report
from lmoc.numerics.laws.instant import Gauge
from lmoc.numerics.plan import build_plan
from lmoc.numerics.signals.signals import Constant, bind_signals
from lmoc.structure.laws.degree import relative_degree
from lmoc.structure.laws.switched import Switched, free, switched
from lmoc.structure.reduce import reduce


def form_of(text: str) -> tuple[Switched, object]:
    """Return the switched form of a scene and its reduction, with the states of the free scene."""
    dae, report = flat(text), Report()
    loose = free(dae)
    first = reduce(loose.flat, loose.flat.parameter_values(), None, report)
    form = switched(dae, relative_degree(loose, first))
    reduced = reduce(form.flat, form.flat.parameter_values(), first.state_names, report)
    report.check()
    return form, reduced


def gauge_of(text: str) -> Gauge:
    """Return what evaluates the laws of a scene, with its default parameters and signals."""
    form, reduced = form_of(text)
    report, values = Report(), form.flat.parameter_values()
    signals = dict(bind_signals(form.flat, None, report))
    held = np.concatenate([form.closed, form.push, form.direction[form.direction >= 0]])
    signals |= {int(v): Constant(0.0) for v in held}
    plan = build_plan(reduced, signals, True, report)
    report.check()
    return Gauge(form, plan, values, plan.base(values, signals), signals)


def state(gauge: Gauge, **values: float) -> np.ndarray:
    """Return a state vector, by names with ``_`` for dots; the others are zero."""
    names = gauge.plan.reduced.state_names
    x = np.zeros(len(gauge.plan.states))
    for name, value in values.items():
        x[names.index(name.replace("_", "."))] = value
    return x
