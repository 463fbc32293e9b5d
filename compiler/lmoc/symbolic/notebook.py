"""What a notebook shows of a linear model."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from lmoc.symbolic.linearize import LinearModel, Matrix

_MOST_SHOWN = 12  # states, inputs or outputs of a model whose matrices are shown


def linear_model(model: LinearModel) -> str:
    """HTML of what there is and, of a small model, the matrices that are not zero."""
    title = f"<p><b>{escape(repr(model).strip('<>'))}</b></p>"
    if max(len(model.states), len(model.inputs), len(model.outputs)) > _MOST_SHOWN:
        return title
    shown = [_table("A", model.A, model.states, model.states)]
    shown += [_table(f"B{k or ''}", B, model.states, _jets(model, k)) for k, B in enumerate(model.Bs)]
    shown += [_table("C", model.C, model.outputs, model.states)]
    shown += [_table(f"D{k or ''}", D, model.outputs, _jets(model, k)) for k, D in enumerate(model.Ds)]
    return title + "".join(shown)


def _jets(model: LinearModel, order: int) -> list[str]:
    """Names of the inputs' derivatives of an order."""
    return ["der(" * order + u + ")" * order for u in model.inputs]


def _table(title: str, matrix: Matrix, rows: Sequence[str], columns: Sequence[str]) -> str:
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
