"""Matrices of implicit blocks in C: where their entries stand, and how the functions of ``c/matrices.c`` see them."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from lmoc.numerics.evaluate.jacobian import Implicit
from lmoc.numerics.evaluate.native.c_code import Matrix, Writer
from lmoc.support.sizes import DENSE_IN_C


class Entries(Protocol):
    """Derivatives that generated code has computed."""

    writer: Writer

    def copy(self, target: str, places: np.ndarray, sources: np.ndarray) -> None:
        """Write entries to places of an array."""


class Matrices:
    """The matrices of all instances of a block: where their entries stand, and how C sees them.

    Attributes
    ----------
    each : numbers of one instance
    places : (nnz,) where the entries of the block's Jacobian stand
    """

    def __init__(self, writer: Writer, shape: tuple[int, int], instance, row, column) -> None:
        """`instance`, `row`, `column` of each entry."""
        self.writer, (self.instances, self.size) = writer, shape
        if not self.is_sparse:
            self.each = self.size**2
            self.places = instance * self.each + row * self.size + column
            pattern = "0, 0, 0, 0"
        else:
            entries, place = np.unique(column * self.size + row, return_inverse=True)
            self.each = len(entries)
            self.places = instance * self.each + place
            pattern = self._sparse(*np.divmod(entries, self.size))
        self.a, self.name = writer.name("a"), writer.name("m")
        writer.add(f"double *{self.a} = {writer.space(self.instances * self.each)};")
        fields = f"{self.number(self.size)}, {self.number(self.each)}, {pattern}"
        writer.add(f"const lmoc_matrix {self.name} = {{{fields}}};")

    @property
    def is_sparse(self) -> bool:
        return self.size > DENSE_IN_C

    def number(self, value: int) -> str:
        """A number of the block; those of a small matrix stand in the text, so that the compiler knows them."""
        return self.writer.number(value) if self.is_sparse else str(value)

    def _sparse(self, columns: np.ndarray, rows: np.ndarray) -> str:
        indptr = np.searchsorted(columns, np.arange(self.size + 1))
        pattern = f"{self.writer.indices(indptr)}, {self.writer.indices(rows)}"
        first = len(self.writer.tables)
        names = [self.writer.table(np.zeros(1)) for _ in range(2)]  # which the kernel fills
        self.writer.matrices.append(Matrix(first, indptr.astype(np.int32), rows.astype(np.int32)))
        return f"{pattern}, (lmoc_factors *){names[0]}, (lmoc_choose){names[1]}"

    def fill(self, found: Entries, sources: np.ndarray) -> None:
        """Write the entries to their places."""
        total = self.writer.number(self.instances * self.each)
        self.writer.add(f"for (int64_t k = 0; k < {total}; k++) {self.a}[k] = 0;")
        found.copy(self.a, self.places, sources)


def write_implicit(found: Entries, stage: Implicit) -> tuple[str, np.ndarray]:
    """Write ``x = -A⁻¹ B``, the derivatives of a block's unknowns.

    Returns
    -------
    The C name of the array x, and where in it the new entries stand.
    """
    writer, (instances, size, width) = found.writer, stage.shape
    matrices = Matrices(writer, (instances, size), *stage.a_place)
    matrices.fill(found, stage.a_source)
    x, n = writer.name("x"), writer.number(instances)
    total, columns = writer.number(instances * size * width), writer.number(width)
    writer.add(f"double *{x} = {writer.space(instances * size * width)};")
    writer.add(f"for (int64_t k = 0; k < {total}; k++) {x}[k] = 0;")

    def places(instance, row, column):  # one column after the other, as they are solved
        return (instance * width + column) * size + row

    found.copy(x, places(*stage.b_place), stage.b_source)
    writer.add(f"lmoc_implicit(&{matrices.name}, {n}, {matrices.a}, {x}, {columns});")
    return x, places(*stage.result)
