"""`lmoc compare`: run several scenes, and compare their results."""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, cast

from lmoc.cli import process, terminal
from lmoc.cli.arguments import Parser, UsageError
from lmoc.cli.simulation import add_simulation_arguments, check_formulation, simulate
from lmoc.messages.diagnostics import Diagnostic, RunInterrupted, SimulationError, nearest
from lmoc.support.quoted import split

if TYPE_CHECKING:
    from lmoc.ir.flat import FlatDAE
    from lmoc.report.compare import Comparison
    from lmoc.run import Run

FAILED_RUN = 3


def configure(parser: Parser) -> None:
    add_simulation_arguments(parser)
    add = parser.add_argument
    add("others", metavar="OTHER", nargs="+", help="the scenes that are compared with the first")
    add("--plot", metavar="FILE", type=Path, help="draw the runs over each other: .png, .svg, .pdf")
    add("--show", metavar="NAME,…", help="variables to compare (by default those of the first scene that all have)")
    add("--units", metavar="UNIT,…", help="draw in these units, as mm,deg,rpm")
    add("--quiet", action="store_true", help="print nothing but errors")
    add("--json", action="store_true", help="print the differences as JSON")


def execute(arguments: argparse.Namespace) -> int:
    from lmoc.report.compare import compare
    from lmoc.report.display import display
    from lmoc.report.files import PICTURES, check_target

    check_formulation(arguments)
    display(arguments.units)
    if arguments.plot is not None:
        check_target(arguments.plot, PICTURES)
    names = None if arguments.show is None else [n.strip() for n in split(arguments.show, ",") if n.strip()]
    files, code = [arguments.file, *arguments.others], 0
    runs: dict[str, Run] = {}
    for label, file in zip(labels(files), files, strict=True):
        one = argparse.Namespace(**vars(arguments) | {"file": file})
        try:
            runs[label] = simulate(one, check=partial(_check_names, file=file, names=names or ()))
        except (SimulationError, RunInterrupted) as failure:
            terminal.failure(f"{file}: {failure}")
            if isinstance(failure, RunInterrupted):
                return process.interruption_code()
            code, partial_run = FAILED_RUN, cast("Run | None", failure.partial)
            if partial_run is not None and len(partial_run.time):
                runs[label] = partial_run
    if len(runs) > 1:
        _tell(compare(runs), names, arguments)
    return code


def labels(files: Sequence[str]) -> list[str]:
    """Return a name for each file: its own without the ending, the whole path where two are called the same."""
    stems = [Path(file).stem for file in files]
    paths, count = Counter(files), Counter(stems)
    found = [stem if count[stem] == 1 else file for stem, file in zip(stems, files, strict=True)]
    return [f"{text} ({k})" if paths[files[k - 1]] > 1 else text for k, text in enumerate(found, 1)]


def _check_names(flat: FlatDAE, file: str, names: Sequence[str]) -> None:
    """Refuse variables to compare that a scene does not have."""
    for name in names:
        if flat.find(name) is None:
            hint = nearest(name, [block.pattern for block in flat.blocks]) or None
            raise UsageError([Diagnostic("E0622", f"{file} has no variable '{name}'", hint=hint)])


def _tell(found: Comparison, names: list[str] | None, arguments: argparse.Namespace) -> None:
    """Print the largest differences, and draw the curves."""
    from lmoc.report.summary import plain

    try:
        shown = found.names(names)
    except ValueError as error:
        raise UsageError([Diagnostic("E0622", str(error), hint="--show NAME,NAME")]) from None
    if arguments.plot is not None:
        found.plot(shown, path=arguments.plot, units=arguments.units)
    table = found.differences(shown).reset_index()
    if arguments.json:
        print(json.dumps(plain(table.to_dict("records")), indent=2, ensure_ascii=False))
    elif not arguments.quiet:
        print(f"differences from {next(iter(found.runs))}, at its output times\n\n{table.to_string(index=False)}")
        if arguments.plot is not None:
            print(f"\npicture written to {arguments.plot}")
