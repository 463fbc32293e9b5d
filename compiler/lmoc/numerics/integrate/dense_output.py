"""Dense output of DOP853: values at any time within a step, of order 7.

Hairer, Nørsett, Wanner, Solving Ordinary Differential Equations I (1993), II.6. Steps are gathered and evaluated many
at a time, since a vector operation costs as much for one short step as for a hundred.
"""

from __future__ import annotations

import math
from bisect import bisect_right

import numpy as np

from lmoc.numerics.evaluate.stepper import Stepper
from lmoc.numerics.integrate import dop853_table as table
from lmoc.numerics.integrate.base import Problem

_LAST_WEIGHTS = (4 / 7) ** 4 * (3 / 7) ** 3 * table.D[3]  # the last term of the polynomial where it is largest
_BATCH = 400_000  # numbers gathered before they are evaluated
_CHUNK = 500_000  # numbers of the result made at once


class DenseOutput:
    """Hands the states at the output times of a problem to its sink.

    Attributes
    ----------
    reached : number of output times behind
    next : the first output time ahead, infinity where there is none
    """

    def __init__(self, problem: Problem) -> None:
        n = len(problem.x)
        self.problem = problem
        self.times = problem.times.tolist()
        self.reached, self.next = 1, (*self.times[1:2], math.inf)[0]
        self._first = 1  # the first output time in the steps gathered
        self._most = max(1, min(_BATCH // max(1, 18 * n), len(self.times)))
        self._count = 0
        self._span = np.empty((2, self._most))  # where the steps begin, and their lengths
        self._outputs = np.empty(self._most, int)
        self._x = np.empty((2, self._most, n))  # where the states begin and end
        self._stages = np.empty((self._most, 16, n))

    def add(self, t: float, t_new: float, h: float, stepper: Stepper, stages: np.ndarray) -> None:
        """Take the step just tried, from t to t_new, with output times in it."""
        last = bisect_right(self.times, t_new, self.reached)
        k = self._count
        self._span[:, k] = t, h
        self._x[0, k], self._x[1, k] = stepper.x, stepper.x_new
        self._stages[k] = stages
        self._outputs[k] = last - self.reached
        self._count, self.reached = k + 1, last
        self.next = self.times[last] if last < len(self.times) else math.inf
        if self._count == self._most:
            self.flush()

    @np.errstate(all="ignore")
    def flush(self) -> None:
        """Evaluate what has been gathered and hand it on."""
        count, self._count = self._count, 0
        if not count:
            return
        (begin, step), (x, x_new) = self._span[:, :count], self._x[:, :count]
        terms = dense_terms(step, x, x_new, self._stages[:count])
        owner, first = np.repeat(np.arange(count), self._outputs[:count]), self._first
        theta = (self.problem.times[first : self.reached] - begin[owner]) / step[owner]
        largest = max(1, _CHUNK // max(1, x.shape[1]))
        for a in range(0, len(owner), largest):
            own = owner[a : a + largest]
            self.problem.sink(first + a, evaluate_dense(theta[a : a + largest], x[own], terms[own]))
        self._first = self.reached


def roughness(problem: Problem, x: np.ndarray, h: float, stages: np.ndarray) -> float:
    """Size of the last term of the polynomial in tolerances: it stands for those that the polynomial leaves out."""
    error = _LAST_WEIGHTS @ stages / (problem.atol + problem.rtol * np.abs(x))
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


def evaluate_dense(theta: np.ndarray, x: np.ndarray, terms: np.ndarray) -> np.ndarray:
    """Dense output at fractions theta (k,) of steps that begin at x (k, n); terms (k, 7, n)."""
    theta = theta[:, None]
    rest = 1.0 - theta
    y = terms[:, 6] * theta
    for i in range(5, -1, -1):
        y += terms[:, i]
        y *= rest if i % 2 else theta
    y += x
    return y
