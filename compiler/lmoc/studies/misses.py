"""By how much a scene misses what was measured, and the derivatives of that by what is looked for.

They are tangents of the motion, integrated behind a run that is there already (`simulate(sensitivities=…)`): these cost
less than two runs for each unknown, and hold more digits than central differences. Where there are none, as where a
motion grazes or a parameter shapes the model, they are such differences.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from lmoc.messages.diagnostics import ModelError, SimulationError
from lmoc.studies.measured import Experiment
from lmoc.support import budget
from lmoc.support.records import dataclass

if TYPE_CHECKING:
    from lmoc.numerics.run.sensitivities import Sensitivities
    from lmoc.run import Run

OF_FITS = 1e-6  # relative tolerance of tangents: the search comes nearer by that factor in each step all the same
_STEP = 1e-4  # relative, of central differences
Differentiate = Callable[[Sequence[str]], "Sensitivities"]  # E0575 where there are none
Simulate = Callable[[Mapping[str, float], Experiment], "tuple[Run, Differentiate]"]


@dataclass(frozen=True)
class Unknown:
    """What is looked for: where to begin, and the bounds."""

    name: str
    start: float
    low: float = -np.inf
    high: float = np.inf


class Misses:
    """The residuals (fit − data)/scale of all experiments, one behind the other, and their derivatives.

    Attributes
    ----------
    count : simulations so far
    differences : {name: why its derivatives are differences of runs}
    refused : why there was no run, the last time that there was none
    """

    def __init__(
        self, simulate: Simulate, experiments: Sequence[Experiment], unknowns: Sequence[Unknown],
        scales: Mapping[str, float],
    ) -> None:  # fmt: skip
        self.simulate, self.experiments, self.unknowns, self.scales = simulate, experiments, unknowns, scales
        self.names = [u.name for u in unknowns]
        self.count = 0
        self.size = sum(len(t) for e in experiments for t, _, _ in e.columns.values())
        self.differences: dict[str, str] = {}
        self.refused: Exception | None = None
        self._at = np.full(len(unknowns), np.nan)  # of the latest runs
        self._made: list[tuple[Run, Differentiate]] = []
        self._leaning: tuple[np.ndarray, tuple[int, ...], np.ndarray] | None = None  # where, by what, and what

    # ------------------------------------------------------------------------ residuals

    def runs(self, x: np.ndarray) -> list[Run]:
        """Return the runs of the experiments with these values."""
        return [run for run, _ in self._there(x)]

    def _there(self, x: np.ndarray) -> list[tuple[Run, Differentiate]]:
        if not np.array_equal(x, self._at):
            self._made, self._at = [self._run(x, experiment) for experiment in self.experiments], np.array(x, float)
        return self._made

    def _run(self, x: np.ndarray, experiment: Experiment) -> tuple[Run, Differentiate]:
        self.count += 1
        budget.moved_on(f"run {self.count}")
        return self.simulate(dict(zip(self.names, x.tolist(), strict=True)), experiment)

    def of(self, runs: Sequence[Run]) -> np.ndarray:
        """Return the residuals of runs."""
        found = []
        for run, experiment in zip(runs, self.experiments, strict=True):
            for column, (_, values, variable) in experiment.columns.items():
                own = run[variable][self._rows(run, experiment, column)]
                found.append((own - values) / self.scales[column])
        return np.concatenate(found)

    def _rows(self, run: Run, experiment: Experiment, column: str) -> np.ndarray:
        return np.searchsorted(run.time, experiment.columns[column][0])

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Return the residuals; large ones where there is no run, so that the search turns back."""
        try:
            found = self.of(self.runs(x))
        except (SimulationError, ModelError) as error:
            self.refused = error
            return np.full(self.size, 1e8)
        return found if np.isfinite(found).all() else np.full(self.size, 1e8)

    # ---------------------------------------------------------------------- derivatives

    def jacobian(self, x: np.ndarray, which: Sequence[int] | None = None) -> np.ndarray:
        """Return the derivatives (m, n) of the residuals by some unknowns, or by all."""
        which = tuple(range(len(x)) if which is None else which)
        if self._leaning is not None and which == self._leaning[1] and np.array_equal(x, self._leaning[0]):
            return self._leaning[2]
        columns = self._tangents(x, [k for k in which if self.names[k] not in self.differences])
        found = np.stack([columns[k] if k in columns else self._difference(x, k) for k in which], axis=1)
        self._leaning = np.array(x, float), which, found
        return found

    def _tangents(self, x: np.ndarray, which: Sequence[int]) -> dict[int, np.ndarray]:
        """Return {unknown: the derivatives (m,)} by tangents; those by which there are none are remembered."""
        if not which:
            return {}
        try:
            found = self._slopes(x, [self.names[k] for k in which])
            return dict(zip(which, found, strict=True))
        except ModelError as error:
            if len(which) > 1:
                return {k: column for one in which for k, column in self._tangents(x, [one]).items()}
            said = error.diagnostics[0].message
            self.differences[self.names[which[0]]] = said.partition(": ")[2] or said
            return {}

    def _slopes(self, x: np.ndarray, names: Sequence[str]) -> np.ndarray:
        """Return the derivatives (names, m) by tangents; E0575 where there are none."""
        found = []
        for (run, differentiate), experiment in zip(self._there(x), self.experiments, strict=True):
            tangents = differentiate(names)
            for column, (_, _, variable) in experiment.columns.items():
                rows = self._rows(run, experiment, column)
                found.append(np.stack([tangents(variable, name)[rows] for name in names]) / self.scales[column])
        return np.concatenate(found, axis=1)

    def _difference(self, x: np.ndarray, k: int) -> np.ndarray:
        """Return the derivatives (m,) by a central difference, one-sided at bounds."""
        unknown = self.unknowns[k]
        step = _STEP * (abs(x[k]) or max(abs(unknown.start), 1e-2))
        low, high = x.copy(), x.copy()
        low[k], high[k] = max(x[k] - step, unknown.low), min(x[k] + step, unknown.high)
        ahead, back = ([self._run(side, experiment)[0] for experiment in self.experiments] for side in (high, low))
        return (self.of(ahead) - self.of(back)) / (high[k] - low[k])

    def slopes(self, x: np.ndarray, which: Sequence[int] | None = None) -> np.ndarray:
        """Return the same as `jacobian`; zero where there is no run."""
        try:
            found = self.jacobian(x, which)
        except (SimulationError, ModelError) as error:
            self.refused = error
            return np.zeros((self.size, len(x) if which is None else len(which)))
        return np.where(np.isfinite(found), found, 0.0)
