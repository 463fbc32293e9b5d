"""Where a scene is linearized: a time of the default run, a run's last point, a given point, or rest."""

from __future__ import annotations

from collections.abc import Mapping
from numbers import Real
from typing import TYPE_CHECKING

from lmoc.ir.prepared import Prepared
from lmoc.run import Run
from lmoc.session import Session
from lmoc.simulation import Request, simulate

if TYPE_CHECKING:
    from lmoc.symbolic.places import Moment, Point


def place(session: Session, at: object, parameters: Point | None) -> tuple[Prepared, Moment | Point | None]:
    """Return the scene as a derivation needs it, and the moment or point at which it is taken (None: at rest).

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
        return _last_point(session, at, parameters)
    if at is not None and not isinstance(at, Mapping):
        expected = "a time, {name: value}, an equilibrium or a run"
        raise TypeError(f"at is {expected}, not {type(at).__name__} {at!r:.40}")
    return session.for_derivation(parameters), at


def _run_until(session: Session, time: float, parameters: Point | None) -> Run:
    """Return the default run until a time."""
    from lmoc.numerics.options import RunOptions

    start = session.flat.experiment.start or 0.0
    if time < start:
        from lmoc.symbolic.places import no_place

        raise no_place(f"the run starts at {start:g} s: there is no point at {time:g} s to be linear about")
    return simulate(session, Request(RunOptions(times=sorted({start, time})), parameters))


def _last_point(session: Session, run: Run, parameters: Point | None) -> tuple[Prepared, Moment]:
    """Return the last point of a run, with the values of its parameters and discrete variables."""
    from lmoc.symbolic.places import Moment

    reduced, values = run.reduced, run.trajectory.observer.values
    if parameters:
        prepared = session.for_derivation(parameters)
    elif reduced.flat.events is not None:
        prepared = session.without_events(Prepared(reduced.flat, reduced, values), run.trajectory.end.values)
    else:
        prepared = Prepared(reduced.flat, reduced, values)
    names = (*reduced.state_names, *prepared.inputs)
    return prepared, Moment(float(run.time[-1]), {name: float(run[name][-1]) for name in names})
