"""Leaving coordinates that have become bad: for better ones, by shorter steps, or with the end of the run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from lmoc.messages.diagnostics import Report
from lmoc.numerics.coordinates.change import carried_over, registers_at
from lmoc.numerics.evaluate.system import System
from lmoc.numerics.integrate.base import Outcome
from lmoc.numerics.observe.observer import Observer
from lmoc.numerics.plan import Plan
from lmoc.numerics.start.singular import StartSingular
from lmoc.numerics.task import Stretch, Task

_STALLED = 40  # attempts to come on from one place
_SHORTEST = 1e-10  # of the run: a step as short is no way past a place where coordinates do not serve


@dataclass(frozen=True, eq=False)
class Way:
    """How a run goes on.

    Attributes
    ----------
    stretch : the piece under way, or a new one
    x : (n,) its state
    longest : s, the longest step
    """

    stretch: Stretch
    x: np.ndarray
    longest: float


class Changes:
    """The choices of coordinates that one run has tried.

    Attributes
    ----------
    reason : why it cannot go on
    """

    def __init__(self, task: Task, variables: np.ndarray | None) -> None:
        self.task, self.variables, self.reason = task, variables, ""
        self.longest = np.inf if task.options.max_step is None else task.options.max_step
        self._tried: set[tuple[float, tuple[str, ...]]] = set()  # coordinates, and since when
        self._refused: set[int] = set()  # flat variables that cannot be states
        self._stalled, self._stalled_at = 0, -np.inf  # how often it has not come on, and from where

    def bar(self, stretch: Stretch) -> None:
        """Tell a piece which variables cannot be states."""
        stretch.watch.bar(self._refused)

    def onward(self, stretch: Stretch, outcome: Outcome) -> Way | None:
        """Return how to go on from where an integration has ended; None where no coordinates serve."""
        watch, t = stretch.watch, outcome.time
        self._stalled = self._stalled + 1 if t == self._stalled_at else 0
        self._stalled_at = t
        if self._stalled > _STALLED:
            self._nowhere(stretch)
            return None
        changed = self._changed(stretch, outcome)
        if changed is not None:
            return changed
        if not watch.passed_a_singular_place:
            watch.tolerate()
            return Way(stretch, outcome.x, self.longest)
        if watch.bifurcation:
            self._nowhere(stretch)
            return None
        distance = (watch.at - t) / 4  # the way up to it is gone in shorter steps
        if distance > _SHORTEST * max(abs(t), self.task.span.end - self.task.span.start):
            return Way(stretch, outcome.x, min(distance, self.longest))
        self._nowhere(stretch)
        return None

    def _changed(self, stretch: Stretch, outcome: Outcome) -> Way | None:
        """A new piece with better coordinates; None where there are no better ones."""
        for variables, names in self._candidates(stretch):
            key = outcome.time, tuple(sorted(names))
            if key in self._tried:  # it has begun here with them already
                continue
            self._tried.add(key)
            others, energy = self.task.others, self.task.options.energy
            made = None if others is None else others.system(names, stretch.observer.signals, energy)
            way = None if made is None else self._begun(stretch, outcome, *made)
            if way is not None:
                return way
            own = stretch.plan.reduced.constraints
            self._refused |= variables - set(own.variable[own.rows :].tolist())
        return None

    def _candidates(self, stretch: Stretch) -> Iterator[tuple[set[int], list[str]]]:
        reduced = stretch.plan.reduced
        self.bar(stretch)
        for columns in stretch.watch.better():
            variables = reduced.constraints.variable[columns].tolist()
            yield set(variables), [reduced.flat.variable_name(v) for v in variables]

    def _begun(self, stretch: Stretch, outcome: Outcome, plan: Plan, system: System) -> Way | None:
        """A piece with another system; None where its states are not known at the place."""
        task, old = self.task, stretch.observer
        w = registers_at(old, stretch.system, outcome.time, outcome.x)
        base = plan.base(task.values, old.signals)
        x = carried_over(old, w, plan, base)
        if not np.isfinite(x).all():
            return None
        observer = Observer(plan, task.values, base, old.signals)
        system.prepare(base, old.signals)
        piece = Stretch(observer, system, outcome.time, task.span.times, stretch.reached, self.variables)
        return Way(piece, x, self.longest)

    def _nowhere(self, stretch: Stretch) -> None:
        """Keep the reason why no coordinates serve from here on."""
        reduced, watch = stretch.plan.reduced, stretch.watch
        names, lost = ", ".join(reduced.state_names), reduced.flat.variable_name(watch.lost())
        if watch.bifurcation:
            self.reason = (
                "a singular position follows, in which the constraints depend on each other: several branches of the "
                f"motion meet there, and no coordinates determine {lost}"
            )
        else:
            self.reason = (
                f"the coordinates {names} do not determine {lost} shortly after; choose some that determine the rest "
                "all the way, by states=[…] (--states) or stateSelect"
            )


def singular_start(stretch: Stretch, report: Report) -> StartSingular:
    """Return the error where the coordinates do not serve at the start."""
    reduced, variable = stretch.plan.reduced, stretch.watch.lost()
    names, span = ", ".join(reduced.state_names), reduced.flat.declared_at(variable)
    message = f"the coordinates {names} do not determine {reduced.flat.variable_name(variable)} at the start"
    report.error("E0535", message, span, hint="choose others, by states=[…] (--states) or stateSelect")
    return StartSingular(report.diagnostics, reduced.state_names, span)
