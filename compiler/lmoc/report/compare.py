"""Several runs beside each other: their curves in one picture, their differences in a table."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lmoc.ir.names import names_of
from lmoc.report.display import display
from lmoc.report.events import mark_events
from lmoc.report.plots import COLOURS, DASHES, choose, finished, group_by_unit, literal, stacked
from lmoc.report.result import Result
from lmoc.support.records import dataclass
from lmoc.symbolic.notebook import table_html
from lmoc.symbolic.styles import unit_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

MOST_ROWS = 40  # of a table in a notebook
MOST_LABELLED = 12  # runs with names of their own; more are coloured by their place in the list


@dataclass(frozen=True, eq=False)
class Comparison:
    """Runs with names.

    Attributes
    ----------
    runs : {name: run}; the first is what the others are compared with
    """

    runs: Mapping[str, Result]

    @property
    def first(self) -> Result:
        return next(iter(self.runs.values()))

    def names(self, names: str | Sequence[str] | None = None) -> list[str]:
        """Return the variables to show: those given, else the defaults of the first run that all runs have.

        Raises
        ------
        ValueError
            Nothing is given, and the runs share none of the defaults.
        """
        if names is not None:
            return [n for given in names_of(names) for n in _members(self.first, given)]
        defaults = choose(self.first)
        shared = [n for n in defaults if all(r.flat.find(n) is not None for r in self.runs.values())]
        if defaults and not shared:
            scenes = ", ".join(dict.fromkeys(r.flat.name for r in self.runs.values()))
            raise ValueError(f"the runs of {scenes} have none of {', '.join(defaults)} in common: give names")
        return shared

    def differences(self, names: str | Sequence[str] | None = None) -> DataFrame:
        """Return the largest differences from the first run, at its output times within both runs.

        Columns: `largest` difference, the `time` of it, `relative` to the largest magnitude in the first run, and
        `missing`: the number of output times of the first run at which there is nothing to compare, since the other run
        does not reach them, or one of the two has no finite value there.
        """
        import pandas

        base, rows = self.first, []
        for label, run in list(self.runs.items())[1:]:
            inside = (run.time[0] <= base.time) & (base.time <= run.time[-1])
            for name in self.names(names):
                rows.append((label, name, *_largest(base.time, base[name], run.time, run[name], inside)))
        table = pandas.DataFrame(rows, columns=["run", "variable", "largest", "time", "relative", "missing"])
        return table.set_index(["run", "variable"])

    def plot(
        self,
        names: str | Sequence[str] | None = None,
        path: str | Path | None = None,
        units: str | Sequence[str] | None = None,
    ) -> Figure:
        """Draw each variable in a panel, the runs over each other; parameters and errors as of `Run.plot`."""
        shown = display(units)
        panels = [(unit, name) for unit, members in group_by_unit(self.first, self.names(names)) for name in members]
        scenes = list(dict.fromkeys(run.flat.name for run in self.runs.values()))
        title = ", ".join(scenes) if len(scenes) > 1 else self.first.flat.description or scenes[0]
        figure, axes = stacked(max(1, len(panels)), path, title)
        colours = _colours(len(self.runs))
        for axis, (unit, name) in zip(axes, panels, strict=False):
            for k, (label, run) in enumerate((literal(name), run) for name, run in self.runs.items()):
                fine = run.fine
                dash = DASHES[k // len(COLOURS) % len(DASHES)] if len(self.runs) <= MOST_LABELLED else "-"
                axis.plot(fine.time, shown.value(fine[name], unit), color=colours[k], linestyle=dash, label=label)
            unit = unit_text(shown.unit(unit))
            axis.set_ylabel(literal(f"{name} in {unit}" if unit else name))
        mark_events(axes[0], self.first.events)
        axes[-1].set_xlabel("time in s")
        if len(self.runs) <= MOST_LABELLED:
            axes[0].legend(loc="center left", bbox_to_anchor=(1.005, 0.5), frameon=False)
        else:
            first, *_, last = self.runs
            axes[0].set_title(f"{len(self.runs)} runs, from {first} (dark) to {last} (bright)", loc="right", fontsize=8)
        return finished(figure, path)

    def _repr_html_(self) -> str:
        """Return the HTML representation for notebooks: the runs, and the largest differences from the first."""
        title = repr(self).strip("<>")
        try:
            names = self.names()
        except ValueError:  # they have nothing in common
            names = []
        found = self.differences(names).reset_index()
        rows = found.head(MOST_ROWS).to_numpy().tolist()
        head = ["run", "variable", "largest difference", "at t in s", "of the largest value", "times not compared"]
        return table_html(title, head, rows, len(found) - len(rows))

    def __repr__(self) -> str:
        return f"<Comparison of {', '.join(list(self.runs)[:MOST_LABELLED])}>"


def compare(runs: Mapping[str, Result] | Iterable[Result]) -> Comparison:
    """Put runs beside each other.

    Parameters
    ----------
    runs : {name: run}, or runs, which are numbered

    Raises
    ------
    ValueError
        There is none.
    TypeError
        Something else than a run is among them.
    """
    named = dict(runs) if isinstance(runs, Mapping) else {f"run {k}": r for k, r in enumerate(runs, 1)}
    if not named:
        raise ValueError("there are no runs to compare")
    for name, run in named.items():
        if not isinstance(run, Result):
            raise TypeError(f"'{name}' is not a run but {type(run).__name__}")
    return Comparison(named)


def _largest(
    times: np.ndarray, truth: np.ndarray, other_times: np.ndarray, other: np.ndarray, inside: np.ndarray
) -> tuple[float, float, float, int]:
    """Return the largest difference, its time, its share of the largest true value, and how many times have none.

    Parameters
    ----------
    inside : (times,) which times both have
    """
    with np.errstate(invalid="ignore"):
        missed = np.abs(np.interp(times, other_times, other) - truth)
    found = inside & np.isfinite(missed)
    missing = len(times) - int(found.sum())
    if not found.any():
        return np.nan, np.nan, np.nan, missing
    k = int(np.argmax(np.where(found, missed, -1.0)))
    top = float(np.abs(truth[found]).max())
    return float(missed[k]), float(times[k]), float(missed[k]) / top if top > 0 else np.nan, missing


def _members(run: Result, name: str) -> list[str]:
    found = run.flat.find(name)
    return [name] if found is None or len(found) == 1 else [run.flat.variable_name(int(v)) for v in found]


def _colours(count: int) -> list:
    if count <= MOST_LABELLED:
        return [COLOURS[k % len(COLOURS)] for k in range(count)]
    from matplotlib import colormaps

    return [colormaps["viridis"](0.95 * k / (count - 1)) for k in range(count)]
