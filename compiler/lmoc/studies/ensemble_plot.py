"""Pictures of an ensemble: bands of quantiles over time, histograms, scatter, and what a result depends on."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from lmoc.report.files import PICTURES, check_target
from lmoc.report.plots import COLOURS, GREY, literal, stacked, write

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Runs(Protocol):
    """The part of `lmoc.studies.ensemble.Ensemble` that is drawn."""

    name: str
    time: np.ndarray
    given: Mapping[str, np.ndarray]
    series: Mapping[str, np.ndarray]
    end: Mapping[str, np.ndarray]
    failed: np.ndarray
    units: Mapping[str, str]

    @property
    def kept(self) -> tuple[str, ...]: ...


KINDS = ("bands", "histogram", "scatter", "tornado")
_BANDS = ((0.01, 0.99, 0.18), (0.25, 0.75, 0.4))  # from, to, how dark


def plot(many: Runs, name: str | None = None, path: str | Path | None = None, kind: str = "bands") -> Figure:
    """Draw one variable of all runs that have not failed.

    Raises
    ------
    ModelError
        E0623, E0624: the picture cannot be written.
    ValueError
        An unknown kind, or a variable that is an array.
    """
    if path is not None:
        check_target(Path(path), PICTURES)
    if kind not in KINDS:
        raise ValueError(f"kind is one of {', '.join(KINDS)}; found {kind!r}")
    name = many.kept[0] if name is None else name
    sound = ~many.failed
    end = many.end[name][sound]
    if end.ndim != 1:
        raise ValueError(f"'{name}' is an array: keep its members to draw them")
    given = {key: values[sound] for key, values in many.given.items() if values.ndim == 1}
    if kind == "bands" and not (many.series and len(many.time) > 1):
        kind = "histogram"
    count = len(given) if kind == "scatter" else 1
    figure, axes = stacked(max(count, 1), path, f"{many.name}: {len(end)} runs", share=False)
    label = f"{literal(name)} in {many.units[name]}" if many.units.get(name) else literal(name)
    if kind == "bands":
        _bands(axes[0], many.time, many.series[name][sound], label)
    elif kind == "histogram":
        axes[0].hist(end, bins="auto", color=COLOURS[0], alpha=0.7)
        axes[0].set_xlabel(f"{label} at {many.time[-1]:g} s")
        axes[0].set_ylabel("runs")
    elif kind == "scatter":
        for axis, (key, values) in zip(axes, given.items(), strict=False):
            axis.plot(values, end, ".", color=COLOURS[0], markersize=2, alpha=0.5)
            axis.set_xlabel(literal(key))
            axis.set_ylabel(label)
    else:
        shares = dependence(given, end)
        order = sorted(shares, key=lambda key: abs(shares[key]))
        axes[0].barh([literal(key) for key in order], [shares[key] for key in order], color=COLOURS[0])
        axes[0].axvline(0, color=GREY, linewidth=0.8)
        axes[0].set_xlabel(f"rank correlation with {label} at {many.time[-1]:g} s")
    if path is not None:
        write(figure, Path(path))
    return figure


def _bands(axis, time: np.ndarray, values: np.ndarray, label: str) -> None:
    for low, high, dark in _BANDS:
        below, above = np.quantile(values, [low, high], axis=0)
        own = f"{100 * (high - low):g} % of the runs"
        axis.fill_between(time, below, above, color=COLOURS[0], alpha=dark, linewidth=0, label=own)
    axis.plot(time, np.quantile(values, 0.5, axis=0), color=COLOURS[0], label="median")
    axis.set_xlabel("time in s")
    axis.set_ylabel(label)
    axis.legend(loc="best", frameon=False)


def dependence(given: dict[str, np.ndarray], end: np.ndarray) -> dict[str, float]:
    """Return the rank correlation (Spearman) of a result with each of what was given; 0 where one does not vary."""
    from scipy.stats import rankdata

    def ranks(values: np.ndarray) -> np.ndarray:
        found = rankdata(values)
        return found - found.mean()

    own, found = ranks(end), {}
    for name, values in given.items():
        other = ranks(values)
        size = float(np.sqrt((own @ own) * (other @ other)))
        found[name] = float(own @ other) / size if size > 0 else 0.0
    return found
