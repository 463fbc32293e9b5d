"""Solutions of nonlinear blocks along a run, kept for the next variable that is read of it."""

from __future__ import annotations

import numpy as np

_MOST = 5_000_000  # numbers that are kept of one segment


class Solutions:
    """The solutions at the places that were asked for last, by the registers of their unknowns."""

    def __init__(self) -> None:
        self._place: tuple[np.ndarray, np.ndarray] | None = None
        self._columns: dict[int, np.ndarray] = {}

    def fill(
        self, times: np.ndarray, states: np.ndarray, registers: np.ndarray, guesses: np.ndarray
    ) -> np.ndarray:
        """Write the known solutions into guesses (times, registers); the mask of the registers that have them.

        Parameters
        ----------
        times, states : the very arrays with which the solutions were handed over
        """
        if not self._is_at(times, states):
            return np.zeros(len(registers), bool)
        known = np.array([r in self._columns for r in registers.tolist()], bool)
        for k in np.flatnonzero(known).tolist():
            guesses[:, k] = self._columns[int(registers[k])]
        return known

    def keep(self, times: np.ndarray, states: np.ndarray, registers: np.ndarray, found: np.ndarray) -> None:
        """Keep solutions (times, registers) at places that will not change any more."""
        if not self._is_at(times, states):
            self._place, self._columns = (times, states), {}
        if (len(self._columns) + len(registers)) * len(times) <= _MOST:
            self._columns |= zip(registers.tolist(), np.ascontiguousarray(found.T), strict=True)

    def _is_at(self, times: np.ndarray, states: np.ndarray) -> bool:
        return self._place is not None and self._place[0] is times and self._place[1] is states
