"""The reference of a chart: the same run by two different methods at tight tolerances, which must agree."""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import dataclass

from lmoc.messages.diagnostics import ModelError, RunInterrupted, SimulationError
from lmoc.studies.deviation import Signals, compared_names, deviation, signals_of
from lmoc.studies.points import Runner, Setting

# methods of different families, the most accurate first, with tolerances that double precision still allows
_SMOOTH = (("dop853", 1e-13), ("taylor", 1e-13), ("gauss", 1e-13), ("adams", 1e-12), ("radau", 1e-12), ("cvode", 1e-12))
_STIFF = (("gauss", 1e-12), ("radau", 1e-12), ("cvode", 1e-12), ("dop853", 1e-12))
_AGREED = 1e-9  # below this no third method is asked
_PATIENCE = 3.0  # times the seconds allowed, while there are no two
_STIFF_SOLVERS = {"cvode", "ida", "radau"}


@dataclass(frozen=True)
class Reference:
    """What errors are measured against.

    Attributes
    ----------
    signals : of the better of the two methods
    methods : the two, as text
    uncertainty : their deviation from each other, in the units of the chart's errors; errors below are not resolved
    typical_step : s, the mean step of `auto` at a tolerance of 1e-6
    stiff : `auto` has found the scene stiff
    """

    signals: Signals
    methods: tuple[str, str]
    uncertainty: float
    typical_step: float
    stiff: bool

    @property
    def text(self) -> str:
        """Return what it is and how far it can be trusted."""
        return f"{self.methods[0]} and {self.methods[1]} agree to {self.uncertainty:.1e}"


def make_reference(runner: Runner, seconds: float, told: Callable[[str, float], None]) -> Reference:
    """Return the reference of a scene.

    Parameters
    ----------
    seconds : that it may take, about, and a single run of it

    Raises
    ------
    ModelError
        The scene cannot start.
    SimulationError
        No two methods come to its end in that time.
    """
    told("auto at rtol 1e-6", 0.0)
    try:
        first, _ = runner.run(Setting("auto", "reduced", 1e-6), seconds)
    except RunInterrupted:
        raise
    except SimulationError as failure:
        raise _no_reference([f"auto at rtol 1e-6: {failure}"], failure.time) from failure
    names, span = compared_names(first), float(first.time[-1] - first.time[0])
    stiff = bool(_STIFF_SOLVERS & set(str(first.stats["solver"]).split(", ")))
    found: list[tuple[str, Signals]] = []
    failures: list[str] = []
    until = clock.thread_time() + seconds
    for solver, rtol in _STIFF if stiff else _SMOOTH:
        setting = Setting(solver, "reduced", rtol)
        told(setting.text, 0.0)
        if clock.thread_time() > (until if len(found) > 1 else until + _PATIENCE * seconds):
            break
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
        found.append((setting.text, signals_of(run, names)))
        if len(found) > 1 and _closest(found)[2] < _AGREED:
            break
    if len(found) < 2:
        raise _no_reference(failures, float(first.time[-1]))
    better, other, uncertainty = _closest(found)
    step = span / max(1, int(first.stats.get("steps", 1)))
    return Reference(better[1], (better[0], other[0]), uncertainty, step, stiff)


def _closest(found: list[tuple[str, Signals]]) -> tuple[tuple[str, Signals], tuple[str, Signals], float]:
    """Return the two runs that agree best, the one of the more accurate method first, and their deviation."""
    pairs = [(found[i], found[j]) for j in range(len(found)) for i in range(j)]
    apart = [deviation(one[1], two[1]).largest for one, two in pairs]
    best = min(range(len(pairs)), key=apart.__getitem__)
    return *pairs[best], apart[best]


def _no_reference(failures: list[str], time: float) -> SimulationError:
    message = "there is no reference to measure errors by, since no two methods come to the end of the run: "
    return SimulationError(message + "; ".join(failures), time, None)
