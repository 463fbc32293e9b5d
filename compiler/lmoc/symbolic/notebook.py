"""HTML for notebooks: matrices with names at their rows and columns, tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

import numpy as np

MOST_SHOWN = 12  # states, inputs or outputs of a model whose matrices are shown

Named = tuple[str, Any, Sequence[str], Sequence[str]]  # title, numpy or sympy matrix, names of rows, of columns


def matrices_html(title: str, matrices: Iterable[Named]) -> str:
    """Return HTML of a title and of the matrices that are not zero."""
    return f"<p><b>{escape(title)}</b></p>" + "".join(_table(*named) for named in matrices)


def table_html(title: str, head: Sequence[str], rows: Iterable[Sequence[object]], more: int = 0) -> str:
    """Return HTML of a title and a table; numbers with six digits.

    Parameters
    ----------
    more : number of rows that are left out
    """
    def cell(value: object) -> str:
        return f"<td>{f'{value:.6g}' if isinstance(value, float) else escape(str(value))}</td>"

    top = "".join(f"<th>{escape(name)}</th>" for name in head)
    body = "".join(f"<tr>{''.join(map(cell, row))}</tr>" for row in rows)
    rest = f"<p>and {more} more</p>" if more > 0 else ""
    return f"<p><b>{escape(title)}</b></p><table><tr>{top}</tr>{body}</table>{rest}"


def _table(title: str, matrix: Any, rows: Sequence[str], columns: Sequence[str]) -> str:
    """A matrix with names at its rows and columns; nothing where all of it is zero."""
    entries = matrix.tolist()
    if not any(e != 0 for row in entries for e in row):
        return ""
    numeric = isinstance(matrix, np.ndarray)
    head = "".join(f"<th>{escape(name)}</th>" for name in columns)
    body = "".join(
        f"<tr><th>{escape(name)}</th>"
        + "".join(f"<td>{f'{e:.6g}' if numeric else escape(str(e))}</td>" for e in row)
        + "</tr>"
        for name, row in zip(rows, entries, strict=True)
    )
    return f"<table><tr><th>{title}</th>{head}</tr>{body}</table>"
