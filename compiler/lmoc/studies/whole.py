"""What is recommended by runs of a beginning, tried on the whole run: errors that add up later show there alone."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

from lmoc.messages.diagnostics import ModelError, RunInterrupted, SimulationError
from lmoc.studies.deviation import Signals, deviation, signals_of
from lmoc.studies.points import Point, Runner, point_of
from lmoc.support.records import dataclass

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Whole:
    """Points of the whole run.

    Attributes
    ----------
    tried : those that have come to its end
    uncertainty : deviation of the two most accurate of them from each other; infinity where there are no two
    """

    tried: tuple[Point, ...] = ()
    uncertainty: float = float("inf")


def try_whole(
    runner: Runner, points: Sequence[Point], names: Sequence[str], error: float, longer: float, limit: float, progress
) -> Whole:
    """Run what has an error of a beginning small enough to the end of the scene.

    Parameters
    ----------
    runner : of the whole run
    points : of its beginning
    names : of the signals that are compared
    error : that is small enough; of each method the loosest setting is tried that has it in the end
    longer : times as long as the beginning
    limit : s that a run may take
    """
    trial = _Trial(runner, names, longer, limit, progress)
    good = [p for p in points if p.ok]
    finest = [min(own, key=lambda p: p.error) for own in _by_method(good)]
    for point in sorted(finest, key=lambda p: p.error):
        trial.run(point)
        if len(trial.found) == 2:
            break
    if len(trial.found) < 2:
        return Whole()
    (_, best), (_, other) = trial.found.values()
    uncertainty = deviation(other, best).largest
    tried = []
    for own in _by_method(p for p in good if p.error <= error):
        for point in sorted(own, key=lambda p: p.seconds):
            judged = trial.judged(point, best)
            if judged is None:
                break
            tried.append(judged)
            if judged.error <= error:
                break
    return Whole(tuple(tried), uncertainty)


class _Trial:
    """Runs of the whole scene.

    Attributes
    ----------
    found : by setting, those that have come to the end with their signals
    """

    def __init__(
        self, runner: Runner, names: Sequence[str], longer: float, limit: float, progress: Progress
    ) -> None:
        self.runner, self.names, self.longer, self.limit, self.progress = runner, names, longer, limit, progress
        self.found: dict[object, tuple[Point, Signals]] = {}

    def run(self, point: Point) -> tuple[Point, Signals] | None:
        """Return a point of the whole run without its error, and its signals; None where that takes too long or fails.
        """
        setting = point.setting
        if setting in self.found:
            return self.found[setting]
        if point.seconds * self.longer > self.limit:
            return None
        self.progress(f"the whole run: {setting.text}", 1.0)
        try:
            run, seconds = self.runner.run(setting, self.limit)
        except RunInterrupted:
            raise
        except (SimulationError, ModelError):
            return None
        signals = signals_of(run, self.names)
        self.found[setting] = point_of(setting, run, seconds, signals), signals
        return self.found[setting]

    def judged(self, point: Point, truth: Signals) -> Point | None:
        """Return the same with its deviation from the truth."""
        found = self.run(point)
        if found is None:
            return None
        apart = deviation(found[1], truth)
        return replace(found[0], error=apart.largest, end_error=apart.end)


def _by_method(points: Iterable[Point]) -> list[list[Point]]:
    found: dict[tuple[str, str], list[Point]] = {}
    for point in points:
        found.setdefault((point.setting.solver, point.setting.formulation), []).append(point)
    return list(found.values())
