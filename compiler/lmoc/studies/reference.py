"""The reference of a chart: the same run by two different methods at tight tolerances, which must agree."""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import replace

from lmoc.messages.diagnostics import ModelError, RunInterrupted, SimulationError
from lmoc.numerics.problem.status import Status
from lmoc.run import Run
from lmoc.studies.deviation import Signals, compared_names, deviation, deviations, signals_of
from lmoc.studies.points import Runner, Setting
from lmoc.support.records import dataclass

# methods of different families, the most accurate first, with tolerances that double precision still allows
_SMOOTH = (("dop853", 1e-13), ("taylor", 1e-13), ("gauss", 1e-13), ("adams", 1e-12), ("radau", 1e-12), ("cvode", 1e-12))
_STIFF = (("gauss", 1e-12), ("cvode", 1e-12), ("radau", 1e-11), ("dop853", 1e-12))
_COARSER = 1.0, 1e3, 1e5  # factors on the tolerances, the next one where no two methods come to the end in time
_AGREED = 1e-9  # below this no third method is asked
_NOISE, _RESOLVED = 0.1, 1e-6  # deviation of a signal that is nothing but rounding, and of those that count
_STIFF_SOLVERS = {"cvode", "ida", "radau"}

_Named = tuple[str, Signals]  # what has made a run, and the run


@dataclass(frozen=True, eq=False, repr=False)
class Probe:
    """A first run of a scene, by `auto` at a tolerance of 1e-6.

    Attributes
    ----------
    names : what runs are compared by
    states : the states
    begin, reached, end : s; it has been given up where it has not reached its end
    seconds : of the processor, that it has taken
    step : s, the mean length of its steps
    stiff : `auto` has found the scene stiff
    """

    names: tuple[str, ...]
    states: tuple[str, ...]
    begin: float
    reached: float
    end: float
    seconds: float
    step: float
    stiff: bool


@dataclass(frozen=True)
class Reference:
    """The run that errors are measured against.

    Attributes
    ----------
    signals : of the better of the two methods
    methods : the two, as text
    uncertainty : their deviation from each other, in the units of the chart's errors; errors below are not resolved
    left_out : signals that are nothing but rounding
    """

    signals: Signals
    methods: tuple[str, str]
    uncertainty: float
    left_out: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """Return what it is and how far it can be trusted."""
        text = f"{self.methods[0]} and {self.methods[1]} agree to {self.uncertainty:.1e}"
        return text if not self.left_out else f"{text}; without {', '.join(self.left_out)}, nothing but rounding"


def probe(runner: Runner, seconds: float) -> Probe:
    """Run a scene once, for `seconds` at the most.

    Raises
    ------
    ModelError
        The scene cannot start.
    SimulationError
        It fails.
    """
    setting = Setting("auto", "reduced", 1e-6)
    runner.warm(setting)
    begin = clock.thread_time()
    try:
        run, spent = runner.run(setting, seconds)
        reached = float(run.time[-1])
    except SimulationError as failure:
        run, spent, reached = failure.partial, clock.thread_time() - begin, failure.time
        if run is None or Status.TOO_LONG.value not in str(failure):
            raise
    span = runner.span
    step = (reached - span.start) / max(1, int(run.stats.get("steps", 1)))
    return Probe(compared_names(run), tuple(run.states), span.start, reached, span.end, spent, step, is_stiff(run))


def is_stiff(run: Run) -> bool:
    """Return whether `auto` has found the scene of a run stiff."""
    return bool(_STIFF_SOLVERS & set(str(run.stats["solver"]).split(", ")))


def first_of(stiff: bool) -> Setting:
    """Return the first method of a reference."""
    solver, rtol = (_STIFF if stiff else _SMOOTH)[0]
    return Setting(solver, "reduced", rtol)


def make_reference(runner: Runner, first: Probe, seconds: float, progress: Callable[[str, float], None]) -> Reference:
    """Return the reference of a scene.

    A signal that is nothing but rounding, such as an output that tells how well something is satisfied, is left out:
    the two methods differ in it by its size, and agree in the others. Where that is all outputs, the states take their
    place.

    Parameters
    ----------
    seconds : that a single run of it may take

    Raises
    ------
    SimulationError
        No two methods come to its end in that time.
    """
    better, other = _agreeing(runner, first, seconds, progress)
    every = deviations(other[1], better[1])
    names = [name for name, apart in every.items() if apart <= _RESOLVED]
    noise = tuple(name for name, apart in every.items() if apart >= _NOISE)
    if not names and noise and first.names != first.states:
        found = make_reference(runner, replace(first, names=first.states), seconds, progress)
        return found if found.uncertainty > _RESOLVED else replace(found, left_out=noise + found.left_out)
    if not (names and noise and len(names) + len(noise) == len(every)):
        names, noise = list(every), ()
    methods, signals = (better[0], other[0]), better[1].only(names)
    return Reference(signals, methods, deviation(signals, other[1].only(names)).largest, noise)


def _agreeing(
    runner: Runner, first: Probe, seconds: float, progress: Callable[[str, float], None]
) -> tuple[_Named, _Named]:
    """Return the two runs that agree best, the one of the more accurate method first."""
    failures: list[str] = []
    for factor in _COARSER:
        found: list[_Named] = []
        for solver, rtol in _STIFF if first.stiff else _SMOOTH:
            setting = Setting(solver, "reduced", rtol * factor)
            progress(f"reference: {setting.text}", 0.0)
            try:
                runner.warm(setting)
                run, _ = runner.run(setting, seconds)
            except RunInterrupted:
                raise
            except (SimulationError, ModelError) as error:
                failures.append(f"{setting.text}: {error}")
                continue
            if run.stats["solver"] != solver:  # another one has taken its place
                continue
            found.append((setting.text, signals_of(run, first.names)))
            if len(found) > 2 or len(found) == 2 and deviation(found[0][1], found[1][1]).largest < _AGREED:
                break
        if len(found) > 1:
            return _closest(found)
    message = "there is no reference to measure errors by, since no two methods come to the end of the run: "
    raise SimulationError(message + "; ".join(failures), first.end, None)


def _closest(found: list[_Named]) -> tuple[_Named, _Named]:
    """Return the two runs that agree best, the one of the more accurate method first."""
    pairs = [(found[i], found[j]) for j in range(len(found)) for i in range(j)]
    return min(pairs, key=lambda pair: deviation(pair[0][1], pair[1][1]).largest)
