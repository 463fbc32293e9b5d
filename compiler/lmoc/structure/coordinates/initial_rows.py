"""The initial equations of a model over root jets: they say where a scene starts, as its start values do."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lmoc.expression.calculus import differentiate
from lmoc.expression.dag import Expr, slots
from lmoc.expression.evaluate import evaluate_together
from lmoc.ir.flat import Group
from lmoc.structure.index.system import EquationSystem
from lmoc.structure.linear.coefficients import UNKNOWN
from lmoc.support.records import dataclass


@dataclass(frozen=True, eq=False)
class _Leaf:
    """A jet of the flat model in some equations: ``factor·value.flat[jet] + offset`` in each.

    Attributes
    ----------
    partial : of the equations by this jet
    unknown : (rows,) whether the root's jet is looked for
    """

    partial: Expr
    jet: np.ndarray
    factor: np.ndarray
    offset: np.ndarray
    unknown: np.ndarray


@dataclass(frozen=True, eq=False)
class InitialRows:
    """Initial equations of one shape.

    Attributes
    ----------
    rows : how many
    leaves : by (column, order) of the shape
    """

    shape: Expr
    rows: int
    leaves: dict[tuple[int, int], _Leaf]

    def take(self, rows: np.ndarray) -> InitialRows:
        """Return some of the equations."""
        leaves = {
            key: _Leaf(f.partial, f.jet[rows], f.factor[rows], f.offset[rows], f.unknown[rows])
            for key, f in self.leaves.items()
        }
        return InitialRows(self.shape, len(rows), leaves)

    @property
    def entries(self) -> tuple[np.ndarray, np.ndarray]:
        """Return rows and jets (positions in the flattened values) of the entries of the Jacobian."""
        each = [(np.flatnonzero(leaf.unknown), leaf.jet[leaf.unknown]) for leaf in self.leaves.values()]
        return np.concatenate([r for r, _ in each]), np.concatenate([j for _, j in each])

    def linearized(
        self, value_of: Callable[[np.ndarray], np.ndarray], time: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the residuals (…, rows), and the entries of the Jacobian (…, nnz) in the order of `entries`.

        Parameters
        ----------
        value_of : from jets to their values (…, jets), at one point or at many
        """
        shape = value_of(np.zeros(self.rows, np.int64)).shape

        def column(k: int, order: int) -> np.ndarray:
            leaf = self.leaves[k, order]
            result: np.ndarray = leaf.factor * value_of(leaf.jet) + leaf.offset
            return result

        roots = (self.shape, *(leaf.partial for leaf in self.leaves.values()))
        found = evaluate_together(roots, column, time)
        residual, *slopes = (np.broadcast_to(np.asarray(value, float), shape) for value in found)
        parts = [(s * f.factor)[..., f.unknown] for s, f in zip(slopes, self.leaves.values(), strict=True)]
        return residual, np.concatenate(parts, axis=-1)


def initial_rows(system: EquationSystem, highest: int) -> list[InitialRows]:
    """Return the initial equations in jets up to an order; those that contain higher ones are left out."""
    found = [_rows(system, group, highest) for group in system.flat.initial_groups]
    return [part for part in found if part is not None]


def _rows(system: EquationSystem, group: Group, highest: int) -> InitialRows | None:
    shape = group.residual
    jets = [leaf.value for leaf in slots(shape)]
    placed = [_placed(system, group.slots[:, k], order) for k, order in jets]
    kept = np.ones(group.rows, bool)
    for order, *_ in placed:
        kept &= order <= highest
    if not any((kept & unknown).any() for *_, unknown in placed):
        return None
    width, leaves = len(system.kind), {}
    for leaf, (order, root, factor, offset, unknown) in zip(slots(shape), placed, strict=True):
        part = np.where(kept, order, 0) * width + root
        numbers = part[kept], factor[kept], offset[kept], unknown[kept]
        leaves[leaf.value] = _Leaf(differentiate(shape, leaf), *numbers)
    return InitialRows(shape, int(kept.sum()), leaves)


def _placed(system: EquationSystem, variable: np.ndarray, order: int) -> tuple[np.ndarray, ...]:
    """Return order, root, factor and offset of derivatives of flat variables, and whether the root is unknown."""
    normalized, values = system.normalized, system.normalized.all_values
    own = system.kind[variable] == UNKNOWN
    root = np.where(own, normalized.root[variable], variable)
    raised = np.where(own, normalized.order[variable], 0) + order
    by, shift = (np.where(own, column[variable], -1) for column in (normalized.factor, normalized.offset))
    factor = np.where(by >= 0, values[by], np.where(by == -2, -1.0, 1.0))
    offset = np.where((shift >= 0) & (order == 0), values[shift], 0.0)
    unknown = system.column[root] >= 0
    constant = (system.kind[root] != UNKNOWN) & (raised > 0)  # parameters; rates of inputs are not looked up here
    return np.where(constant, 0, raised), root, np.where(constant, 0.0, factor), offset, unknown
