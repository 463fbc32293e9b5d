"""What the verbs for equations, equilibria, linear models and transfer functions share."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from typing import TYPE_CHECKING

from lmoc.cli import terminal
from lmoc.cli.arguments import Parser, add_model_arguments

if TYPE_CHECKING:
    import numpy as np

    from lmoc.dae import DAE


def add_symbol_arguments(parser: Parser) -> None:
    add_model_arguments(parser)
    parser.add_argument(
        "--states", metavar="NAME,…", help="coordinates to prefer, separated by commas", default=None,
        type=lambda text: [name.strip() for name in text.split(",") if name.strip()],
    )  # fmt: skip


def compiled(arguments: argparse.Namespace) -> DAE:
    """The scene of the command line; its warnings are told."""
    from lmoc.dae import compile

    dae = compile(arguments.file, arguments.model, dict(arguments.set), arguments.states)
    terminal.show(dae.notes, ("warning",))
    return dae


def names(items: Iterable[str], most: int = 6) -> str:
    listed = list(items)
    return ", ".join(listed[:most]) + (f" … ({len(listed)} in all)" if len(listed) > most else "")


def table(rows: Iterable[Iterable[str]], head: Iterable[str] | None = None) -> str:
    """Columns of text, the first flush left, the others flush right."""
    lines = [list(row) for row in ([head] if head else []) + list(rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(lines[0]))] if lines else []
    return "\n".join(
        "  ".join([line[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(line[1:], widths[1:], strict=True))]).rstrip()
        for line in lines
    )


def number(value: float) -> str:
    return f"{value:.6g}"


def complex_number(value: complex) -> str:
    """The number, without a part that is rounding only."""
    small = 1e-12 * abs(value)
    value = complex(0.0 if abs(value.real) < small else value.real, 0.0 if abs(value.imag) < small else value.imag)
    if value.imag == 0:
        return number(value.real)
    return f"{number(value.real)} {'-' if value.imag < 0 else '+'} {number(abs(value.imag))}i"


def complex_numbers(values: Iterable[complex]) -> str:
    """Listed, with the two of a pair as one: ``-1 ± 3i``."""
    values = list(values)
    told = []
    for value in values:
        paired = any(abs(value.conjugate() - other) <= 1e-9 * abs(value) for other in values)
        if value.imag > 0 and paired:
            told.append(f"{number(value.real)} ± {number(value.imag)}i" if value.real else f"±{number(value.imag)}i")
        elif value.imag == 0 or not paired:
            told.append(complex_number(value))
    return ", ".join(told) or "none"


def matrix(title: str, values: np.ndarray, rows: Iterable[str], columns: Iterable[str]) -> str:
    """A matrix with names at its rows and columns."""
    body = [[name, *(number(v) for v in row)] for name, row in zip(rows, values.tolist(), strict=True)]
    return table(body, [title, *columns]) if body else f"{title}: empty"
