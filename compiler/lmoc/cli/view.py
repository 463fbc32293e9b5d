"""`lmoc view`: a page in which the scene moves and can be played with."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from lmoc.cli import process, terminal
from lmoc.cli.arguments import Parser
from lmoc.cli.simulation import add_simulation_arguments, check_formulation, simulate
from lmoc.messages.diagnostics import RunInterrupted, SimulationError

if TYPE_CHECKING:
    from lmoc.run import Run

FAILED_RUN = 3


def configure(parser: Parser) -> None:
    add_simulation_arguments(parser)
    add = parser.add_argument
    add("-o", "--output", metavar="FILE", type=Path, required=True, help="the page: .html")
    add("--quiet", action="store_true", help="print nothing but errors")


def execute(arguments: argparse.Namespace) -> int:
    from lmoc.report.files import check_target

    check_formulation(arguments)
    check_target(arguments.output, (".html", ".htm"))
    try:
        run = simulate(arguments, assumptions=True)
    except (SimulationError, RunInterrupted) as failure:
        partial: Run | None = failure.partial
        if partial is not None and len(partial.time):
            partial.view(arguments.output)
            terminal.failure(f"{failure}; the page {arguments.output} shows the run until then")
        else:
            terminal.failure(str(failure))
        return process.interruption_code() if isinstance(failure, RunInterrupted) else FAILED_RUN
    if not arguments.quiet:
        terminal.show(run.notes, ("warning",))
    run.view(arguments.output)
    if not arguments.quiet:
        print(f"page written to {arguments.output} ({arguments.output.stat().st_size / 1e3:.0f} kB)")
    return 0
