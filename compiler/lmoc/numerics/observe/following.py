"""Variables while a run goes on, with the solutions of nonlinear equations followed from step to step."""

from __future__ import annotations

import numpy as np

from lmoc.numerics.observe.observer import Observer, sources
from lmoc.numerics.observe.slices import slice_of

_PLACES = 4  # that are kept: the ends of the latest steps, from which places within them are reached


class Following:
    """Values ``(times, states) -> (times, variables)`` at places near the latest ones.

    Parameters
    ----------
    observer : its registers hold the solutions where it begins
    variables : of the flat model
    """

    def __init__(self, observer: Observer, variables: np.ndarray) -> None:
        computed = sources(observer.plan, variables)[2]
        registers = observer.plan.reduced.register_of[variables[computed]]
        own = slice_of(observer.plan, registers)
        part = slice_of(observer.plan, np.concatenate([registers, own.registers[own.unknowns]]))
        self._evaluate = part.bind(observer.base, observer.signals)
        self._given = np.setdiff1d(np.arange(len(variables)), computed)
        self._others = observer.prepare(variables[self._given])
        self._computed, self._unknowns = computed, len(part.unknowns)
        self._places: list[tuple[float, np.ndarray, np.ndarray]] = []  # times, states and solutions, in order

    def __call__(self, times: np.ndarray, states: np.ndarray) -> np.ndarray:
        before = [p for p in self._places if p[0] <= times[0]][-1:] or self._places[:1]
        known = np.full((len(before) + len(times), self._unknowns), np.nan)
        known[: len(before)] = [p[2] for p in before] or known[:0]
        every = np.concatenate([[p[0] for p in before], times])
        found = self._evaluate(every, np.vstack([*(p[1] for p in before), states]), known)[len(before) :]
        self._keep(float(times[-1]), states[-1], found[-1, len(self._computed) :])
        values = np.empty((len(times), len(self._given) + len(self._computed)))
        values[:, self._computed] = found[:, : len(self._computed)]
        values[:, self._given] = self._others(times, states)
        return values

    def _keep(self, t: float, x: np.ndarray, solutions: np.ndarray) -> None:
        onwards = not self._places or t > self._places[-1][0]
        if onwards and np.isfinite(solutions).all():
            self._places = [*self._places[1 - _PLACES :], (t, x.copy(), solutions)]
