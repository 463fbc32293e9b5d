"""The matrices of implicit blocks on a tape: where their entries stand."""

from __future__ import annotations

import numpy as np

from lmoc.lower.chain_rule import Implicit
from lmoc.lower.tape import SolveBlock
from lmoc.lower.writer import Writer
from lmoc.support.sizes import DENSE_IN_C


def block_matrix(
    writer: Writer,
    shape: tuple[int, int],
    places: np.ndarray,
    instance: np.ndarray,
    row: np.ndarray,
    column: np.ndarray,
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray] | None]:
    """Return where the entries of the matrices stand, (instances, each), and the pattern of sparse ones.

    Parameters
    ----------
    places : of the entries given by instance, row and column
    """
    instances, size = shape
    if size <= DENSE_IN_C:
        fill = np.full((instances, size * size), writer.zero, np.int32)
        fill[instance, row * size + column] = places
        return fill, None
    entries, which = np.unique(column * size + row, return_inverse=True)
    fill = np.full((instances, len(entries)), writer.zero, np.int32)
    fill[instance, which.ravel()] = places
    columns, rows = np.divmod(entries, size)
    return fill, (np.searchsorted(columns, np.arange(size + 1)).astype(np.int32), rows.astype(np.int32))


def write_implicit(writer: Writer, stage: Implicit, place: np.ndarray) -> None:
    """Write ``x = -A⁻¹ B``, the derivatives of a block's unknowns, one column after the other.

    Parameters
    ----------
    place : where entries stand; those of the unknowns are put to it
    """
    instances, size, width = stage.shape
    if not width:
        return
    fill, pattern = block_matrix(writer, (instances, size), place[stage.a_source], *stage.a_place)
    right = np.full((instances, width, size), writer.zero, np.int32)
    instance, row, column = stage.b_place
    right[instance, column, row] = place[stage.b_source]
    x = writer.reserve(right.size)
    instance, row, column = stage.result
    place[stage.first : stage.stop] = x + (instance * width + column) * size + row
    step = stage.step
    a, b = writer.reserve(fill.shape[1]), writer.reserve(size)
    number = writer.block(SolveBlock(step, step.unknowns, step.residuals, fill, right, pattern, a, b, 0, x, False))
    writer.on_block("implicit", number)
