"""`lmoc transfer INPUT OUTPUT`: transfer function, input–output equation, poles and zeros, plots."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lmoc.cli.arguments import Parser
from lmoc.cli.progress import working
from lmoc.cli.symbols import add_place_arguments, add_symbol_arguments, compiled, complex_numbers, number, place
from lmoc.messages.diagnostics import ModelError

if TYPE_CHECKING:
    from lmoc.interface import DAE
    from lmoc.symbolic.notation import Notation
    from lmoc.symbolic.transfer import TransferFunction


def configure(parser: Parser) -> None:
    add_symbol_arguments(parser)
    add = parser.add_argument
    add("input", metavar="INPUT", help="a top-level input")
    add("output", metavar="OUTPUT", help="any variable")
    add("--bode", metavar="FILE", type=Path, help="draw the frequency response: .png, .svg, .pdf")
    add("--hertz", action="store_true", help="with --bode: over the frequency in Hz")
    add("--decibels", action="store_true", help="with --bode: the amplitude in dB")
    add("--step", metavar="FILE", type=Path, help="draw the response to a unit step")
    add_place_arguments(parser)
    add = parser.add_mutually_exclusive_group().add_argument
    add("--latex", action="store_true", help="print LaTeX")
    add("--json", action="store_true", help="print JSON")


def execute(arguments: argparse.Namespace) -> int:
    dae = compiled(arguments)
    with working("transfer function"):
        found = dae.transfer_function(arguments.input, arguments.output, at=place(dae, arguments, {}))
    _draw(found, dae, arguments)
    if arguments.json:
        print(json.dumps(as_data(found), indent=2, ensure_ascii=False))
    else:
        print(latex(found) if arguments.latex else "\n".join(lines(found)))
    return 0


def _draw(found: TransferFunction, dae: DAE, arguments: argparse.Namespace) -> None:
    for path, kind in ((arguments.bode, "bode"), (arguments.step, "step")):
        if path is not None:
            from lmoc.report import linear_plots
            from lmoc.report.units import unit_of

            units = tuple(unit_of(dae.reduced, name) for name in (arguments.input, arguments.output))
            scales = {"hertz": arguments.hertz, "decibels": arguments.decibels} if kind == "bode" else {}
            getattr(linear_plots, kind)(found, path, dae.name, units, **scales)


def lines(found: TransferFunction) -> list[str]:
    """Everything in words."""
    from lmoc.symbolic.styles import UNICODE

    notation, shown = _notation(found), found.short or found
    u, y = notation.name(found.input), notation.name(found.output)
    quotient = notation.quotient(shown.numerator, shown.denominator, "s")
    equation = shown.input_output_equation.write(notation, UNICODE)
    lines = [f"{y}/{u} = {quotient}", "", f"{equation}    (p = d/dt)"]
    if found.loops is not None:
        lines = ["linear about the state of rest below", "", *lines]
    elif found.point:
        place = ", ".join(f"{notation.name(n)} = {notation.text(v)}" for n, v in found.point.items())
        lines = [f"linear about {place}", "", *lines]
    if shown.cancelled:
        factors = ", ".join(notation.polynomial(f, "s") for f in shown.cancelled)
        lines += ["", f"cancelled: {factors}  (not seen in {y}, or not moved by {u})"]
    try:
        lines += ["", *_numbers(found)]
    except ModelError as error:
        lines += ["", error.diagnostics[0].message]
    explained = [] if found.loops is None else ["", *found.loops.lines(notation)]
    return [*lines, *explained, *notation.legend()]


def _numbers(found: TransferFunction) -> list[str]:
    gain = "unbounded" if not np.isfinite(found.gain) else number(found.gain)
    return [
        f"poles: {complex_numbers(found.poles)}",
        f"zeros: {complex_numbers(found.zeros)}",
        f"static gain: {gain}",
    ]


def _notation(found: TransferFunction) -> Notation:
    from lmoc.symbolic.notation import Notation

    names = (found.output, found.input, *found.point)
    if found.loops is not None:
        return found.loops.notation(found.short.numerator, found.short.denominator, names=names)
    return Notation.of(found.numerator, found.denominator, *found.point.values(), names=names)


def latex(found: TransferFunction) -> str:
    from lmoc.symbolic.styles import LATEX

    notation, shown = _notation(found), found.short or found
    u, y = notation.name(found.input, LATEX), notation.name(found.output, LATEX)
    quotient = notation.quotient(shown.numerator, shown.denominator, "s", LATEX)
    equation = shown.input_output_equation.write(notation, LATEX).replace(" = ", " &= ", 1)
    return f"\\begin{{align*}}\n  \\frac{{{y}}}{{{u}}} &= {quotient} \\\\\n  {equation}\n\\end{{align*}}"


def as_data(found: TransferFunction) -> dict:
    equation = found.input_output_equation
    data = {
        "input": found.input,
        "output": found.output,
        "numerator": str(found.numerator),
        "denominator": str(found.denominator),
        "cancelled": [str(f) for f in found.cancelled],
        "about": {name: str(value) for name, value in found.point.items()},
        "left": str(equation.left),
        "right": str(equation.right),
    }
    try:
        top, bottom = found.coefficients
    except ModelError:
        return data
    roots = {"poles": found.poles, "zeros": found.zeros}
    roots = {name: [[v.real, v.imag] for v in values.astype(complex).tolist()] for name, values in roots.items()}
    return data | {"numerator_numbers": top.tolist(), "denominator_numbers": bottom.tolist()} | roots
