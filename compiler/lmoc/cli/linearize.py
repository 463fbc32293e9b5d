"""`lmoc linearize`: the linear state-space model, its modes, and files for other tools."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lmoc.cli.arguments import Parser, UsageError, assignment, number
from lmoc.cli.progress import working
from lmoc.cli.symbols import (
    add_place_arguments,
    add_symbol_arguments,
    compiled,
    complex_number,
    matrix,
    place,
    table,
)
from lmoc.cli.symbols import number as shown
from lmoc.messages.diagnostics import Diagnostic

if TYPE_CHECKING:
    from lmoc.symbolic.linearize import LinearModel


MOST_SHOWN = 20  # states of a model whose matrices are printed, and modes in the table
MOST_COLUMNS = 8  # coordinates in the table of modes


def configure(parser: Parser) -> None:
    add_symbol_arguments(parser)
    add = parser.add_argument
    add_place_arguments(parser)
    add("--input", type=assignment(number), metavar="U=VALUE", action="append", default=[],
        help="constant value of an input at the equilibrium; may be repeated")  # fmt: skip
    add("--output", metavar="NAME", action="append", default=[], help="a variable as output; may be repeated")
    add("--symbolic", action="store_true", help="matrices in symbols")
    add("--realization", action="store_true", help="change the states so that no input's derivative acts on them")
    add("-o", "--write", metavar="FILE", type=Path, help="write the matrices: .mat or .npz")
    add("--plot", metavar="FILE", type=Path, help="draw the eigenvalues and the shapes of the modes: .png, .svg, .pdf")
    add("--json", action="store_true", help="print JSON")


def execute(arguments: argparse.Namespace) -> int:
    _check_targets(arguments)
    dae = compiled(arguments)
    inputs = dict(arguments.input)
    with working("linearize"):
        at = place(dae, arguments, inputs)
        model = dae.linearize(at, arguments.symbolic, inputs, arguments.output or None)
        shifted = arguments.realization and any(np.any(B) for B in model.Bs[1:])
        model = model.realization() if arguments.realization else model
        _write(model, dae.name, arguments)  # where the text is refused, since eigenvalues are lost, there are files
        if arguments.json:
            text = json.dumps(as_data(model), indent=2, ensure_ascii=False)
        else:
            text = _symbols(model) if model.symbolic else _numbers(model)  # with eigenvalues, which take their time
    if not arguments.json:
        moment = f"at t = {shown(at)} s " if isinstance(at, float) and model.time is None else ""
        print(f"{dae.name}: linear model {moment}{_about(model)}")
        if shifted:
            print("its states are those of the scene less B1·u: no input's derivative acts on them")
        print()
    print(text)
    return 0


def _check_targets(arguments: argparse.Namespace) -> None:
    """Refuse what cannot be written before work is spent."""
    from lmoc.report.files import PICTURES, check_target

    targets = [(arguments.write, (".mat", ".npz")), (arguments.plot, PICTURES)]
    for path, endings in targets:
        if path is None:
            continue
        if arguments.symbolic:
            raise UsageError([Diagnostic("E0620", "a file holds numbers: leave --symbolic out, or use --json")])
        check_target(path, endings)


def _write(model: LinearModel, name: str, arguments: argparse.Namespace) -> None:
    try:
        if arguments.write is not None:
            model.save(arguments.write)
        if arguments.plot is not None:
            from lmoc.report.mode_plots import modes

            modes(model, arguments.plot, name)
    except OSError as error:
        message = f"'{error.filename or arguments.write}' cannot be written: {error.strerror or error}"
        raise UsageError([Diagnostic("E0623", message)]) from None


def _about(model: LinearModel) -> str:
    if model.loops is not None:
        return "about the state of rest below"
    if model.symbolic:
        values = [f"{n} = {v}" for n, v in model.point.items() if v != 0 and str(v) != n]
        return f"about {', '.join(values)}" if values else "in symbols"
    values = [f"{n} = {shown(float(v))}" for n, v in model.point.items() if v != 0]
    if len(values) > 8:
        values = [*values[:8], "…"]
    place = ", ".join(values) if values else "zero"
    moment = "" if model.time is None else f"at t = {model.time:g} s "
    remarks = [] if model.time is None else ["the equations depend on time: --at TIME selects another moment"]
    if not model.at_rest:
        remarks.append("no equilibrium: the model describes deviations from the motion through this point")
    return f"{moment}about {place}" + "".join(f"\n  {remark}" for remark in remarks)


def _numbers(model: LinearModel) -> str:
    if len(model.states) > MOST_SHOWN:
        count = f"{len(model.states)} states: the matrices can be written with -o FILE or --json"
        return f"{count}\n\n{_modes(model)}"
    parts = [matrix("A", model.A, model.states, model.states)] if model.states else []
    if model.inputs and model.states:
        parts.append(matrix("B", model.B, model.states, model.inputs))
    parts += _of_derivatives("B", model.Bs, model.states, model.inputs)
    if model.states:
        parts.append(matrix("C", model.C, model.outputs, model.states))
    if model.inputs and np.any(model.D != 0):
        parts.append(matrix("D", model.D, model.outputs, model.inputs))
    parts += _of_derivatives("D", model.Ds, model.outputs, model.inputs)
    return "\n\n".join([*parts, _modes(model)])


def _of_derivatives(title: str, matrices: tuple, rows: list[str], inputs: list[str]) -> list[str]:
    """Return the effect of the inputs' derivatives, where there is any: B1, B2, …"""
    return [
        matrix(f"{title}{k}", m, rows, ["der(" * k + u + ")" * k for u in inputs])
        for k, m in enumerate(matrices)
        if k > 0 and np.any(m != 0)
    ]


def _modes(model: LinearModel) -> str:
    """Eigenvalues, frequencies, damping, and the shape of each mode in the coordinates."""
    rows = []
    places = [q for q, _ in model.coordinates] or list(range(len(model.states)))
    places = places if len(places) <= MOST_COLUMNS else []
    head = ["eigenvalue", "rad/s", "Hz", "damping", *(model.states[q] for q in places)]
    for i, value in enumerate(model.eigenvalues):
        if value.imag < 0:
            continue
        damping = model.dampings[i]
        mode = model.modes[places, i] if places else []
        rows.append(
            [
                complex_number(value, paired=value.imag > 0),
                shown(abs(value)),
                shown(abs(value) / (2 * np.pi)),
                "–" if np.isnan(damping) else shown(0.0 if abs(damping) < 1e-12 else damping),
                *(complex_number(np.round(m, 6)) for m in mode),
            ]
        )
    more = [f"… {len(rows) - MOST_SHOWN} more"] if len(rows) > MOST_SHOWN else []
    if not rows:
        return "no states: the outputs follow the inputs at once"
    return "\n".join([table(rows[:MOST_SHOWN], head), *more, "", f"the linear model is {model.stability}"])


def _symbols(model: LinearModel) -> str:
    from lmoc.symbolic.notation import Notation

    loops = model.loops
    model = model.short or model
    named = [("A", model.A, 0), *(("B", m, k) for k, m in enumerate(model.Bs))]
    named += [("C", model.C, 0), *(("D", m, k) for k, m in enumerate(model.Ds))]
    named = [(title, m, k) for title, m, k in named if m.rows and m.cols and (k == 0 or any(m))]
    entries = [e for _, m, _ in named for e in m]
    shown = (*model.states, *model.inputs, *model.outputs)
    notation = Notation.of(*entries, names=shown) if loops is None else loops.notation(*entries, names=shown)
    parts = []
    for title, m, k in named:
        rows = model.states if title in "AB" else model.outputs
        columns = model.states if title in "AC" else ["der(" * k + u + ")" * k for u in model.inputs]
        body = [[notation.name(r), *(notation.text(m[i, j]) for j in range(m.cols))] for i, r in enumerate(rows)]
        parts.append(table(body, [f"{title}{k or ''}", *(notation.name(c) for c in columns)]))
    explained = [] if loops is None else ["", *loops.lines(notation)]
    return "\n".join(["\n\n".join(parts), *explained, *notation.legend()])


def as_data(model: LinearModel) -> dict:
    """A linear model as plain data; matrices in symbols as text."""

    from lmoc.report.summary import plain

    def shown(m):
        return [[str(e) for e in row] for row in m.tolist()] if model.symbolic and m is not None else m

    data = {"states": list(model.states), "inputs": list(model.inputs), "outputs": list(model.outputs)}
    data |= {k: shown(getattr(model, k)) for k in ("A", "B", "C", "D", "Bd", "Dd")}
    data |= {"B_by_order": [shown(m) for m in model.Bs], "D_by_order": [shown(m) for m in model.Ds]}
    if model.loops is not None:
        data["loops"] = {
            "closures": [str(g) for g in model.loops.closures],
            "balance": [str(e) for e in model.loops.balance],
            "numbers": {s.name: v for s, v in model.loops.numbers.items() if s not in model.loops.shorthand},
        }
    data["point"] = {name: str(v) if model.symbolic else float(v) for name, v in model.point.items()}
    if not model.symbolic:
        data["eigenvalues"] = [[v.real, v.imag] for v in model.eigenvalues.tolist()]
        data |= {"frequencies": model.frequencies, "dampings": model.dampings, "stability": model.stability}
    return plain(data)
