"""Scenes with laws made ready by hand: the switched form, its plan, and what evaluates its laws."""

import ctypes
from dataclasses import dataclass

import numpy as np
from oracles.flattening import flat

from lmoc.engine.library import library
from lmoc.ir.reduced import Reduced
from lmoc.messages.diagnostics import Report
from lmoc.numerics.laws.complementarity import NO_SOLUTION, Array, checked, numbers
from lmoc.numerics.laws.contradiction import Contradiction
from lmoc.numerics.laws.instant import ContactKinematics, Instant, LawTable, Mask
from lmoc.numerics.laws.switching import LawSwitching
from lmoc.numerics.plan.plan import build_plan
from lmoc.numerics.problem.mode import Mode
from lmoc.numerics.signals.signals import Constant, bind_signals
from lmoc.structure.laws.reduce import reduce_with_laws


def reduced_of(text: str) -> Reduced:
    """Return the reduction of a scene with laws."""
    report = Report()
    reduced = reduce_with_laws(flat(text), report=report)
    report.check()
    return reduced


def laws_of(text: str) -> LawSwitching:
    """Return the laws of a scene, all open, with its default parameters and signals."""
    reduced, report = reduced_of(text), Report()
    form, values = reduced.switched, reduced.flat.parameter_values()
    signals = dict(bind_signals(reduced.flat, None, report))
    held = np.concatenate([form.closed, form.push, form.direction[form.direction >= 0]])
    signals |= {int(v): Constant(0.0) for v in held}
    plan = build_plan(reduced, signals, True, report)
    report.check()
    return LawSwitching(plan, values, plan.base(values, signals), signals)


def state(kinematics: ContactKinematics, **values: float) -> np.ndarray:
    """Return a state vector, by names with ``_`` for dots; the others are zero."""
    names = kinematics.plan.reduced.state_names
    x = np.zeros(len(kinematics.plan.states))
    for name, value in values.items():
        x[names.index(name.replace("_", "."))] = value
    return x


@dataclass(frozen=True)
class Settled:
    """A mode with its forces, the levels that they lead to, and whether they are determined."""

    mode: Mode
    force: Array
    level: Array
    unique: Mask


def settle(
    table: LawTable, now: Instant, mode: Mode, candidate: Mask, sliding: Array, at_limit: Array,
    opening: Mask | None = None,
) -> Settled:  # fmt: skip
    """Return the mode that ``lmoc_settle`` finds (``engine/c/laws.h``)."""
    n = len(candidate)
    levels = [numbers(v) for v in (now.bias, now.delassus, now.slip, now.stick)]
    given = [np.ascontiguousarray(v, bool) for v in (mode.closed, candidate)]
    given += [np.ascontiguousarray(v, np.int64) for v in (sliding, at_limit)]
    others = None if opening is None else np.ascontiguousarray(opening, bool)
    closed, implied, unique, laws = np.zeros((4, n), bool)
    push, force, level = np.zeros((3, n))
    direction = np.zeros(n, np.int64)
    found = closed, implied, unique, laws, direction, push, force, level
    places = [(ctypes.c_void_p * len(a))(*(v.ctypes.data for v in a)) for a in (levels, found)]
    status = library().lmoc_settle(
        ctypes.addressof(table.in_c), ctypes.addressof(places[0]), *(v.ctypes.data for v in given),
        None if others is None else others.ctypes.data, ctypes.addressof(places[1]),
    )  # fmt: skip
    if status == NO_SOLUTION:
        raise Contradiction(np.flatnonzero(laws), "no forces keep them")
    checked(status, force)
    return Settled(Mode(closed, direction, implied, push), force, level, unique)


def free_mode(table: LawTable) -> Mode:
    """Return the mode in which every law is open and no friction slides."""
    n = len(table.kind)
    return Mode(np.zeros(n, bool), np.zeros(n, int), np.zeros(n, bool), np.zeros(n))


def held_velocities(forms: Array) -> Mask:
    """Return which velocities (states,) vanish wherever linear forms (k, states) in them do."""
    forms = numbers(forms)
    held = np.empty(forms.shape[1], bool)
    checked(library().lmoc_held_velocities(*forms.shape, forms.ctypes.data, held.ctypes.data), forms)
    return held
