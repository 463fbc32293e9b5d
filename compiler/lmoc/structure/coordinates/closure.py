"""The start of a scene: the nearest point to the start values that satisfies its constraints.

Newton's method for fewer equations than unknowns: each step is the smallest one, in a weighted norm, that satisfies
the linearized constraints (Ben-Israel, J. Math. Anal. Appl. 15, 1966). Values that the user has given hardly move.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from lmoc.expression.calculus import differentiate
from lmoc.expression.dag import Expr
from lmoc.expression.evaluate import evaluate
from lmoc.structure.coordinates.initial_rows import InitialRows, initial_rows
from lmoc.structure.index.incidence import ranges
from lmoc.structure.index.system import EquationBatch, EquationSystem
from lmoc.structure.loops.nearest import nearest
from lmoc.structure.loops.sample import Sample, given
from lmoc.support.distinct import distinct
from lmoc.support.sizes import DENSE

# steps until it is given up; relative size of the last one; what keeps the equations for it regular where constraints
# repeat each other
STEPS, CLOSED, DAMPING = 40, 1e-9, 1e-13


def start_point(system: EquationSystem, c: np.ndarray, highest: int) -> Sample:
    """Return a point that satisfies all equations with c > 0 at the start time, near the start values of the model.

    Initial equations hold there, too, unless there is no such point. Where none is found at all, those values
    themselves: no more is known then.
    """
    sample, ease = given(system, highest)
    initial = initial_rows(system, highest)
    found = _nearest(_Constraints(system, c, sample, initial), sample, ease) if initial else None
    return found or _nearest(_Constraints(system, c, sample), sample, ease) or sample


def _nearest(constraints: _Constraints, sample: Sample, ease: np.ndarray) -> Sample | None:
    """The point nearest to a sample that satisfies constraints; None where none is found."""
    weight = ease.ravel()[constraints.jets]
    begin = sample.value.ravel()[constraints.jets]

    def at(values: np.ndarray) -> Sample:
        value = sample.value.copy()
        value.flat[constraints.jets] = values
        return replace(sample, value=value)

    if constraints.count <= DENSE:
        found = nearest(begin, weight, lambda values: constraints.dense(at(values)), constraints.placed)
    else:
        found = _closed(constraints, at, begin, weight)
    return None if found is None else at(found)


def _closed(
    constraints: _Constraints, at: Callable[[np.ndarray], Sample], values: np.ndarray, weight: np.ndarray
) -> np.ndarray | None:
    """The values that Newton's method reaches, None where it diverges."""
    for _ in range(STEPS):
        step = constraints.step(at(values), weight)
        if not np.isfinite(step).all():
            return None
        values = values + step
        if np.abs(step).max(initial=0) <= CLOSED * np.abs(values).max(initial=0):
            return values
    return None


class _Constraints:
    """The equations that are differentiated, and initial ones: their values and derivatives by the jets in them.

    Attributes
    ----------
    jets : (unknowns,) positions in the flattened values
    placed : whether initial equations contain some of those that are tied to each other
    """

    def __init__(
        self, system: EquationSystem, c: np.ndarray, sample: Sample, initial: Sequence[InitialRows] = ()
    ) -> None:
        self.parts: list[tuple[EquationBatch, list[tuple[Expr, Expr]]]] = []
        width, first = sample.value.shape[1], 0
        rows, jets = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        for b in system.batches:
            mine = np.flatnonzero(c[b.row] > 0)
            if not len(mine):
                continue
            part = b.take(mine)
            self.parts.append((part, [differentiate(b.shape, leaf) for leaf in b.unknown]))
            for leaf in b.unknown:
                k, order = leaf.value
                rows.append(first + np.arange(len(mine)))
                jets.append(order * width + part.slots[:, k])
            first += len(mine)
        self.initial, self.placed, tied = initial, False, np.concatenate(jets)
        for own in initial:
            row, jet = own.entries
            self.placed |= bool(np.isin(jet, tied).any())
            rows.append(first + row)
            jets.append(jet)
            first += own.rows
        s = system.sums
        mine = np.flatnonzero(c[s.row] > 0)
        entries = ranges(s.start, mine)
        rows.append(first + np.repeat(np.arange(len(mine)), np.diff(s.start)[mine]))
        jets.append(s.order[entries] * width + s.index[entries])
        self.count = first + len(mine)
        self.sum_rows, self.sum_jets, self.coefficient = rows[-1], jets[-1], s.coefficient[entries].astype(float)
        self.row, found = np.concatenate(rows), np.concatenate(jets)
        self.jets = distinct(found)
        self.column = np.searchsorted(self.jets, found)

    def step(self, at: Sample, weight: np.ndarray) -> np.ndarray:
        """(unknowns,) the smallest step on which the linearized constraints vanish."""
        residual, entry = self._linearized(at)
        size = np.sqrt(np.bincount(self.row, weight[self.column] * entry**2, self.count))
        size = np.where(size > 0, size, 1.0)
        entry = entry / size[self.row]
        multiplier = self._solve(entry, weight, -residual / size)
        return weight * np.bincount(self.column, entry * multiplier[self.row], len(self.jets))

    def _linearized(self, at: Sample) -> tuple[np.ndarray, np.ndarray]:
        residual, entries, first = np.zeros(self.count), [np.zeros(0)], 0
        for part, partials in self.parts:
            n, column = len(part.row), at.column(part)
            residual[first : first + n] = evaluate(part.shape, column, at.time)
            for p in partials:
                entries.append(np.broadcast_to(np.asarray(evaluate(p, column, at.time), float), n))
            first += n
        for own in self.initial:
            residual[first : first + own.rows], entry = own.linearized(at)
            entries.append(entry)
            first += own.rows
        residual += np.bincount(self.sum_rows, self.coefficient * at.value.flat[self.sum_jets], self.count)
        return residual, np.concatenate([*entries, self.coefficient])

    def dense(self, at: Sample) -> tuple[np.ndarray, np.ndarray]:
        """Residual and Jacobian by the jets."""
        residual, entry = self._linearized(at)
        jacobian = np.zeros((self.count, len(self.jets)))
        np.add.at(jacobian, (self.row, self.column), entry)
        return residual, jacobian

    def _solve(self, entry: np.ndarray, weight: np.ndarray, right: np.ndarray) -> np.ndarray:
        """(rows,) the multipliers of the constraints; NaN where they cannot be determined."""
        if not (np.isfinite(entry).all() and np.isfinite(right).all()):
            return np.full(self.count, np.nan)
        from scipy.sparse import csr_matrix, diags, identity
        from scipy.sparse.linalg import splu

        jacobian = csr_matrix((entry, (self.row, self.column)), (self.count, len(self.jets)))
        normal = jacobian @ diags(weight) @ jacobian.T + DAMPING * identity(self.count)
        try:
            return splu(normal.tocsc()).solve(right)
        except RuntimeError:  # SuperLU: "Factor is exactly singular"
            return np.full(self.count, np.nan)
