"""Defects of a structure that a stage has made: a mistake in the compiler, never in the user's model."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from lmoc.expression.dag import Expr, slots

SHOWN = 3  # places of one finding that are named


class CorruptStructureError(Exception):
    """A structure violates what its readers rely on.

    Attributes
    ----------
    structure : class name of the structure
    findings : one sentence each
    """

    def __init__(self, structure: str, findings: list[str]):
        super().__init__(f"{structure}: " + "; ".join(findings))
        self.structure = structure
        self.findings = findings


class Findings:
    """Collects what is wrong; `where` names the part of the structure that is being looked at."""

    def __init__(self) -> None:
        self.found: list[str] = []

    def require(self, holds: bool, where: str, what: str) -> bool:
        """Note what is wrong where a condition does not hold; returns the condition."""
        if not holds:
            self.found.append(f"{where}: {what}")
        return bool(holds)

    def none(self, wrong: np.ndarray, where: str, what: str) -> bool:
        """Note the rows of a mask in which something is wrong; returns whether there are none."""
        rows = np.flatnonzero(wrong)
        if len(rows):
            some = ", ".join(map(str, rows[:SHOWN].tolist())) + (", …" if len(rows) > SHOWN else "")
            self.found.append(f"{where}: {what} (at {some})")
        return not len(rows)

    def indices(self, values: np.ndarray, low: int, stop: int, where: str, shape: tuple[int | None, ...] = ()) -> bool:
        """Require integers from `low` to `stop` - 1, in an array of the given shape (None: any length)."""
        if not self.require(isinstance(values, np.ndarray) and values.dtype.kind in "iu", where, "no integers"):
            return False
        fits = not shape or len(shape) == values.ndim
        fits = fits and all(n in (None, m) for n, m in zip(shape, values.shape, strict=False))
        if not self.require(fits, where, f"shape {values.shape} instead of {shape}"):
            return False
        outside: np.ndarray = np.asarray((values < low) | (values >= stop))
        rows = np.asarray(outside.any(axis=tuple(range(1, values.ndim))))
        return self.none(rows, where, f"index outside {low} … {stop - 1}")

    def pointers(self, start: np.ndarray, rows: int, entries: int, where: str) -> bool:
        """Require the beginnings of `rows` segments that cover `entries` entries."""
        return (
            self.indices(start, 0, entries + 1, where, (rows + 1,))
            and self.require(bool(start[0] == 0 and start[-1] == entries), where, "segments do not cover all entries")
            and self.none(np.diff(start) < 0, where, "segments out of order")
        )

    def arity(self, shapes: Iterable[Expr], width: int, where: str) -> bool:
        """Require that no leaf of the shapes reads a column that the table lacks."""
        highest = max((leaf.value[0] for shape in shapes for leaf in slots(shape)), default=-1)
        return self.require(highest < width, where, f"column {highest} of a table with {width} columns is read")

    def one_kind(self, kind: np.ndarray, table: np.ndarray, where: str) -> tuple[int, ...]:
        """Require that each column holds variables of one kind; returns the kinds."""
        if not len(table):
            return ()
        kinds = kind[table]
        for k in range(table.shape[1]):
            self.none(kinds[:, k] != kinds[0, k], f"{where}, column {k}", "variables of several kinds")
        return tuple(kinds[0].tolist())

    def close(self, structure: object) -> None:
        """Raise what has been found.

        Raises
        ------
        CorruptStructureError
        """
        if self.found:
            raise CorruptStructureError(type(structure).__name__, self.found)
