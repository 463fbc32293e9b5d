"""Where a scene is linearized: a time of the default run, a run's last point, a given point, or rest.

And in which modes of its laws: those that the run meets.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from numbers import Real
from typing import TYPE_CHECKING

import numpy as np

from lmoc.ir.prepared import Prepared
from lmoc.messages.diagnostics import Area, ModelError, SimulationError
from lmoc.numerics.options.options import RunOptions
from lmoc.run import Run
from lmoc.session import Session, refuse_remembered
from lmoc.simulation import Request, simulate
from lmoc.support import budget

if TYPE_CHECKING:
    from lmoc.symbolic.laws.equations import MetMode
    from lmoc.symbolic.places import Moment, Point

_MET = 50_000  # steps of the run that shows the modes of laws


def place(
    session: Session, at: object, parameters: Point | None, inputs: Point | None = None
) -> tuple[Prepared, Moment | Point | None]:
    """Return the scene as a derivation needs it, and the moment or point at which it is taken (None: at rest).

    A scene with laws is taken in the mode that it has there. `inputs` are constant values of inputs at rest.

    Raises
    ------
    ModelError
        The time lies before the start.
    SimulationError
        The run until that time failed.
    TypeError
        `at` is none of these.
    """
    if isinstance(at, Real):
        at = _run_until(session, float(at), parameters)
    if isinstance(at, Run):
        prepared, moment = _last_point(session, at, parameters)
        return _in_mode(session, prepared, at) if prepared.flat.laws else (prepared, moment)
    if at is not None and not isinstance(at, Mapping):
        expected = "a time, {name: value}, an equilibrium or a run"
        raise TypeError(f"at is {expected}, not {type(at).__name__} {at!r:.40}")
    prepared = session.for_derivation(parameters)
    if at is None:
        refuse_remembered(prepared, "a linear model needs to know what they are")
    return _of_laws(session, prepared, at, inputs or {}) if prepared.flat.laws else (prepared, at)


def _of_laws(
    session: Session, prepared: Prepared, at: Point | None, inputs: Point
) -> tuple[Prepared, Moment | Point]:
    """Return a scene with laws in the mode of a point, and the point; by default that of rest."""
    from lmoc.symbolic.places import number, only, with_inputs
    from lmoc.symbolic.values import read_values

    if at is None:
        at = only(session.equilibria(prepared, inputs))
    laws = getattr(at, "laws", None)
    if laws is not None:
        lawful = session.lawful(prepared)
        mode = lawful.in_mode(laws.closed, laws.direction)
        point = with_inputs(at, inputs) | {s.name: at.member[s.name] for s in at.values}
        if mode.reduced.invariants is not None:  # on the branch of this place, in coordinates that serve there
            there = {name: number(prepared, value, set(point)) for name, value in point.items()}
            mode = replace(mode, reduced=lawful.reduce_at(mode.flat, mode.values, there))
        return mode, {name: value for name, value in point.items() if name in (*mode.reduced.state_names, *mode.inputs)}
    given = {n: number(prepared, v, set()) for n, v in read_values({**at, **inputs}, prepared.flat).items()}
    begin = session.flat.experiment.start or 0.0
    states = {n: v for n, v in given.items() if n not in prepared.inputs}
    loads = {n: given.get(n, 0.0) for n in prepared.inputs}
    run = simulate(session, Request(RunOptions(times=[begin]), None, states, loads))
    mode, moment = _in_mode(session, prepared, run)
    return mode, moment.values


def _in_mode(session: Session, prepared: Prepared, run: Run) -> tuple[Prepared, Moment]:
    """Return the scene in the mode in which a run has ended, and the states that it has there."""
    mode = run.end.mode
    held = session.lawful(prepared).in_mode(mode.closed, np.where(mode.closed, 0, mode.direction))
    return held, _moment(run, held.inputs, held.reduced.state_names)


def modes_met(session: Session, parameters: Point | None) -> list[MetMode] | None:
    """Return the modes of the laws that the default run meets, in their order; None where it cannot start.

    A run that fails on its way counts up to there.
    """
    from lmoc.symbolic.laws.equations import met_modes

    try:
        trajectory = simulate(session, Request(RunOptions(energy=False, max_steps=_MET), parameters)).trajectory
    except SimulationError as failure:
        partial: Run | None = failure.partial
        if partial is None or budget.interrupted():
            raise
        trajectory = partial.trajectory
    except ModelError as error:
        if any(d.area is not Area.RUN for d in error.diagnostics if d.severity == "error"):
            raise
        return None  # there is no value, or no start: nothing is said of the equations
    return met_modes(trajectory)


def _run_until(session: Session, time: float, parameters: Point | None) -> Run:
    """Return the default run until a time."""
    start = session.flat.experiment.start or 0.0
    if time < start:
        from lmoc.symbolic.places import no_place

        raise no_place(f"the run starts at {start:g} s: there is no point at {time:g} s to linearize about")
    return simulate(session, Request(RunOptions(times=sorted({start, time})), parameters))


def _last_point(session: Session, run: Run, parameters: Point | None) -> tuple[Prepared, Moment]:
    """Return the last point of a run, with the values of its parameters and discrete variables."""
    reduced, values = run.reduced, run.trajectory.observer.values
    if parameters:
        prepared = session.for_derivation(parameters)
    elif reduced.lawful is not None:
        flat = reduced.lawful
        prepared = Prepared(flat, reduced, values[: flat.count])
        if flat.events is not None:
            prepared = session.without_events(prepared, run.trajectory.end.values[: flat.count])
    elif reduced.flat.events is not None:
        prepared = session.without_events(Prepared(reduced.flat, reduced, values), run.trajectory.end.values)
    else:
        prepared = Prepared(reduced.flat, reduced, values)
    return prepared, _moment(run, prepared.inputs)


def _moment(run: Run, inputs: Sequence[str], states: Sequence[str] | None = None) -> Moment:
    """Return the last point of a run: its states, or others, and inputs."""
    from lmoc.symbolic.places import Moment

    names = (*(run.reduced.state_names if states is None else states), *inputs)
    return Moment(float(run.time[-1]), {name: float(run[name][-1]) for name in names})
