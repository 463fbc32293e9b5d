"""The savings of reduction: one scene with all its equations, with dummy derivatives, and in minimal coordinates."""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lmoc.ir.prepared import Prepared
from lmoc.messages.diagnostics import Diagnostic, ModelError, Report
from lmoc.numerics.problem.status import NotFound
from lmoc.run import Run
from lmoc.session import Session
from lmoc.simulation import Request, simulate
from lmoc.support.records import dataclass
from lmoc.symbolic.notebook import table_html

_REPEATS = 3


@dataclass(frozen=True)
class Economy:
    """One way to write and to integrate the equations of a scene.

    Attributes
    ----------
    form : "all equations", "dummy derivatives", "reduced"
    solver : the method
    states : variables with a derivative that the solver integrates
    unknowns : all variables of the solver, those without a derivative included
    seconds : s, the shortest of several integrations
    error : the largest deviation from the reference over the output times, relative to each signal's size; NaN where
        the run has failed
    status : why it has failed; empty where it has not
    """

    form: str
    solver: str
    states: int
    unknowns: int
    seconds: float
    error: float
    steps: int
    status: str = ""

    @property
    def row(self) -> tuple[str, ...]:
        """The same as text, for a table."""
        how = self.status or f"{self.error:.1e}"
        return self.form, self.solver, str(self.states), str(self.unknowns), f"{1e3 * self.seconds:.1f} ms", how


class Economies(tuple[Economy, ...]):
    """The cost of a scene in each form."""

    def _repr_html_(self) -> str:
        """Return the HTML representation for notebooks."""
        head = ["form", "solver", "states", "unknowns", "time", "error"]
        return table_html("What reduction saves", head, [one.row for one in self])


def economy(session: Session, request: Request, seconds: float = 20.0) -> Economies:
    """Return what a scene costs in each form, at the tolerance of the request.

    Parameters
    ----------
    seconds : of the processor, after which a form is given up

    Raises
    ------
    ModelError
        E0626: the scene has laws or events; what is wrong with the run.
    SimulationError
        The reduced scene cannot be run.
    """
    _, prepared = session.prepare(request.parameters)
    if prepared.flat.laws or prepared.flat.events is not None:
        message = "scenes with laws or events cannot be run without reduction"
        raise ModelError([Diagnostic("E0626", message, expected="a smooth scene")])
    rtol = request.options.tolerance(prepared.flat.experiment)
    reference = simulate(session, _with(request, max(1e-13, rtol * 1e-2)))
    names = [n for n in reference.outputs or reference.states if prepared.flat.find(n) is not None]
    expected = np.stack([reference[n] for n in names], axis=1)
    comparison = _Comparison(names, reference, expected, rtol, seconds)
    rows = [*_unreduced(prepared, request, comparison)]
    rows += [_reduced(session, _with(request, rtol, solver), comparison) for solver in ("ida", "auto")]
    return Economies(rows)


@dataclass(frozen=True, eq=False)
class _Comparison:
    names: list[str]
    reference: Run
    expected: np.ndarray
    rtol: float
    seconds: float

    def error(self, values: np.ndarray) -> float:
        size = np.abs(self.expected).max(axis=0)
        return float((np.abs(values - self.expected) / np.where(size > 0, size, np.inf)).max(initial=0.0))


def _with(request: Request, rtol: float, solver: str = "auto") -> Request:
    return replace(request, options=replace(request.options, rtol=rtol, solver=solver, energy=False))


def _reduced(session: Session, request: Request, comparison: _Comparison) -> Economy:
    best = np.inf
    for _ in range(_REPEATS):
        began = clock.thread_time()
        run = simulate(session, request)
        best = min(best, clock.thread_time() - began)
    values = np.stack([run[n] for n in comparison.names], axis=1)
    count = len(run.reduced.states)
    solver, steps = str(run.stats["solver"]), int(run.stats.get("steps", 0))
    return Economy("reduced", solver, count, count, best, comparison.error(values), steps)


def _unreduced(prepared: Prepared, request: Request, comparison: _Comparison) -> list[Economy]:
    from lmoc.structure import unreduced

    makers: tuple[tuple[str, Callable], ...] = (
        ("all equations", unreduced.as_written),
        ("dummy derivatives", unreduced.with_dummy_derivatives),
    )
    return [_open(form, make, prepared, request, comparison) for form, make in makers]


def _open(form: str, make: Callable, prepared: Prepared, request: Request, comparison: _Comparison) -> Economy:
    from lmoc.numerics.formulations.unreduced import OpenEquations, integrate
    from lmoc.numerics.signals.signals import bind_signals
    from lmoc.structure.unreduced import SingularSystemError

    flat, reference, report = prepared.flat, comparison.reference, Report()
    try:
        unreduced = make(flat, prepared.values)
    except SingularSystemError as error:
        return Economy(form, "ida", 0, 0, np.nan, np.nan, 0, str(error))
    span = float(reference.time[0]), float(reference.time[-1])
    signals = bind_signals(flat, request.inputs, report, unreduced.reduced.inputs[1:], span)
    report.check()
    equations = OpenEquations(unreduced, signals, prepared.values, report)
    report.check()
    y = equations.consistent(span[0], reference.trajectory.at(0))
    best = np.inf
    for _ in range(_REPEATS):
        began = clock.thread_time()
        try:
            outcome, table = integrate(equations, span[0], y, reference.time, comparison.rtol, comparison.seconds)
        except NotFound:
            return Economy(form, "ida", equations.states, equations.n, np.nan, np.nan, 0, "SUNDIALS was not found")
        best = min(best, clock.thread_time() - began)
        if outcome.status.failed:
            break
    steps, status = outcome.counts.get("steps", 0), ""
    if outcome.status.failed:
        status = f"{outcome.status.value} at t = {outcome.time:.3g} s"
        return Economy(form, "ida", equations.states, equations.n, best, np.nan, steps, status)
    place = {(int(v), int(n)): k for k, (v, n) in enumerate(zip(equations.variable, equations.order, strict=True))}
    columns = [place[int(flat.find(n)[0]), 0] for n in comparison.names]
    return Economy(form, "ida", equations.states, equations.n, best, comparison.error(table[:, columns]), steps)
