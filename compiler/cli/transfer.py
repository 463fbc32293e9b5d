"""`lmoc transfer INPUT OUTPUT`: transfer function, input–output equation, poles and zeros, plots."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lmoc.cli.arguments import Parser
from lmoc.cli.symbols import add_symbol_arguments, compiled, complex_numbers, number
from lmoc.diagnostics import ModelError

if TYPE_CHECKING:
    from lmoc.symbolic.transfer import InputOutputEquation, TransferFunction


def configure(parser: Parser) -> None:
    add_symbol_arguments(parser)
    add = parser.add_argument
    add("input", metavar="INPUT", help="a top-level input")
    add("output", metavar="OUTPUT", help="any variable")
    add("--bode", metavar="FILE", type=Path, help="draw the frequency response: .png, .svg, .pdf")
    add("--step", metavar="FILE", type=Path, help="draw the response to a unit step")
    add("--latex", action="store_true", help="print LaTeX")
    add("--json", action="store_true", help="print JSON")


def execute(arguments: argparse.Namespace) -> int:
    dae = compiled(arguments)
    found = dae.transfer_function(arguments.input, arguments.output)
    equation = dae.input_output_equation(arguments.input, arguments.output)
    for path, kind in ((arguments.bode, "bode"), (arguments.step, "step")):
        if path is not None:
            from lmoc.report import linear_plots

            getattr(linear_plots, kind)(found, path)
    if arguments.json:
        print(json.dumps(as_data(found, equation), indent=2, ensure_ascii=False))
    elif arguments.latex:
        print(latex(found, equation))
    else:
        print("\n".join(lines(found, equation)))
    return 0


def lines(found: TransferFunction, equation: InputOutputEquation) -> list[str]:
    """Everything in words."""
    from lmoc.symbolic.notation import Notation
    from lmoc.symbolic.styles import UNICODE

    notation = Notation.of(found.numerator, found.denominator, *equation, names=(found.output, found.input))
    top, bottom = (notation.polynomial(e, "s") for e in (found.numerator, found.denominator))
    u, y = notation.name(found.input), notation.name(found.output)
    told = [f"{y}/{u} = {top}/{bottom}" if bottom != "1" else f"{y}/{u} = {top}", "", f"{equation}    (p = d/dt)"]
    if found.cancelled:
        factors = ", ".join(notation.polynomial(f, "s") for f in found.cancelled)
        told += ["", f"cancelled: {factors}  (not seen in {y}, or not moved by {u})"]
    try:
        told += ["", *_numbers(found)]
    except ModelError as error:
        told += ["", error.diagnostics[0].message]
    table = [f"  {UNICODE.symbol(short, 0)}  {full}" for short, full in notation.abbreviations.items()]
    return told + (["", "with", *table] if table else [])


def _numbers(found: TransferFunction) -> list[str]:
    gain = "unbounded" if not np.isfinite(found.gain) else number(found.gain)
    return [
        f"poles: {complex_numbers(found.poles)}",
        f"zeros: {complex_numbers(found.zeros)}",
        f"static gain: {gain}",
    ]


def latex(found: TransferFunction, equation: InputOutputEquation) -> str:
    from lmoc.symbolic.notation import Notation
    from lmoc.symbolic.styles import LATEX

    notation = Notation.of(found.numerator, found.denominator, *equation, names=(found.output, found.input))
    top, bottom = (notation.polynomial(e, "s", LATEX, bare=True) for e in (found.numerator, found.denominator))
    left, right = (notation.polynomial(e, "p", LATEX) for e in equation)
    u, y = notation.name(found.input, LATEX), notation.name(found.output, LATEX)
    return (
        f"\\begin{{align*}}\n  \\frac{{{y}}}{{{u}}} &= \\frac{{{top}}}{{{bottom}}} \\\\\n"
        f"  {left} \\, {y} &= {right} \\, {u}\n\\end{{align*}}"
    )


def as_data(found: TransferFunction, equation: InputOutputEquation) -> dict:
    data = {
        "input": found.input,
        "output": found.output,
        "numerator": str(found.numerator),
        "denominator": str(found.denominator),
        "cancelled": [str(f) for f in found.cancelled],
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
