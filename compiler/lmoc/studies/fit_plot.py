"""The picture of a fit: data, the fitted curve with its band, and the residuals below."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from lmoc.report.plots import COLOURS, GREY, finished, literal, stacked
from lmoc.studies.measured import Experiment
from lmoc.studies.profile import Profile

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lmoc.run import Run

_WIDTH = 1.96  # standard deviations to either side


class Fitted(Protocol):
    """The part of `lmoc.studies.fit.Fit` that is drawn."""

    values: Mapping[str, float]
    covariance: np.ndarray
    residuals: Sequence[Mapping[str, np.ndarray]]
    runs: Sequence[Run]
    experiments: Sequence[Experiment]
    slopes: Sequence[Mapping[str, np.ndarray]]
    deviations: Mapping[str, float]
    profiles: Mapping[str, Profile]


def plot(fit: Fitted, path: str | Path | None = None) -> Figure:
    """Draw each column of each experiment; the band is that of the curve, from the covariance of the values.

    Raises
    ------
    ModelError
        E0623, E0624: the picture cannot be written.
    """
    shown = [(k, column) for k, experiment in enumerate(fit.experiments) for column in experiment.columns]
    title = ", ".join(f"{name} = {value:.4g}" for name, value in fit.values.items())
    figure, axes = stacked(2 * len(shown), path, title, share=False)
    for (k, column), upper, lower in zip(shown, axes[::2], axes[1::2], strict=True):
        _column(upper, lower, fit, k, column)
    return finished(figure, path)


def plot_profiles(fit: Fitted, path: str | Path | None = None) -> Figure:
    """Draw the profile likelihoods, with where they end, and what the covariance says of them dashed.

    Raises
    ------
    ModelError
        E0623, E0624: the picture cannot be written.
    """
    figure, axes = stacked(len(fit.profiles), path, "profile likelihoods", share=False)
    for own, (name, profile) in zip(axes, fit.profiles.items(), strict=True):
        own.plot(profile.values, profile.distance, "-", color=COLOURS[0])
        spread = fit.deviations[name]
        if np.isfinite(spread) and spread > 0:
            own.plot(profile.values, (profile.values - fit.values[name]) / spread, "--", color=GREY)
        for end in (profile.low, profile.high):
            if np.isfinite(end):
                own.axvline(end, color=COLOURS[1], linewidth=0.8)
        own.set_xlabel(literal(name))
        own.set_ylabel("standard deviations")
    return finished(figure, path)


def _column(upper, lower, fit: Fitted, k: int, column: str) -> None:
    time, values, variable = fit.experiments[k].columns[column]
    curve = fit.runs[k].fine
    slope = fit.slopes[k][column]
    with np.errstate(all="ignore"):
        spread = _WIDTH * np.sqrt(np.einsum("ti,ij,tj->t", slope, fit.covariance, slope))
    fitted = values - fit.residuals[k][column]
    upper.plot(curve.time, curve[variable], color=COLOURS[0], label="fit")
    if np.isfinite(spread).all():
        upper.fill_between(time, fitted - spread, fitted + spread, color=COLOURS[0], alpha=0.25, linewidth=0)
    upper.plot(time, values, ".", color=COLOURS[1], label="data")
    upper.set_ylabel(literal(column))
    upper.legend(loc="best", frameon=False)
    lower.plot(time, fit.residuals[k][column], ".", color=COLOURS[1])
    lower.axhline(0, color=GREY, linewidth=0.8)
    lower.set_ylabel("data − fit")
    lower.set_xlabel("time in s")
