"""The energy ledger of a run: what was stored, supplied and lost, and how well that adds up."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from lmoc.expression.dag import Expr, slots
from lmoc.expression.evaluate import evaluate
from lmoc.ir.flat import FlatDAE
from lmoc.numerics.limits import NUMBERS
from lmoc.support.distinct import distinct
from lmoc.support.records import dataclass

Observe = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
_SAMPLES = 25, 200  # least and most times at which the exchange between stores is looked at
_ROUNDING = 1e-6  # of what is stored: less than this, nothing flows that could be judged
_AT_REST = 1e-9  # of the work of the laws' forces over the lengths around, likewise


@dataclass(frozen=True, eq=False, repr=False)
class Energy:
    """Energies over the time of a run.

    Attributes
    ----------
    stored : J, kinetic, elastic and gravitational
    supplied : J, work of the sources since the start
    lost : J, heat since the start
    exchanged : J, the most that has moved between stores (from potential to kinetic, from one part to another), or in
        and out between the output times
    balance : the largest |supplied - lost - Δstored| as a fraction of the largest of supplied, lost, the range of
        stored, and what the stores have exchanged (an undamped oscillator is judged by the energy that swings); where
        all these are mere rounding, of what is stored, and of the work of the laws' forces over the lengths around
    held : J, that work: what forces hold at rest supplies and loses nothing but rounding
    reason : why a part of it has no value, where that is known
    """

    stored: np.ndarray
    supplied: np.ndarray
    lost: np.ndarray
    exchanged: float
    held: float = 0.0
    reason: str = ""

    @property
    def residual(self) -> np.ndarray:
        return self.supplied - self.lost - (self.stored - self.stored[0])

    @property
    def scale(self) -> float:
        sizes = (np.abs(self.supplied).max(), np.abs(self.lost).max(), np.ptp(self.stored), self.exchanged)
        return float(max(*sizes, _ROUNDING * np.abs(self.stored).max(), _AT_REST * self.held))

    @property
    def balance(self) -> float:
        worst = float(np.abs(self.residual).max())
        if np.isnan(worst):
            return np.nan
        return worst / self.scale if self.scale > 0 else 0.0 if worst == 0 else np.inf

    def __str__(self) -> str:
        if not np.isfinite(self.balance):
            return f"unknown: {self.reason or 'a part of the ledger has no value'}"
        if not (self.stored.any() or self.supplied.any() or self.lost.any()):
            return "none stored, supplied or lost"
        change = self.stored[-1] - self.stored[0]
        return (
            f"supplied {self.supplied[-1]:.4g} J = lost {self.lost[-1]:.4g} J + stored {change:.4g} J; "
            f"balance error {self.balance:.1e}"
        )

    def __repr__(self) -> str:
        return f"<Energy: {self}>"


def measure(
    stored: np.ndarray, work: np.ndarray, heat: np.ndarray, exchanged: float, held: float, reason: str
) -> Energy:
    """Return the ledger from the values of ``ledger.stored``, ``ledger.work`` and ``ledger.heat`` over time."""
    return Energy(stored, work - work[0], heat - heat[0], exchanged, held, reason)


def exchanged_energy(flat: FlatDAE, segments: Sequence[tuple[Observe, np.ndarray, np.ndarray]]) -> float:
    """Return half of Σ |term - term at the start| over the terms of all stored energies, at its largest.

    Parameters
    ----------
    segments : for each segment of a run ``(variables, times, states) -> values``, some times and the states there
    """
    count = sum(len(times) for _, times, _ in segments)
    most = int(np.clip(NUMBERS // max(1, flat.count), *_SAMPLES))
    thinned = [(observe, times[:: -(-count // most)], x[:: -(-count // most)]) for observe, times, x in segments]
    times = np.concatenate([t for _, t, _ in thinned])
    total = np.zeros(len(times))
    groups = list(_energy_groups(flat))
    used = distinct(np.concatenate([np.zeros(0, int), *(group.slots[own].ravel() for group, _, own in groups)]))
    values = np.concatenate([observe(used, t, x) for observe, t, x in thinned])
    for group, expression, own in groups:
        columns = np.searchsorted(used, group.slots[own])
        for term in _terms(expression):
            value = evaluate(term, lambda k, _: values[:, columns[:, k]], times[:, None])  # noqa: B023
            value = np.broadcast_to(value, (len(times), len(own)))
            total += np.nan_to_num(np.abs(value - value[:1])).sum(axis=1)
    return float(total.max(initial=0.0)) / 2


def _energy_groups(flat: FlatDAE):
    """Equations ``energy = expression`` of elements: (group, expression, rows)."""
    is_energy = flat.per_variable(lambda b: len(b.path) > 1 and b.path[-1][0] == "energy", bool)
    for group in flat.groups:
        for side, other in ((group.left, group.right), (group.right, group.left)):
            if side.op == "slot" and side.value[1] == 0 and _explicit(other):
                own = np.flatnonzero(is_energy[group.slots[:, side.value[0]]])
                if len(own):
                    yield group, other, own
                    break


def _explicit(expression: Expr) -> bool:
    return all(leaf.value[1] == 0 for leaf in slots(expression))


def _terms(expression: Expr) -> list[Expr]:
    """The additive terms of an expression."""
    if expression.op in ("add", "sub"):
        return _terms(expression.args[0]) + _terms(expression.args[1])
    return _terms(expression.args[0]) if expression.op == "neg" else [expression]
