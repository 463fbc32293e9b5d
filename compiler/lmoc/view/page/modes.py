"""The swinging modes of a linear scene, as its picture shows them: how each variable that moves it takes part."""

from __future__ import annotations

from typing import Any

import numpy as np

from lmoc.ir.program import Program, needed_steps
from lmoc.numerics.observe.observer import Observer
from lmoc.numerics.solve.interpreter import Interpreter
from lmoc.numerics.solve.jacobian import Jacobian
from lmoc.report.result import Result

MOST_STATES = 60
LINEAR = 1e-9  # share of the largest entry by which the matrix of a linear scene changes from place to place
SWINGS = 1e-6  # share of |λ| above which an eigenvalue is no real number
LOOKS = 5  # places of the run


def modes_data(run: Result, names: list[str]) -> list[dict[str, Any]]:
    """Return the modes by rising frequency: {label, rate, cosine, sine}; none of a scene that is not linear.

    In a mode a variable moves by ``cosine·cos(rate·t) − sine·sin(rate·t)``, up to one factor for all.

    Parameters
    ----------
    names : variables that move the picture
    """
    observer = run.trajectory.observer
    plan, flat = observer.plan, run.flat
    n = plan.state_count
    if run.reduced.switched is not None or flat.events is not None or not 0 < n <= MOST_STATES or not names:
        return []
    variables = np.array([int(flat.find(name)[0]) for name in names])  # type: ignore[index]
    registers = plan.reduced.register_of[variables]
    if any(p.reduced is not run.reduced for p in run.trajectory.segments) or (registers < 0).any():
        return []
    times, states = run.trajectory.segments[0].samples
    outputs = np.concatenate([plan.derivatives[:n], registers])
    program = needed_steps(plan.full_program, outputs, plan.count)
    jacobian = Jacobian(program, plan.states[:n], outputs, plan.count)
    rows = np.linspace(0, len(times) - 1, min(LOOKS, len(times))).astype(int)
    matrices = [_matrix(observer, program, jacobian, (len(outputs), n), times[k], states[k]) for k in rows]
    first = matrices[0]
    size = np.abs(first).max(initial=0.0)
    if not np.isfinite(first).all() or any(not (np.abs(m - first) <= LINEAR * size).all() for m in matrices[1:]):
        return []
    values, vectors = np.linalg.eig(first[:n])
    found = []
    for k in np.argsort(np.abs(values)).tolist():
        rate = abs(values[k])
        if values[k].imag > SWINGS * rate:
            shape = first[n:] @ vectors[:, k]
            largest = np.abs(shape).max(initial=0.0)
            if largest > 0:
                shape = shape / shape[np.abs(shape).argmax()]
                damping = -values[k].real / rate
                label = f"{values[k].imag / (2 * np.pi):.4g} Hz"
                label += f", damping {damping:.3g}" if damping > SWINGS else ""
                parts = {"cosine": shape.real.tolist(), "sine": shape.imag.tolist()}
                found.append({"label": label, "rate": float(values[k].imag), **parts})
    return found


def _matrix(
    observer: Observer, program: Program, jacobian: Jacobian, shape: tuple[int, int], time: float, x: np.ndarray
) -> np.ndarray:
    """Return the derivatives of rates and variables by the states at a place."""
    plan, w = observer.plan, observer.base.copy()
    w[plan.states] = x
    for register, (variable, order) in zip(plan.sampled.tolist(), plan.samplers, strict=True):
        w[register] = observer.signals[variable].value(time, order)
    Interpreter(program, plan.count).run(w, time)
    matrix = np.zeros(shape)
    matrix[jacobian.rows, jacobian.columns] = jacobian.values(w, time)
    return matrix
