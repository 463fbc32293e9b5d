"""`lmoc run`: simulate a scene and tell what came out."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from lmoc.cli import process, terminal
from lmoc.cli.arguments import (
    Parser,
    add_model_arguments,
    add_run_arguments,
    add_states_argument,
    choice,
    initial,
    positive,
)
from lmoc.messages.diagnostics import Diagnostic, ModelError, RunInterrupted, SimulationError

if TYPE_CHECKING:
    from lmoc.run import Run

FAILED_RUN = 3


def configure(parser: Parser) -> None:
    from lmoc.numerics.options import FIXED_STEP, SOLVERS, solver_hint

    add_model_arguments(parser)
    add_states_argument(parser)
    add_run_arguments(parser)
    add = parser.add_argument
    add("--rtol", type=positive, metavar="TOL", help="relative tolerance (experiment, else 1e-6)")
    add("--atol", type=positive, metavar="TOL", help="absolute tolerance (rtol/1000 of each variable's nominal value)")
    add("--max-step", type=positive, metavar="S", help="longest step of the integrator (no limit)")
    add("--step", type=positive, metavar="S",
        help=f"length of every step (a thousandth of the run): {', '.join(FIXED_STEP)}; gauss")  # fmt: skip
    add("--solver", type=choice(SOLVERS, solver_hint), metavar="NAME", default="auto", help=", ".join(SOLVERS))
    add("--formulation", metavar="NAME", default="reduced", help="reduced: minimal coordinates")
    add("--keep", metavar="NAME", action="append",
        help="retain only this variable or array (large models); may be repeated")  # fmt: skip
    add("-o", "--output", metavar="FILE", type=Path, help="write the result: .csv, .npz, .parquet, .mat")
    add("--plot", metavar="FILE", type=Path, help="draw the result: .png, .svg, .pdf")
    add("--units", metavar="UNIT,…", help="print and draw in these units, as mm,deg,rpm; files keep SI units")
    add("--quiet", action="store_true", help="print nothing but errors")
    add("--json", action="store_true", help="print the summary as JSON")


def execute(arguments: argparse.Namespace) -> int:
    _check_choices(arguments)
    try:
        run = _simulate(arguments)
    except (SimulationError, RunInterrupted) as failure:
        return _failed(failure, arguments)
    _tell(run, arguments)
    return 0


def _check_choices(arguments: argparse.Namespace) -> None:
    """Refuse what cannot work before time is spent."""
    from lmoc.numerics.options import FORMULATIONS
    from lmoc.report.display import display
    from lmoc.report.files import FORMATS, PICTURES, check_target

    display(arguments.units)

    if arguments.formulation not in FORMULATIONS:
        known = ", ".join(FORMULATIONS)
        message = f"the formulation '{arguments.formulation}' is not available; this version has: {known}"
        raise ModelError([Diagnostic("E0626", message)])
    if arguments.output is not None:
        check_target(arguments.output, tuple(FORMATS))
    if arguments.plot is not None:
        check_target(arguments.plot, PICTURES)


def _simulate(arguments: argparse.Namespace) -> Run:
    from lmoc.cli.progress import Progress
    from lmoc.dae import compile_or_recall

    with Progress(not arguments.quiet) as progress:
        dae = compile_or_recall(
            arguments.file, arguments.model, dict(arguments.set), arguments.states, arguments.path,
            listener=progress.stage,
        )  # fmt: skip
        return dae.simulate(
            arguments.start, arguments.stop, arguments.points, None, arguments.rtol, arguments.atol,
            arguments.solver, arguments.formulation, None, initial(arguments.init), dict(arguments.input),
            keep=arguments.keep, max_step=arguments.max_step, step=arguments.step, listener=progress.stage,
            progress=progress.reached,
        )  # fmt: skip


def _tell(run: Run, arguments: argparse.Namespace) -> None:
    """Diagnostics, files, and the summary, in this order."""
    from lmoc.report.summary import as_data, summary

    if not arguments.quiet:
        terminal.show(run.notes, ("warning",) if arguments.json else ("warning", "note"))
    written = _write(run, arguments)
    if arguments.json:
        print(json.dumps(as_data(run), indent=2, ensure_ascii=False))
    elif not arguments.quiet:
        title, *rest = summary(run, arguments.units).split("\n")
        print("\n".join([terminal.styled(title, "1", sys.stdout), *rest]))
        if written:
            print("\n" + "\n".join(f"{what} written to {path}" for what, path in written))


def _write(run: Run, arguments: argparse.Namespace) -> list[tuple[str, Path]]:
    written = []
    if arguments.output is not None:
        written.append(("result", run.save(arguments.output)))
    if arguments.plot is not None:
        run.plot(path=arguments.plot, units=arguments.units)
        written.append(("picture", arguments.plot))
    return written


def _failed(failure: SimulationError | RunInterrupted, arguments: argparse.Namespace) -> int:
    """The run broke off: keep what there is."""
    run: Run | None = failure.partial
    if run is not None and len(run.time):
        _tell(run, arguments)
    terminal.failure(str(failure))
    if run is not None and arguments.output is not None:
        print(f"        the result until then is in {arguments.output}", file=sys.stderr)
    return process.interruption_code() if isinstance(failure, RunInterrupted) else FAILED_RUN
