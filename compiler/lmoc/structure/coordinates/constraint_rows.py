"""The equations that tie positions to each other, as functions of their unknowns: at one point or at many at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np

from lmoc.expression.calculus import differentiate
from lmoc.expression.dag import slots
from lmoc.expression.evaluate import evaluate_together
from lmoc.structure.coordinates.initial_rows import InitialRows
from lmoc.structure.index.dulmage_mendelsohn import components
from lmoc.structure.index.incidence import Incidence, ranges
from lmoc.structure.index.system import EquationBatch, EquationSystem
from lmoc.structure.loops.sample import Sample
from lmoc.structure.loops.smallest import DAMPING, multipliers
from lmoc.support.distinct import distinct

_Columns = dict[tuple[int, int], np.ndarray]  # of slots of a shape: their columns and orders


class ConstraintRows:
    """The equations that are differentiated, and initial ones: their values and derivatives by the jets in them.

    Attributes
    ----------
    jets : (n,) positions in the flattened sample of the unknowns
    count : number of rows
    row, column : entries of the Jacobian, in the order in which `linearized` returns them
    source : (count,) flat equation of each row; -1 for initial equations
    placed : whether initial equations contain some of the jets that are tied to each other
    """

    def __init__(
        self,
        sample: Sample,
        parts: Sequence[EquationBatch],
        source: np.ndarray,
        initial: Sequence[InitialRows],
        sums: tuple[np.ndarray, np.ndarray, np.ndarray],
    ) -> None:
        self.sample, self.initial, self.source = sample, tuple(initial), source
        self._parts = [(part, [differentiate(part.shape, leaf) for leaf in part.unknown]) for part in parts]
        width, first = sample.value.shape[1], 0
        rows, jets = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        for part in parts:
            for leaf in part.unknown:
                k, order = leaf.value
                rows.append(first + np.arange(len(part.row)))
                jets.append(order * width + part.slots[:, k])
            first += len(part.row)
        self.placed, tied = False, np.concatenate(jets)
        for own in initial:
            row, jet = own.entries
            self.placed |= bool(np.isin(jet, tied).any())
            rows.append(first + row)
            jets.append(jet)
            first += own.rows
        sum_rows, sum_jets, self._coefficient = sums
        rows.append(first + sum_rows)
        jets.append(sum_jets)
        self.count, self._sum_rows = len(source), rows[-1]
        self.row, found = np.concatenate(rows), np.concatenate(jets)
        self.jets = distinct(found)
        self.column = np.searchsorted(self.jets, found)
        self._sum_column = np.searchsorted(self.jets, jets[-1])

    @staticmethod
    def of(
        system: EquationSystem, c: np.ndarray, sample: Sample, initial: Sequence[InitialRows] = ()
    ) -> ConstraintRows:
        """Return the equations of a system that are differentiated (c > 0), and initial ones."""
        parts = [b.take(np.flatnonzero(c[b.row] > 0)) for b in system.batches]
        parts = [part for part in parts if len(part.row)]
        s = system.sums
        mine = np.flatnonzero(c[s.row] > 0)
        entries = ranges(s.start, mine)
        rows = np.repeat(np.arange(len(mine)), np.diff(s.start)[mine])
        sums = rows, s.order[entries] * sample.value.shape[1] + s.index[entries], s.coefficient[entries].astype(float)
        unnamed = np.full(sum(own.rows for own in initial), -1)
        source = np.concatenate([*(system.source[p.row] for p in parts), unnamed, system.source[s.row[mine]]])
        return ConstraintRows(sample, parts, source.astype(np.int64), initial, sums)

    def take(self, rows: np.ndarray) -> ConstraintRows:
        """Return some of the rows, in the order of their numbers."""
        number = np.full(self.count, -1)
        number[np.sort(rows)] = np.arange(len(rows))
        parts, initial, first = [], [], 0
        for part, _ in self._parts:
            own = np.flatnonzero(number[first : first + len(part.row)] >= 0)
            first += len(part.row)
            parts += [part.take(own)] if len(own) else []
        for some in self.initial:
            own = np.flatnonzero(number[first : first + some.rows] >= 0)
            first += some.rows
            initial += [some.take(own)] if len(own) else []
        kept = number[self._sum_rows] >= 0
        before = sum(len(part.row) for part in parts) + sum(own.rows for own in initial)
        sums = number[self._sum_rows[kept]] - before, self.jets[self._sum_column[kept]], self._coefficient[kept]
        return ConstraintRows(self.sample, parts, self.source[np.sort(rows)], initial, sums)

    @property
    def begin(self) -> np.ndarray:
        """(n,) the values of the sample."""
        return self.sample.value.flat[self.jets]

    def components(self, held: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Rows and jets that depend on each other while some jets are held: pairs of positions, held ones left out.

        Parameters
        ----------
        held : (n,) mask
        """
        free = ~held[self.column]
        incidence = Incidence.of(
            self.count, len(self.jets), self.row[free], self.column[free], np.zeros(int(free.sum()), np.int64)
        )
        return components(incidence, np.arange(self.count), np.flatnonzero(~held))

    def contents(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return what tells rows apart beside their unknowns: lists of rows, and a number for each of them.

        Initial equations are told apart altogether.
        """
        found, first = [], 0
        for k, ((part, _), known) in enumerate(zip(self._parts, self._known, strict=True)):
            own = first + np.arange(len(part.row))
            found += [(own, np.full(len(own), float(k))), *((own, value) for value in known.values())]
            first += len(part.row)
        initial = first + np.arange(sum(own.rows for own in self.initial))
        return [*found, (initial, initial.astype(float)), (self._sum_rows, self._coefficient)]

    def residual(self, values: np.ndarray) -> np.ndarray:
        """(…, count) the left-hand sides at values (…, n)."""
        return self._assembled(values, entries=False)[0]

    def linearized(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return residuals (…, count) and entries of the Jacobian (…, nnz) at values (…, n)."""
        return self._assembled(values, entries=True)

    def dense(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return residuals (…, count) and the Jacobian (…, count, n) at values (…, n)."""
        residual, entry = self.linearized(values)
        jacobian = np.zeros((*values.shape[:-1], self.count * len(self.jets)))
        place, first, more = self._dense_places
        jacobian[..., place[first]] = entry[..., first]
        if len(more):
            np.add.at(jacobian.T, place[more], entry[..., more].T)
        return residual, jacobian.reshape(*values.shape[:-1], self.count, len(self.jets))

    def step(self, values: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """(n,) the smallest step from one point on which the linearized constraints vanish, by sparse factors."""
        residual, entry = self.linearized(values)
        size = np.sqrt(np.bincount(self.row, weight[self.column] * entry**2, self.count))
        size = np.where(size > 0, size, 1.0)
        entry = entry / size[self.row]
        shape = self.count, len(self.jets)
        multiplier = multipliers((self.row, self.column, entry), shape, weight, -residual / size, DAMPING)
        return weight * np.bincount(self.column, entry * multiplier[self.row], len(self.jets))

    @cached_property
    def _dense_places(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Where each entry stands in the dense Jacobian, the entries that are the first there, and the others."""
        place = self.row * len(self.jets) + self.column
        first = np.sort(np.unique(place, return_index=True)[1])
        return place, first, np.setdiff1d(np.arange(len(place)), first)

    @cached_property
    def _places(self) -> list[_Columns]:
        """For each part the positions among the jets of its unknown leaves."""
        width = self.sample.value.shape[1]
        return [
            {
                leaf.value: np.searchsorted(self.jets, leaf.value[1] * width + part.slots[:, leaf.value[0]])
                for leaf in part.unknown
            }
            for part, _ in self._parts
        ]

    @cached_property
    def _known(self) -> list[_Columns]:
        """For each part the values of its other leaves, which stay as in the sample."""
        at, known = self.sample.value, []
        for (part, _), places in zip(self._parts, self._places, strict=True):
            others = [leaf.value for leaf in slots(part.shape) if leaf.value not in places]
            known.append({(k, order): at[order, part.slots[:, k]] for k, order in others})
        return known

    def _assembled(self, values: np.ndarray, entries: bool) -> tuple[np.ndarray, np.ndarray]:
        time, shape = self.sample.time, values.shape[:-1]
        residual, first, at = np.zeros((*shape, self.count)), 0, 0
        found = np.empty((*shape, len(self.row) if entries else 0))
        for (part, partials), places, known in zip(self._parts, self._places, self._known, strict=True):
            n = len(part.row)

            def column(k: int, order: int, places: _Columns = places, known: _Columns = known) -> np.ndarray:
                place = places.get((k, order))
                return known[k, order] if place is None else values.take(place, axis=-1)

            value, *slopes = evaluate_together((part.shape, *(partials if entries else ())), column, time)
            residual[..., first : first + n] = value
            for slope in slopes:
                found[..., at : at + n] = slope
                at += n
            first += n
        for own in self.initial:
            residual[..., first : first + own.rows], entry = own.linearized(self._value_of(values), time)
            if entries:
                found[..., at : at + entry.shape[-1]] = entry
                at += entry.shape[-1]
            first += own.rows
        if len(self._sum_rows):
            np.add.at(residual.T, self._sum_rows, (self._coefficient * values[..., self._sum_column]).T)
        if entries:
            found[..., at:] = self._coefficient
        return residual, found

    def _value_of(self, values: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """Return the function from jets, unknown here or not, to their values (…, jets)."""
        at = self.sample.value

        def value_of(jets: np.ndarray) -> np.ndarray:
            place = np.minimum(np.searchsorted(self.jets, jets), len(self.jets) - 1)
            return np.where(self.jets[place] == jets, values[..., place], at.flat[jets])

        return value_of
