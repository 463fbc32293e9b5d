"""Lines and columns of printed structures."""

from __future__ import annotations

from collections.abc import Sequence

WIDTH = 160  # characters after which an equation is cut


def aligned(rows: Sequence[Sequence[str]], lead: str = "  ") -> list[str]:
    """Return rows of cells in columns; a column that is empty throughout is left out."""
    columns = [c for c in zip(*rows, strict=True) if any(c)]
    widths = [min(max(map(len, column)), 48) for column in columns]
    cells = zip(*columns, strict=True)
    return [lead + "  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip() for row in cells]


def cut(text: str) -> str:
    """Return a line, cut where it is longer than `WIDTH`."""
    return text if len(text) <= WIDTH else text[: WIDTH - 2] + " …"
