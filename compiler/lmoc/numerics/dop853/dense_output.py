"""Dense output of DOP853: values at any time within a step, of order 7.

Hairer, Nørsett, Wanner, Solving Ordinary Differential Equations I (1993), II.6. Steps are gathered and evaluated many
at a time, since a vector operation costs as much for one short step as for a hundred.
"""

from __future__ import annotations

import math

import numpy as np

from lmoc.numerics.dop853 import table
from lmoc.numerics.problem.base import Problem

LAST_WEIGHTS = (4 / 7) ** 4 * (3 / 7) ** 3 * table.D[3]  # the last term of the polynomial where it is largest
_BATCH = 100_000  # numbers gathered before they are evaluated: memory that a run need not ask the system for
_CHUNK = 16_000  # numbers of the result made at once: what they are made from stays in the cache


class DenseOutput:
    """Gathers steps with output times in them, to evaluate many at a time.

    Parameters
    ----------
    n : components
    outputs : output times to come
    """

    def __init__(self, n: int, outputs: int) -> None:
        self._most = max(1, min(_BATCH // max(1, 18 * n), outputs))
        self._n = n
        self._count = 0
        self._times: list[np.ndarray] = []
        self._spans: list[tuple[float, float, int]] = []  # where the steps begin, their lengths, output times in them
        self._x = np.empty((2, self._most, n))  # where the states begin and end
        self._stages = np.empty((self._most, 16, n))

    def add(self, t: float, h: float, x: np.ndarray, x_new: np.ndarray, stages: np.ndarray, times: np.ndarray) -> bool:
        """Take a step from t of length h with output times in it; whether no more can be taken before `values`."""
        k = self._count
        self._spans.append((t, h, len(times)))
        self._x[0, k], self._x[1, k] = x, x_new
        self._stages[k] = stages
        self._times.append(times)
        self._count = k + 1
        return self._count == self._most

    def values(self) -> np.ndarray:
        """Return the states (k, n) at the output times of the steps gathered, and forget these."""
        return self._evaluated() if self._count else np.zeros((0, self._n))

    @np.errstate(all="ignore")
    def _evaluated(self) -> np.ndarray:
        count, self._count = self._count, 0
        times, self._times = np.concatenate(self._times), []
        (begin, step), (x, x_new) = np.array([s[:2] for s in self._spans]).T, self._x[:, :count]
        outputs, self._spans = [s[2] for s in self._spans], []
        terms = dense_terms(step, x, x_new, self._stages[:count])
        owner = np.repeat(np.arange(count), outputs)
        theta = (times - begin[owner]) / step[owner]
        largest = max(1, _CHUNK // max(1, x.shape[1]))
        result = np.empty((len(owner), x.shape[1]))
        for a in range(0, len(owner), largest):
            own = owner[a : a + largest]
            evaluate_dense(theta[a : a + largest], x[own], terms[own], result[a : a + largest])
        return result


def roughness(problem: Problem, x: np.ndarray, h: float, stages: np.ndarray) -> float:
    """Size of the last term of the polynomial in tolerances: it stands for those that the polynomial leaves out."""
    error = LAST_WEIGHTS @ stages / (problem.atol + problem.rtol * np.abs(x))
    return h * math.sqrt(float(error @ error) / len(x))


def dense_terms(h: np.ndarray, x: np.ndarray, x_new: np.ndarray, stages: np.ndarray) -> np.ndarray:
    """Terms of the polynomials (s, 7, n) for s steps of lengths h (s,) from x (s, n) to x_new (s, n).

    Parameters
    ----------
    stages : (s, 16, n) derivatives
    """
    h = h[:, None]
    rise = x_new - x
    terms = np.empty((len(x), 7, x.shape[1]))
    terms[:, 0] = rise
    terms[:, 1] = h * stages[:, 0] - rise
    terms[:, 2] = 2 * rise - h * (stages[:, 12] + stages[:, 0])
    terms[:, 3:] = h[..., None] * (table.D @ stages)
    return terms


def evaluate_dense(theta: np.ndarray, x: np.ndarray, terms: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
    """Dense output at fractions theta (k,) of steps that begin at x (k, n) or (1, n); terms (k, 7, n) or (1, 7, n).

    It is written to `out` (k, n) if there is one.
    """
    theta = theta[:, None]
    rest = 1.0 - theta
    y = np.multiply(terms[:, 6], theta, out)
    for i in range(5, -1, -1):
        y += terms[:, i]
        y *= rest if i % 2 else theta
    y += x
    return y
