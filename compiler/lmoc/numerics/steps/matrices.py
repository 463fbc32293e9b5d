"""Storage of the Jacobian of an implicit method: dense when small, band where the band is narrow, sparse otherwise."""

from __future__ import annotations

import numpy as np

from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.system import OpenedSystem, System
from lmoc.support.records import dataclass
from lmoc.support.sizes import DENSE

_BAND = 40  # widest band (both halves) for the band solver


@dataclass(frozen=True, eq=False)
class MatrixLayout:
    """Storage of ``scale·∂f/∂x + shift·1`` for states in a new order.

    Attributes
    ----------
    kind : "dense", "band" or "sparse"
    order : (n,) the states in the order in which the solver has them; None as they are
    entries : which entries of `System.pattern` are stored: those in rows of quadratures are not. Nothing reads a
        quadrature, so Newton's method converges without them, and the ledger of energy, which depends on every
        state, does not fill a band.
    place : positions of the entries in the flat storage
    diagonal : positions of the diagonal
    size : numbers stored
    """

    kind: str
    order: np.ndarray | None
    entries: np.ndarray
    place: np.ndarray
    diagonal: np.ndarray
    size: int
    lower: int = 0
    upper: int = 0
    indptr: np.ndarray | None = None
    indices: np.ndarray | None = None

    @property
    def text(self) -> str:
        """In words, for the statistics."""
        if self.kind == "band":
            return f"band of {self.lower} + 1 + {self.upper}, reverse Cuthill–McKee"
        return "sparse" if self.kind == "sparse" else "dense"

    def write(self, values: np.ndarray, scale: float, shift: float | np.ndarray, target: np.ndarray) -> None:
        """Write into storage as `native.cvode.Matrix.fill` is asked to; `shift` may differ along the diagonal."""
        flat = target.reshape(-1) if target.flags.c_contiguous else np.zeros(self.size)
        flat[:] = 0.0
        flat[self.place] = scale * values[self.entries]
        flat[self.diagonal] += shift
        if not target.flags.c_contiguous:
            target[...] = flat.reshape(target.shape)


def layout_of(system: System | OpenedSystem, plan: Plan) -> MatrixLayout:
    """Choose the storage for the Jacobian of a system."""
    n = system.n
    indptr, rows = system.pattern()
    columns = np.repeat(np.arange(n), np.diff(indptr))
    entries = np.flatnonzero((rows < plan.state_count) | (rows >= len(plan.states)))
    rows, columns = rows[entries], columns[entries]
    diagonal = np.arange(n)
    if n <= DENSE:
        return MatrixLayout("dense", None, entries, columns * n + rows, diagonal * n + diagonal, n * n)
    order = _narrow(rows, columns, n)
    new = np.empty(n, int)
    new[order] = np.arange(n)
    i, j = new[rows], new[columns]
    lower, upper = int(max(0, (i - j).max(initial=0))), int(max(0, (j - i).max(initial=0)))
    if lower + upper <= _BAND:
        width = lower + upper + 1
        return MatrixLayout(
            "band", order, entries, j * width + upper + i - j, diagonal * width + upper, n * width, lower, upper
        )
    return _sparse(entries, rows, columns, n)


def _narrow(rows: np.ndarray, columns: np.ndarray, n: int) -> np.ndarray:
    """Reverse Cuthill–McKee order of the graph of the matrix."""
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    graph = csr_matrix((np.ones(2 * len(rows)), (np.r_[rows, columns], np.r_[columns, rows])), shape=(n, n))
    return reverse_cuthill_mckee(graph, symmetric_mode=True)


def _sparse(entries: np.ndarray, rows: np.ndarray, columns: np.ndarray, n: int) -> MatrixLayout:
    """The pattern together with the diagonal, by columns."""
    key, diagonal = columns.astype(np.int64) * n + rows, np.arange(n, dtype=np.int64) * (n + 1)
    every = np.union1d(key, diagonal)
    column, row = np.divmod(every, n)
    indptr = np.concatenate([[0], np.cumsum(np.bincount(column, minlength=n))]).astype(np.int32)
    places = np.searchsorted(every, key), np.searchsorted(every, diagonal)
    return MatrixLayout("sparse", None, entries, *places, len(every), indptr=indptr, indices=row.astype(np.int32))
