"""Functions shared by the verbs for equations, equilibria, linear models and transfer functions."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from lmoc.cli import terminal
from lmoc.cli.arguments import Parser, UsageError, add_model_arguments, add_states_argument, assignment, ordinal
from lmoc.cli.arguments import number as float_number
from lmoc.messages.diagnostics import Diagnostic

if TYPE_CHECKING:
    import numpy as np

    from lmoc.interface import DAE


def add_symbol_arguments(parser: Parser) -> None:
    add_model_arguments(parser)
    add_states_argument(parser)


def add_place_arguments(parser: Parser) -> None:
    """--at and --equilibrium: where to be linear."""
    add = parser.add_argument
    add("--at", metavar="TIME|NAME=VALUE", action="append", default=[],
        help="a time of the default run, or values of states and inputs; by default the equilibrium")
    add("--equilibrium", metavar="N", type=ordinal, help="the N-th of those that `lmoc equilibria` lists")


def place(dae: DAE, arguments: argparse.Namespace, inputs: Mapping[str, float]) -> float | Mapping | None:
    """Return the point given by `--at` and `--equilibrium`: a time, a point by names, or None."""
    given: list[str] = arguments.at
    if arguments.equilibrium is not None:
        if given:
            raise UsageError([Diagnostic("E0620", "--at and --equilibrium exclude each other")])
        return listed(dae, arguments.equilibrium, inputs)
    if not given:
        return None
    if len(given) == 1 and "=" not in given[0]:
        try:
            return float_number(given[0])
        except argparse.ArgumentTypeError:
            message = f"--at: '{given[0]}' is neither a time nor name=value"
            raise UsageError([Diagnostic("E0621", message)]) from None
    try:
        return dict(assignment(float_number)(text) for text in given)
    except argparse.ArgumentTypeError as error:
        raise UsageError([Diagnostic("E0621", f"--at: {error}")]) from None


def listed(dae: DAE, n: int, inputs: Mapping[str, float]) -> Mapping:
    """The n-th equilibrium for the inputs given, others at zero."""
    found = dae.equilibria(inputs={u: 0.0 for u in dae.inputs} | dict(inputs))
    if n > len(found):
        count = {0: "none was", 1: "one was"}.get(len(found), f"{len(found)} were")
        raise UsageError([Diagnostic("E0663", f"there is no equilibrium {n}: {count} found")])
    return found[n - 1]


def compiled(arguments: argparse.Namespace) -> DAE:
    """The scene of the command line; its warnings are printed."""
    from lmoc.cli import scene
    from lmoc.cli.progress import Progress

    with Progress() as progress:
        dae = scene.compiled(arguments, progress)
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
    return f"{value + 0.0:.6g}"  # no −0


def complex_number(value: complex, paired: bool = False) -> str:
    """``-1 + 3i``; with its conjugate, ``-1 ± 3i``."""
    value = _without_rounding(value)
    if value.imag == 0:
        return number(value.real)
    sign = "±" if paired else "-" if value.imag < 0 else "+"
    size = number(abs(value.imag))
    if value.real:
        return f"{number(value.real)} {sign} {size}i"
    return f"{sign.replace('+', '')}{size}i"


def _without_rounding(value: complex) -> complex:
    """The number, without a part that is rounding only."""
    small = 1e-12 * abs(value)
    return complex(0.0 if abs(value.real) < small else value.real, 0.0 if abs(value.imag) < small else value.imag)


def complex_numbers(values: Iterable[complex], most: int = 12) -> str:
    """Listed, the two of a pair as one."""
    import numpy as np

    listed = np.array(list(values), complex)
    texts = []
    for value in listed.tolist():
        paired = bool(np.any(np.abs(value.conjugate() - listed) <= 1e-9 * abs(value)))
        if value.imag >= 0 or not paired:
            texts.append(complex_number(value, paired and value.imag > 0))
    return names(texts, most) or "none"


def matrix(title: str, values: np.ndarray, rows: Iterable[str], columns: Iterable[str]) -> str:
    """A matrix with names at its rows and columns."""
    body = [[name, *(number(v) for v in row)] for name, row in zip(rows, values.tolist(), strict=True)]
    return table(body, [title, *columns]) if body else f"{title}: empty"
