"""Functions whose change of sign ends a segment."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from lmoc.engine.step_functions import Watched
from lmoc.support.records import dataclass


@dataclass(eq=False)
class Roots:
    """Functions whose change of sign ends a step.

    Attributes
    ----------
    values : callable (times (k,), states (k, n)) -> (k, m)
    signs : (m,) float, the sign that each has at the beginning: where it is 1 or -1, the other sign is a root, even at
        once; where it is 0, the first sign met counts as the one it has had. Kept up to date on the way
    reached : callable (t, x, which, signs) -> bool
        Called with each root in order, `which` (m,) of them change sign there, to `signs`. True ends the integration
        there, False lets it go on.
    largest : (n,) the magnitude of each state where the functions have been looked at; kept on the way
    quiet : callable (t, x, heights (m,)) -> (m,) bool
        Which functions that have been no higher than so much in a step are zero but for rounding: they have no roots
    soon : s, after which a function that has just left zero is expected back; infinity where none has
    in_c : the same functions for C; None where only Python knows them
    """

    values: Callable[[np.ndarray, np.ndarray], np.ndarray]
    signs: np.ndarray
    reached: Callable[[float, np.ndarray, np.ndarray, np.ndarray], bool] = lambda t, x, which, signs: True
    largest: np.ndarray | None = None
    quiet: Callable[[float, np.ndarray, np.ndarray], np.ndarray] = lambda t, x, heights: np.zeros(len(heights), bool)
    soon: float = np.inf
    in_c: tuple[Watched, ...] | None = None


def joined(found: Sequence[Roots]) -> Roots:
    """Return root functions one behind the other: each of them is told of its own roots."""
    if len(found) == 1:
        return found[0]
    ends = np.cumsum([len(one.signs) for one in found])[:-1]

    def values(times: np.ndarray, states: np.ndarray) -> np.ndarray:
        return np.concatenate([one.values(times, states) for one in found], axis=1)

    def quiet(t: float, x: np.ndarray, heights: np.ndarray) -> np.ndarray:
        parts = zip(found, np.split(heights, ends), strict=True)
        return np.concatenate([one.quiet(t, x, own) for one, own in parts])

    def reached(t: float, x: np.ndarray, which: np.ndarray, signs: np.ndarray) -> bool:
        parts = zip(found, np.split(which, ends), np.split(signs, ends), strict=True)
        return any([one.reached(t, x, own, now) for one, own, now in parts if own.any()])  # each is told

    signs = np.concatenate([one.signs for one in found])
    in_c = None if any(one.in_c is None for one in found) else tuple(w for one in found for w in one.in_c)
    return Roots(values, signs, reached, quiet=quiet, soon=min(one.soon for one in found), in_c=in_c)
