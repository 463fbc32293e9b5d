"""Large blocks and blocks with long sums: torn shape by shape, so that the rest is one sparse system.

In a long mechanism accelerations and reactions stay unknowns of a sparse linear system; what is only a definition
(the extension of a spring between two unknown points) is computed inside. A shape is taken as a definition for all
its rows at once or not at all.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from lmoc.expression.dag import Expr
from lmoc.expression.evaluate import evaluate
from lmoc.ir.program import Apply, Solve, Step, Total
from lmoc.structure.blocks.block_equations import BatchRows, SquareSystem, SumRows
from lmoc.structure.blocks.small_blocks import NOTHING, Surroundings
from lmoc.structure.linear.coefficients import is_constant
from lmoc.structure.linear.explicit import as_formula, jointly_linear, pivot, solution
from lmoc.support.distinct import distinct
from lmoc.support.records import dataclass


@dataclass(frozen=True, eq=False)
class Piece:
    """The rows of one batch that belong to a block; `inside` marks the entries that the block computes."""

    rows: BatchRows
    equations: np.ndarray
    registers: np.ndarray  # (n, leaves)
    inside: np.ndarray  # (n, leaves)

    @property
    def unknown(self) -> tuple[Expr, ...]:
        """Leaves that are unknown in any row."""
        return tuple(leaf for k, leaf in enumerate(self.rows.leaves) if self.inside[:, k].any())

    @property
    def residual(self) -> Expr:
        return self.rows.batch.shape

    def apply(self, expr: Expr, out: np.ndarray) -> Apply:
        formula, leaves = as_formula(expr)
        return Apply(formula, self.registers[:, [self.rows.leaves.index(leaf) for leaf in leaves]], out)

    def constant(self, expr: Expr, values: np.ndarray) -> np.ndarray:
        """Numbers (n,) of an expression over parameters, given the values of all registers; (n, runs) of (…, runs)."""
        column = {leaf.value[0]: self.registers[:, k] for k, leaf in enumerate(self.rows.leaves)}
        number = evaluate(expr, lambda k, _: values[column[k]])
        return np.broadcast_to(np.asarray(number, float), (len(self.equations), *values.shape[1:]))


def pieces_of(system: SquareSystem, equations: np.ndarray) -> tuple[list[Piece], list[tuple[SumRows, np.ndarray]]]:
    """The equations of one block by batch, and its long sums."""
    here = system.blocks.block[equations[0]]
    owner_block = np.append(system.blocks.block, -1)
    found, sums = [], []
    for r in system.rows:
        low, high = np.searchsorted(equations, [r.first, r.first + r.count])
        if low < high:
            mine = equations[low:high]
            registers = r.registers[mine - r.first]
            found.append(Piece(r, mine, registers, owner_block[system.owner[registers]] == here))
    for s in system.sums:
        low, high = np.searchsorted(equations, [s.first, s.first + len(s.sums.row)])
        if low < high:
            sums.append((s, equations[low:high] - s.first))
    return found, sums


def steps_of(system: SquareSystem, equations: np.ndarray, around: Surroundings) -> list[Step]:
    """One block as one `Solve`; its equations sorted.

    Raises
    ------
    SingularBlocks
    """
    pieces, sums = pieces_of(system, equations)
    unknowns = np.sort(system.match[equations])
    rows = [r for p in pieces if (r := jointly_linear(p.residual, p.unknown)) is not None]
    linear = len(rows) == len(pieces)
    constant = linear and all(is_constant(c, p.rows.batch.kinds) for p, r in zip(pieces, rows) for _, c in r)
    if constant:
        around.test(partial(_singular, pieces, rows, sums, equations, unknowns), equations[None, :])
    definitions = _definitions(pieces, around.favourite, system.registers, around.values)
    for p, leaf in definitions:
        around.divide(partial(_vanishing, p, leaf))
    steps: list[Step] = []
    computed = []
    for p, leaf in definitions:
        out = p.registers[:, p.rows.leaves.index(leaf)]
        computed.append(out)
        steps.append(p.apply(solution(p.residual, leaf), out))
    taken = {id(p) for p, _ in definitions}
    residuals = []
    for p in pieces:
        if id(p) not in taken:
            out = around.new_registers(len(p.equations))
            residuals.append(out)
            steps.append(p.apply(p.residual, out))
    for s, which in sums:
        out = around.new_registers(len(which))
        residuals.append(out)
        steps.append(total(s, which, out))
    torn = np.setdiff1d(unknowns, np.concatenate(computed)) if computed else unknowns
    return [Solve(tuple(steps), torn[None, :], np.concatenate(residuals)[None, :], linear, constant)]


def total(s: SumRows, which: np.ndarray, out: np.ndarray) -> Total:
    """The residuals of some long sums."""
    lengths = np.diff(s.sums.start)[which]
    start = np.concatenate([[0], np.cumsum(lengths)])
    entries = np.repeat(s.sums.start[which] - start[:-1], lengths) + np.arange(start[-1])
    return Total(start, s.registers[entries], s.sums.coefficient[entries].astype(float), out)


def _vanishing(piece: Piece, leaf: Expr, values: np.ndarray) -> np.ndarray:
    """(n, or n, runs) whether the coefficient of a leaf is no number, or nothing beside those of other unknowns."""
    kinds = piece.rows.batch.kinds
    own = pivot(piece.residual, kinds, leaf)
    if own is None:
        return np.ones((len(piece.equations), *values.shape[1:]), bool)
    found = [pivot(piece.residual, kinds, other) for other in piece.unknown]
    sizes = [np.abs(piece.constant(c, values)) for c in found if c is not None]
    result: np.ndarray = ~(np.abs(piece.constant(own, values)) > NOTHING * np.max(sizes, axis=0))
    return result


def _definitions(
    pieces: list[Piece], favourite: np.ndarray, registers: int, values: np.ndarray
) -> list[tuple[Piece, Expr]]:
    """Shapes taken as definitions, with the leaf each is solved for, in an order in which they can be computed."""
    uses = np.zeros(registers, np.int64)
    for p in pieces:
        np.add.at(uses, p.registers[p.inside], 1)
    candidates: list[tuple[int, float, int, Piece, int]] = []
    for p in pieces:
        for i, leaf in enumerate(p.rows.leaves):
            out = p.registers[:, i]
            if not p.inside[:, i].all() or favourite[out].any() or len(distinct(out)) < len(out):
                continue
            if not _vanishing(p, leaf, values).any():
                candidates.append((-len(out), float(uses[out].mean()), len(candidates), p, i))
    read, defined = np.zeros(registers, bool), np.zeros(registers, bool)
    used: set[int] = set()
    result = []
    for *_, p, i in sorted(candidates, key=lambda item: item[:3]):
        out = p.registers[:, i]
        others = np.delete(p.registers, i, axis=1)[np.delete(p.inside, i, axis=1)]
        # what is defined reads what is torn or was defined before, nothing of its own rows and nothing defined later
        if id(p) in used or read[out].any() or defined[out].any() or np.isin(others, out).any():
            continue
        used.add(id(p))
        defined[out] = True
        read[others] = True
        result.append((p, p.rows.leaves[i]))
    return result


def _singular(
    pieces: list[Piece],
    linear: list[tuple[tuple[Expr, Expr], ...]],
    sums: list[tuple[SumRows, np.ndarray]],
    equations: np.ndarray,
    unknowns: np.ndarray,
    values: np.ndarray,
) -> np.ndarray:
    """(1, or 1, runs) whether the matrix cannot be factorized with these values."""
    if values.ndim > 1:
        return np.stack([_singular(pieces, linear, sums, equations, unknowns, own) for own in values.T], axis=1)
    from scipy.sparse import csc_matrix, diags
    from scipy.sparse.linalg import splu

    row, column, entries = [], [], []
    for p, coefficients in zip(pieces, linear, strict=True):
        for leaf, c in coefficients:
            i = p.rows.leaves.index(leaf)
            number = p.constant(c, values)
            inside = p.inside[:, i]
            row.append(np.searchsorted(equations, p.equations[inside]))
            column.append(np.searchsorted(unknowns, p.registers[inside, i]))
            entries.append(number[inside])
    for s, which in sums:
        step = total(s, which, which)
        number = np.repeat(np.searchsorted(equations, s.first + which), np.diff(step.start))
        at = np.minimum(np.searchsorted(unknowns, step.index), len(unknowns) - 1)
        inside = unknowns[at] == step.index
        row.append(number[inside])
        column.append(at[inside])
        entries.append(step.coefficient[inside])
    entry = np.concatenate(entries)
    if not np.isfinite(entry).all():
        return np.array([False])
    n = len(equations)
    matrix = csc_matrix((entry, (np.concatenate(row), np.concatenate(column))), (n, n))
    largest = abs(matrix).max(axis=1).toarray().ravel()
    matrix = csc_matrix(diags(1 / np.where(largest > 0, largest, 1)) @ matrix)
    try:
        pivots = np.abs(splu(matrix).U.diagonal())
    except RuntimeError:  # SuperLU: "Factor is exactly singular"
        return np.array([True])
    return np.array([pivots.min() <= 1e-14 * pivots.max()])
