"""`lmoc run`: simulate a scene and tell what came out."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from lmoc.cli import process, terminal
from lmoc.cli.arguments import Parser, Range, UsageError
from lmoc.cli.simulation import add_simulation_arguments, check_formulation, ranges_of, simulate, sweep
from lmoc.messages.diagnostics import Diagnostic, RunInterrupted, SimulationError, nearest
from lmoc.support.quoted import split

if TYPE_CHECKING:
    from lmoc.ir.flat import FlatDAE
    from lmoc.run import Run

FAILED_RUN = 3
_MOST_LAWS = 9  # columns of the table of modes; beyond, the list of events tells the same


def configure(parser: Parser) -> None:
    add_simulation_arguments(parser, ranges=True)
    add = parser.add_argument
    add("-o", "--output", metavar="FILE", type=Path, help="write the result: .csv, .npz, .parquet, .mat")
    add("--plot", metavar="FILE", type=Path, help="draw the result: .png, .svg, .pdf")
    add("--show", metavar="NAME,…", help="variables to draw (outputs, else states)")
    add("--phase", metavar="FILE", type=Path, help="draw one variable over another: the two of --show, else two states")
    add("--spectrum", metavar="FILE", type=Path, help="draw the amplitudes over the frequency")
    add("--root-locus", metavar="FILE", type=Path,
        help="draw the eigenvalues of the linear model over the values of --set k=FIRST:STEP:LAST")
    add("--units", metavar="UNIT,…", help="print and draw in these units, as mm,deg,rpm; files keep SI units")
    add("--sensitivity", metavar="NAME,…", default="",
        help="derivatives by these parameters and start values: at the end in the summary, over time in files")
    add("--events", action="store_true", help="list the events, and the modes of laws over time")
    add("--quiet", action="store_true", help="print nothing but errors")
    add("--json", action="store_true", help="print the summary as JSON")


def execute(arguments: argparse.Namespace) -> int:
    _check_choices(arguments)
    values = ranges_of(arguments)
    if values:
        return _study(arguments, values)
    try:
        run = simulate(arguments, bool(arguments.sensitivity), partial(_found, arguments=arguments))
    except (SimulationError, RunInterrupted) as failure:
        return _failed(failure, arguments)
    _tell(run, arguments)
    return 0


def _study(arguments: argparse.Namespace, values: Mapping[str, tuple[float, ...]]) -> int:
    """Several runs: a table of them, and a picture with their curves over each other."""
    from lmoc.report.summary import plain
    from lmoc.support.replacing import replace_file

    if arguments.output is not None and arguments.output.suffix.lower() != ".csv":
        hint = "-o study.csv"
        raise UsageError([Diagnostic("E0624", "the table of several runs is written as .csv alone", hint=hint)])
    found = sweep(arguments, values, partial(_found, arguments=arguments))
    table = found.to_dataframe()
    written = []
    if arguments.output is not None:
        try:
            replace_file(arguments.output, lambda target: table.to_csv(target, index=False))
        except OSError as error:
            message = f"'{arguments.output}' cannot be written: {error.strerror or error}"
            raise UsageError([Diagnostic("E0623", message)]) from None
        written.append(f"table written to {arguments.output}")
    if arguments.plot is not None:
        found.plot(_names(arguments), path=arguments.plot, units=arguments.units)
        written.append(f"picture written to {arguments.plot}")
    if arguments.root_locus is not None:
        found.root_locus(arguments.root_locus)
        written.append(f"root locus written to {arguments.root_locus}")
    if arguments.json:
        print(json.dumps(plain(table.to_dict("records")), indent=2, ensure_ascii=False))
    elif not arguments.quiet:
        print("\n".join([f"{found.runs[0].flat.name}: {len(found)} runs", "", table.to_string(index=False), *written]))
    for point, why in found.failed.items():
        given = ", ".join(f"{name} = {value:g}" for name, value in zip(found.names, point, strict=True))
        terminal.failure(f"{given}: {why}")
    return 0 if all(run.complete for run in found.runs) else FAILED_RUN


def _check_choices(arguments: argparse.Namespace) -> None:
    """Refuse what cannot work before time is spent."""
    from lmoc.report.display import display
    from lmoc.report.files import ENDINGS, check_target

    display(arguments.units)

    check_formulation(arguments)
    if arguments.output is not None:
        check_target(arguments.output, ENDINGS)
    _check_pictures(arguments)


def _check_pictures(arguments: argparse.Namespace) -> None:
    """Refuse pictures that cannot be drawn."""
    from lmoc.report.files import PICTURES, check_target

    for picture in (arguments.plot, arguments.phase, arguments.spectrum, arguments.root_locus):
        if picture is not None:
            check_target(picture, PICTURES)
    several = any(isinstance(given, Range) for _, given in arguments.set)
    if several and arguments.sensitivity:
        hint = "lmoc study --sample gives the dependence over a range"
        raise UsageError([Diagnostic("E0620", "--sensitivity is for one value of each parameter", hint=hint)])
    wrong = {"--root-locus": not several and arguments.root_locus, "--phase": several and arguments.phase}
    wrong["--spectrum"] = several and arguments.spectrum
    for option in (name for name, given in wrong.items() if given):
        expected = "a parameter with several values" if option == "--root-locus" else "one value of each parameter"
        hint = "--set k=10:10:50" if option == "--root-locus" else None
        raise UsageError([Diagnostic("E0620", f"{option} is for {expected}", hint=hint)])
    names = _names(arguments)
    if arguments.phase is not None and names is None and arguments.keep is not None:
        message = "--phase draws the states by default, and --keep may have dropped them"
        raise UsageError([Diagnostic("E0620", message, hint="--phase phase.svg --show body.q,body.v")])
    if arguments.phase is not None and names is not None and len(names) != 2:
        message = f"--phase draws one variable over another, not {len(names)}"
        raise UsageError([Diagnostic("E0620", message, hint="--phase phase.svg --show body.q,body.v")])


def _tell(run: Run, arguments: argparse.Namespace) -> None:
    """Diagnostics, files, and the summary, in this order."""
    from lmoc.report.summary import as_data, plain, summary

    if not arguments.quiet:
        terminal.show(run.notes, ("warning",) if arguments.json else ("warning", "note"))
    written = _write(run, arguments)
    if arguments.json:
        more = {"sensitivities": plain(run.final_sensitivities)} if run.final_sensitivities else {}
        print(json.dumps(as_data(run) | more, indent=2, ensure_ascii=False))
    elif not arguments.quiet:
        title, *rest = summary(run, arguments.units).split("\n")
        print("\n".join([terminal.styled(title, "1", sys.stdout), *rest]))
        if arguments.events:
            print(_events(run))
        if run.final_sensitivities:
            print(_sensitivities(run))
        if written:
            print("\n" + "\n".join(f"{what} written to {path}" for what, path in written))


def _events(run: Run) -> str:
    """The events of a run, and the modes of its laws, as tables."""
    from lmoc.cli.symbols import table
    from lmoc.report.events import event_rows, modes_rows

    modes = modes_rows(run.modes)
    wide = not modes or len(modes[0]) > _MOST_LAWS
    tables = [("events", event_rows(run.events)), ("modes", [] if wide else modes)]
    shown = [f"\n{title}\n{table(rows)}" for title, rows in tables if len(rows) > 1]
    return "\n".join(shown) or "\nno events"


def _sensitivities(run: Run) -> str:
    """The derivatives at the end as a table."""
    from lmoc.cli.symbols import number, table

    found = run.final_sensitivities
    rows = [[name, *map(number, own.values())] for name, own in found.items()]
    head = [f"derivatives at t = {run.time[-1]:g} s", *(f"by {name}" for name in next(iter(found.values())))]
    return f"\n{table(rows, head)}"


def _write(run: Run, arguments: argparse.Namespace) -> list[tuple[str, Path]]:
    written = []
    if arguments.output is not None:
        written.append(("result", run.save(arguments.output)))
    names = _names(arguments)
    if arguments.plot is not None:
        run.plot(names, path=arguments.plot, units=arguments.units)
        written.append(("picture", arguments.plot))
    if arguments.phase is not None:
        if names is None and len(run.states) < 2:
            raise UsageError([Diagnostic("E0620", "--phase: the run has no two states", hint="--show NAME,NAME")])
        run.phase(*(names or ()), path=arguments.phase)
        written.append(("phase portrait", arguments.phase))
    if arguments.spectrum is not None:
        run.spectrum(names, arguments.spectrum)
        written.append(("spectrum", arguments.spectrum))
    return written


def _found(flat: FlatDAE, arguments: argparse.Namespace) -> None:
    """Refuse variables to draw that the model does not have, or that the run does not keep."""
    from lmoc.numerics.observe.recorder import is_kept

    keep = arguments.keep
    for name in _names(arguments) or ():
        if flat.find(name) is None:
            hint = nearest(name, [block.pattern for block in flat.blocks]) or None
            raise UsageError([Diagnostic("E0622", f"there is no variable '{name}'", hint=hint)])
        if keep is not None and not is_kept(flat, name, keep):
            message = f"'{name}' cannot be drawn: of this run only {', '.join(keep)} are kept"
            raise UsageError([Diagnostic("E0622", message, hint=f"--keep {name}")])


def _names(arguments: argparse.Namespace) -> list[str] | None:
    """The variables to draw; None for those that a picture chooses."""
    return None if arguments.show is None else [name.strip() for name in split(arguments.show, ",") if name.strip()]


def _failed(failure: SimulationError | RunInterrupted, arguments: argparse.Namespace) -> int:
    """The run broke off: keep what there is."""
    run: Run | None = failure.partial
    if run is not None and len(run.time):
        _tell(run, arguments)
    terminal.failure(str(failure))
    if run is not None and arguments.output is not None:
        print(f"        the result until then is in {arguments.output}", file=sys.stderr)
    return process.interruption_code() if isinstance(failure, RunInterrupted) else FAILED_RUN
