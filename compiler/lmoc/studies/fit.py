"""Fits of parameters and start values to measured data by least squares, and what the data say about them.

Dennis, Schnabel, Numerical Methods for Unconstrained Optimization (1983), ch. 10; Seber, Wild, Nonlinear Regression
(1989), 5.1 (linear confidence intervals).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lmoc.studies.measured import Experiment, refusal
from lmoc.studies.misses import Misses, Simulate, Unknown
from lmoc.studies.profile import Conditional, Place, Profile, profile_of
from lmoc.support.records import dataclass

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lmoc.run import Run

LEVEL = 0.95
_UNDETERMINED = 1e-6  # of the largest singular value of the scaled Jacobian: below it nothing is said about a direction
_SHARE = 0.1  # of a direction's largest weight, from which on a name belongs to it
_FAR = 3.0  # factor within which further starts of an unknown without bounds lie


def unknowns_of(free: Mapping[str, object]) -> tuple[Unknown, ...]:
    """Return the unknowns of ``{"k": 30, "c": (1, 0, 10)}``.

    Raises
    ------
    ModelError
        E0668: nothing is free, a start is no number or not within its bounds.
    """
    found = []
    for name, given in free.items():
        try:
            own = Unknown(
                name, *(float(number) for number in (given if isinstance(given, (tuple, list)) else (given,)))
            )
        except (TypeError, ValueError):
            raise refusal(f"'{name}': expected a start, or (start, low, high); found {given!r}") from None
        if not (np.isfinite(own.start) and own.low <= own.start <= own.high and own.low < own.high):
            raise refusal(f"'{name}': the start {own.start:g} does not lie between {own.low:g} and {own.high:g}")
        found.append(own)
    if not found:
        raise refusal("nothing is free", "free={'k': 30}: names and where to begin")
    return tuple(found)


@dataclass(frozen=True, eq=False)
class Fit:
    """What least squares have found.

    Attributes
    ----------
    values : {name: value}
    covariance : (n, n) of the values, infinite in directions that the data do not determine
    level : of the intervals
    intervals : {name: (low, high)}
    deviations : {name: standard deviation}
    undetermined : combinations of relative changes of the values that leave the data as they are: {name: weight} each
    residuals : {column: (k,) data minus fit} of each experiment
    sigma : {column: standard deviation of the data}, as given or as estimated
    runs : of each experiment, at the times of its data
    experiments : what was measured
    profiles : {name: its profile likelihood}, of those that were asked for
    message : why the search has ended
    evaluations : simulations
    converged : whether it has ended at a minimum
    differences : {name: why its derivatives are differences of runs}; those by the others are tangents of the motion
    """

    values: Mapping[str, float]
    covariance: np.ndarray
    level: float
    intervals: Mapping[str, tuple[float, float]]
    deviations: Mapping[str, float]
    undetermined: tuple[Mapping[str, float], ...]
    residuals: tuple[Mapping[str, np.ndarray], ...]
    sigma: Mapping[str, float]
    runs: tuple[Run, ...]
    experiments: tuple[Experiment, ...]
    slopes: tuple[Mapping[str, np.ndarray], ...]
    message: str
    evaluations: int
    converged: bool
    differences: Mapping[str, str] = field(default_factory=dict)
    profiles: Mapping[str, Profile] = field(default_factory=dict)

    @property
    def run(self) -> Run:
        """The run of the first experiment."""
        return self.runs[0]

    @property
    def identifiable(self) -> bool:
        """Return whether the data determine all values; `undetermined` says what they do not."""
        return not self.undetermined

    @cached_property
    def correlation(self) -> np.ndarray:
        """(n, n) of the values."""
        own = np.sqrt(np.diag(self.covariance))
        with np.errstate(all="ignore"):
            return self.covariance / np.outer(own, own)

    def plot(self, path: str | Path | None = None, kind: str = "data") -> Figure:
        """Draw data, fit and its band, and the residuals; see `lmoc.studies.fit_plot`.

        Parameters
        ----------
        kind : "data", or "profile": the profile likelihoods that were asked for
        """
        from lmoc.studies.fit_plot import plot, plot_profiles

        if kind not in ("data", "profile"):
            raise ValueError(f"kind is 'data' or 'profile', found {kind!r}")
        if kind == "profile" and not self.profiles:
            raise refusal("no profile likelihoods were asked for", "profile=True")
        return plot(self, path) if kind == "data" else plot_profiles(self, path)

    def __str__(self) -> str:
        width = max(map(len, self.values))
        lines = []
        for name, value in self.values.items():
            low, high = self.intervals[name]
            spread = "not determined" if np.isinf(high) else f"± {self.deviations[name]:.2g}   [{low:.6g}, {high:.6g}]"
            lines.append(f"{name:<{width}}  {value:.6g}  {spread}")
        for name, own in self.profiles.items():
            lines.append(f"{name:<{width}}  by its profile likelihood [{own.low:.6g}, {own.high:.6g}]")
            if own.lower:
                lines.append(f"{name:<{width}}  other values fit better: this is not the lowest minimum (starts=5)")
        for direction in self.undetermined:
            terms = ", ".join(f"{name} by {100 * weight:.3g} %" for name, weight in direction.items())
            lines.append(f"the data do not tell apart values that change together: {terms}")
        lines += [f"{column}: standard deviation {value:.3g}" for column, value in self.sigma.items()]
        lines += [f"derivatives by {name} are differences of runs: {why}" for name, why in self.differences.items()]
        return "\n".join([*lines, f"{self.evaluations} runs: {self.message}"])

    def _repr_html_(self) -> str:
        """Return the HTML representation for notebooks."""
        from html import escape

        return f"<pre>{escape(str(self))}</pre>"


def fit(
    simulate: Simulate,
    experiments: tuple[Experiment, ...],
    unknowns: tuple[Unknown, ...],
    sigma: float | Mapping[str, float] | None,
    starts: int,
    seed: int = 0,
    profile: bool | Sequence[str] = False,
) -> Fit:
    """Find the values with which a scene comes nearest to what was measured.

    Parameters
    ----------
    simulate : a run with values of the unknowns, at the times of an experiment, and what differentiates it
    sigma : standard deviation of the data, for all columns or by column; None to estimate it from the residuals: then
        columns count by the range of their values
    starts : how many places the search begins at: the given one, and others drawn within the bounds
    profile : the unknowns whose profile likelihood is wanted; True for all

    Raises
    ------
    ModelError, SimulationError
        There is no run where the search begins; E0668: there are fewer data than unknowns.
    """
    scales = _scales(experiments, sigma)
    misses = Misses(simulate, experiments, unknowns, scales)
    if misses.size < len(unknowns) + (sigma is None):
        also = "" if sigma is not None else " and the deviation of the data"
        raise refusal(f"numbers measured: {misses.size}, too few to determine {', '.join(misses.names)}{also}")
    begin = np.array([u.start for u in unknowns])
    misses.of(misses.runs(begin))  # what is wrong there is told
    named = _profiled(unknowns, profile)
    found = min((_search(misses, x) for x in _places(unknowns, starts, seed)), key=lambda result: result.cost)
    made = _judged(misses, found, scales, sigma is None)
    if not named:
        return made
    freedom = misses.size - len(unknowns)
    variance = 2 * float(found.cost) / freedom if sigma is None else 1.0
    conditional = _conditional(misses, float(found.cost), max(variance, np.finfo(float).tiny))
    limit = _factor(freedom, sigma is None)
    profiles = {
        unknowns[k].name: profile_of(
            k, unknowns[k], found.x, float(np.sqrt(made.covariance[k, k])), limit, conditional
        )
        for k in named
    }
    return replace(made, profiles=profiles, evaluations=misses.count, differences=misses.differences)


def _profiled(unknowns: Sequence[Unknown], profile: bool | Sequence[str]) -> list[int]:
    """Return of which unknowns the profiles are wanted."""
    names = [u.name for u in unknowns]
    wanted = (names if profile else []) if isinstance(profile, bool) else profile
    wanted = [wanted] if isinstance(wanted, str) else list(wanted)
    unknown = [name for name in wanted if name not in names]
    if unknown:
        raise refusal(f"a profile of '{unknown[0]}' was asked for, which is not free", f"one of {', '.join(names)}")
    return [names.index(name) for name in wanted]


def _conditional(misses: Misses, least: float, variance: float) -> Conditional:
    """Return how the sum of squares grows from its least half where one unknown is held, the others at their best."""

    def place(k: int, value: float, guess: np.ndarray) -> Place:
        others = [j for j in range(len(guess)) if j != k]

        def whole(y: np.ndarray) -> np.ndarray:
            x = np.array(guess, float)
            x[k], x[others] = value, y
            return x

        slope = np.eye(len(guess))[k]
        if not others:
            x = whole(np.zeros(0))
            return Place(float(np.sum(misses(x) ** 2) - 2 * least) / variance, x, slope)
        low, high = ([getattr(misses.unknowns[j], end) for j in others] for end in ("low", "high"))
        found = _search(misses, np.clip(guess[others], low, high), others, whole)
        x = whole(found.x)
        slope[others] = np.linalg.lstsq(found.jac, -misses.slopes(x, [k])[:, 0], rcond=None)[0]
        return Place(2 * (float(found.cost) - least) / variance, x, slope)

    return place


def _scales(experiments: Sequence[Experiment], sigma: float | Mapping[str, float] | None) -> dict[str, float]:
    """Return by what the residuals of a column are divided."""
    columns = {column: [] for experiment in experiments for column in experiment.columns}
    for experiment in experiments:
        for column, (_, values, _) in experiment.columns.items():
            columns[column].append(values)
    if sigma is None:
        ranges = {column: float(np.ptp(np.concatenate(own))) or 1.0 for column, own in columns.items()}
        return ranges
    given = sigma if isinstance(sigma, Mapping) else dict.fromkeys(columns, sigma)
    missing = [column for column in columns if column not in given]
    if missing or not all(np.isfinite(given[c]) and given[c] > 0 for c in columns):
        raise refusal(f"sigma is a positive number for each of {', '.join(columns)}; found {sigma!r}")
    return {column: float(given[column]) for column in columns}


def _places(unknowns: Sequence[Unknown], starts: int, seed: int) -> list[np.ndarray]:
    """Return where the search begins."""
    if isinstance(starts, bool) or not isinstance(starts, int) or starts < 1:
        raise refusal(f"starts is a whole number of at least 1, found {starts!r}")
    places = [np.array([u.start for u in unknowns])]
    if starts > 1:
        from scipy.stats import qmc

        shares = qmc.LatinHypercube(len(unknowns), rng=seed).random(starts - 1)
        places += [np.array([_between(u, s) for u, s in zip(unknowns, row, strict=True)]) for row in shares]
    return places


def _between(unknown: Unknown, share: float) -> float:
    low, high, start = unknown.low, unknown.high, unknown.start
    if np.isfinite(low) and np.isfinite(high):
        return float(low + share * (high - low))
    if start == 0:
        return float(np.clip(2 * share - 1, low, high))
    return float(np.clip(start * _FAR ** (2 * share - 1), low, high))


def _search(
    misses: Misses, x: np.ndarray, which: Sequence[int] | None = None,
    whole: Callable[[np.ndarray], np.ndarray] = lambda x: x,
) -> Any:  # fmt: skip
    """Find the least sum of squares over some unknowns, or all.

    Parameters
    ----------
    which, whole : these unknowns, and what makes all values of theirs
    """
    from scipy.optimize import least_squares

    unknowns = misses.unknowns if which is None else [misses.unknowns[k] for k in which]

    def slopes(at: np.ndarray) -> np.ndarray:
        return misses.slopes(whole(at), which)

    bounds = [u.low for u in unknowns], [u.high for u in unknowns]
    exact = {"x_scale": "jac", "xtol": 1e-10, "ftol": 1e-12, "gtol": 1e-12}
    return least_squares(lambda at: misses(whole(at)), x, jac=slopes, bounds=bounds, **exact)


def _factor(freedom: int, estimated: bool) -> float:
    """Return half the width of an interval in standard deviations."""
    from scipy.stats import norm, t

    return float(t.ppf((1 + LEVEL) / 2, freedom) if estimated else norm.ppf((1 + LEVEL) / 2))


def _judged(misses: Misses, found: Any, scales: Mapping[str, float], estimated: bool) -> Fit:
    """Return the fit with what the data say about its values."""
    x, names = found.x, misses.names
    runs = misses.runs(x)
    residuals, jacobian = misses.of(runs), misses.jacobian(x)
    freedom = len(residuals) - len(x)
    variance = float(residuals @ residuals) / freedom if estimated else 1.0
    covariance, undetermined = _covariance(jacobian, x, names, variance)
    lost = _wider_than_bounds(misses.unknowns, covariance, undetermined)
    covariance[lost, lost], undetermined = np.inf, (*undetermined, *({names[k]: 1.0} for k in lost))
    factor = _factor(freedom, estimated)
    spread = np.sqrt(np.diag(covariance))
    own = np.split(residuals, np.cumsum([len(t) for e in misses.experiments for t, _, _ in e.columns.values()])[:-1])
    rows = np.split(jacobian, np.cumsum([len(t) for e in misses.experiments for t, _, _ in e.columns.values()])[:-1])
    pieces, slopes = iter(own), iter(rows)
    missed = tuple({c: -next(pieces) * scales[c] for c in e.columns} for e in misses.experiments)
    leaning = tuple({c: next(slopes) * scales[c] for c in e.columns} for e in misses.experiments)
    return Fit(
        dict(zip(names, x.tolist(), strict=True)),
        covariance,
        LEVEL,
        {n: (float(v - factor * s), float(v + factor * s)) for n, v, s in zip(names, x, spread, strict=True)},
        dict(zip(names, spread.tolist(), strict=True)),
        undetermined,
        missed,
        {c: float(scale * np.sqrt(variance)) for c, scale in scales.items()},
        tuple(runs),
        misses.experiments,
        leaning,
        str(found.message),
        misses.count,
        bool(found.status > 0),
        misses.differences,
    )


def _wider_than_bounds(
    unknowns: Sequence[Unknown], covariance: np.ndarray, undetermined: Sequence[Mapping[str, float]]
) -> list[int]:
    """Return the numbers of values of which the data say less than their bounds, as where a slope is next to zero."""
    told = {name for direction in undetermined for name in direction}
    wide = zip(unknowns, np.sqrt(np.diag(covariance)).tolist(), strict=True)
    return [k for k, (u, spread) in enumerate(wide) if u.name not in told and spread > u.high - u.low]


def _covariance(
    jacobian: np.ndarray, x: np.ndarray, names: Sequence[str], variance: float
) -> tuple[np.ndarray, tuple[dict[str, float], ...]]:
    """Return the covariance of the values, and the directions of relative changes that the residuals do not see."""
    size = np.where(x != 0, np.abs(x), 1.0)
    _, singular, directions = np.linalg.svd(jacobian * size, full_matrices=False)
    seen = singular > _UNDETERMINED * max(singular[0], 1e-300)
    own = directions[seen] / singular[seen, None]
    covariance = variance * np.outer(size, size) * (own.T @ own)
    undetermined = []
    for direction in directions[~seen]:
        largest = np.argmax(np.abs(direction))
        weights = direction / direction[largest]
        undetermined.append({n: float(w) for n, w in zip(names, weights, strict=True) if abs(w) > _SHARE})
        lost = np.abs(weights) > _SHARE
        covariance[lost, lost] = np.inf
    return covariance, tuple(undetermined)
