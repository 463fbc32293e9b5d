"""Parameter studies: one scene run for several values of its parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from functools import cached_property
from itertools import groupby, product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lmoc.messages.diagnostics import SimulationError
from lmoc.report.compare import Comparison
from lmoc.report.plots import COLOURS, GREY, literal, stacked, write
from lmoc.run import Run
from lmoc.support.records import dataclass
from lmoc.symbolic.notebook import table_html

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

MOST_RUNS = 1000
MOST_ROWS = 40  # of a table in a notebook


@dataclass(frozen=True, eq=False)
class Sweep:
    """Runs of one scene, one for each combination of parameter values.

    Attributes
    ----------
    names : of the parameters that are varied
    points : their values, run by run
    runs : a run that failed on its way is there as far as it came
    eigenvalues_at : eigenvalues of the linear model for parameter values {name: value}
    failed : {the parameter values of a run that failed: why}
    """

    names: tuple[str, ...]
    points: tuple[tuple[float, ...], ...]
    runs: tuple[Run, ...]
    eigenvalues_at: Callable[[Mapping[str, float]], np.ndarray]
    failed: Mapping[tuple[float, ...], str] = field(default_factory=dict)

    @cached_property
    def comparison(self) -> Comparison:
        """The runs under their parameter values: ``k = 10``."""
        return Comparison(dict(zip(map(self._label, self.points), self.runs, strict=True)))

    def _label(self, point: tuple[float, ...]) -> str:
        return ", ".join(f"{name} = {value:g}" for name, value in zip(self.names, point, strict=True))

    def to_dataframe(self, names: str | Sequence[str] | None = None) -> DataFrame:
        """Return a table with a row for each run.

        Columns: the parameters; ``end``, ``min`` and ``max`` of each variable; ``complete``; the error of the energy
        ``balance``.

        Parameters
        ----------
        names : variables; by default those that `plot` shows
        """
        import pandas

        shown = self.comparison.names(names)
        rows = []
        for point, run in zip(self.points, self.runs, strict=True):
            row: dict[str, object] = dict(zip(self.names, point, strict=True))
            for name in shown:
                values = run[name]
                row |= {f"{name} end": values[-1], f"{name} min": values.min(), f"{name} max": values.max()}
            rows.append(row | {"complete": run.complete, "balance": run.energy.balance if run.energy else np.nan})
        return pandas.DataFrame(rows)

    def plot(
        self,
        names: str | Sequence[str] | None = None,
        path: str | Path | None = None,
        units: str | Sequence[str] | None = None,
    ) -> Figure:
        """Draw the runs over each other; parameters and errors as of `Run.plot`."""
        return self.comparison.plot(names, path, units)

    @cached_property
    def eigenvalues(self) -> list[np.ndarray]:
        """Eigenvalues of the linear model about the equilibrium, for each point."""
        return [self.eigenvalues_at(dict(zip(self.names, point, strict=True))) for point in self.points]

    def root_locus(self, path: str | Path | None = None) -> Figure:
        """Draw the eigenvalues of the linear model in the complex plane, from the first point (ring) to the last (dot).

        With several parameters there are curves along the last one for each choice of the others.

        Raises
        ------
        ModelError
            E0623, E0624: the picture cannot be written; the scene has no equilibrium to linearize about.
        """
        roots = self.eigenvalues
        title = f"eigenvalues for {self._label(self.points[0])} to {self._label(self.points[-1])}"
        figure, (axis,) = stacked(1, path, title)
        figure.set_size_inches(6, 5)
        for _, along in groupby(zip(self.points, roots, strict=True), lambda found: found[0][:-1]):
            for branch in branches([own for _, own in along]):
                axis.plot(branch.real, branch.imag, ".-", color=GREY, markersize=3, linewidth=0.7)
        for k, inside in ((0, "none"), (-1, COLOURS[0])):
            style = {"color": COLOURS[0], "markersize": 5, "markerfacecolor": inside}
            axis.plot(roots[k].real, roots[k].imag, "o", **style, label=literal(self._label(self.points[k])))
        axis.legend(loc="best", frameon=False)
        axis.axvline(0, color=GREY, linewidth=0.8)
        axis.set_xlabel("real part in 1/s")
        axis.set_ylabel("imaginary part in rad/s")
        if path is not None:
            write(figure, Path(path))
        return figure

    def _repr_html_(self) -> str:
        """Return the HTML representation for notebooks: the table of the runs."""
        table = self.to_dataframe()
        shown = table.head(MOST_ROWS)
        rows = list(zip(*(shown[name].tolist() for name in table.columns), strict=True))
        return table_html(repr(self).strip("<>"), list(table.columns), rows, len(table) - len(rows))

    def __len__(self) -> int:
        return len(self.runs)

    def __repr__(self) -> str:
        return f"<Sweep of {', '.join(self.names)}: {len(self.runs)} runs>"


def branches(roots: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return eigenvalues as curves: each set is assigned to the one before such that the distances add up to the least.

    A set of another size, where a state comes or goes, begins curves of its own.

    Returns
    -------
    (points,) each, complex
    """
    from scipy.optimize import linear_sum_assignment

    found: list[list[complex]] = []
    growing: list[list[complex]] = []
    for own in roots:
        if len(own) != len(growing):
            growing = [[] for _ in own]
            found += growing
            order = np.arange(len(own))
        else:
            last = np.array([curve[-1] for curve in growing])
            order = linear_sum_assignment(np.abs(last[:, None] - own))[1]
        for curve, value in zip(growing, own[order], strict=True):
            curve.append(complex(value))
    return [np.array(curve) for curve in found]


def sweep(
    values: Mapping[str, Sequence[float]],
    simulate: Callable[[Mapping[str, float]], Run],
    eigenvalues_at: Callable[[Mapping[str, float]], np.ndarray],
    progress: Callable[[int, int], None] | None = None,
) -> Sweep:
    """Run for every combination of values, the last parameter fastest.

    Parameters
    ----------
    values : {parameter: its values}
    simulate : a run for parameter values; what it raises ends the study, but for runs that fail on their way
    progress : called with (runs done, runs in all)

    Raises
    ------
    ValueError
        There is nothing to vary, or there are more than `MOST_RUNS` combinations.
    """
    names = tuple(values)
    points = tuple(product(*(tuple(float(v) for v in np.ravel(values[name])) for name in names)))
    if not names or not points:
        raise ValueError("a sweep needs a parameter with at least one value, such as k=[10, 20, 30]")
    if len(points) > MOST_RUNS:
        raise ValueError(f"a sweep has {MOST_RUNS} runs at most, not {len(points)}")
    runs: list[Run] = []
    failed: dict[tuple[float, ...], str] = {}
    for k, point in enumerate(points):
        try:
            runs.append(simulate(dict(zip(names, point, strict=True))))
        except SimulationError as failure:
            partial: Run | None = failure.partial
            if partial is None or not len(partial.time):
                raise
            runs.append(partial)
            failed[point] = str(failure)
        if progress is not None:
            progress(k + 1, len(points))
    return Sweep(names, points, tuple(runs), eigenvalues_at, failed)
