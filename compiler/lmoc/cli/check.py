"""`lmoc check`: all stages up to a consistent start with the default values."""

from __future__ import annotations

import argparse
import json

from lmoc.cli import terminal
from lmoc.cli.arguments import Parser, add_model_arguments, add_states_argument
from lmoc.messages.diagnostics import Diagnostic, ModelError


def configure(parser: Parser) -> None:
    add_model_arguments(parser)
    add_states_argument(parser)
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors and warnings")
    parser.add_argument("--json", action="store_true", help="print the diagnostics as JSON")


def execute(arguments: argparse.Namespace) -> int:
    try:
        said, line = _check(arguments)
    except ModelError as error:
        if not arguments.json:
            raise
        print(json.dumps([as_data(d) for d in error.diagnostics], indent=2, ensure_ascii=False))
        from lmoc.cli.main import exit_code

        return exit_code(error)
    if arguments.json:
        print(json.dumps([as_data(d) for d in said], indent=2, ensure_ascii=False))
        return 0
    terminal.show(said, ("warning",) if arguments.quiet else ("warning", "note"))
    if not arguments.quiet:
        print(line)
    return 0


def _check(arguments: argparse.Namespace) -> tuple[tuple[Diagnostic, ...], str]:
    from lmoc.cli.progress import Progress
    from lmoc.cli.scene import compiled
    from lmoc.report.summary import counted, stages

    with Progress(not arguments.quiet) as progress:
        dae = compiled(arguments, progress)
        notes = dae.check(listener=progress.stage)
    counts = ", ".join(counted(n, stage) for stage, n in stages(dae.reduced.counts))
    warnings = sum(d.severity == "warning" for d in notes)
    return notes, f"{dae.name}: {counts}; no errors" + (f", {counted(warnings, 'warnings')}" if warnings else "")


def as_data(d: Diagnostic) -> dict[str, object]:
    """A diagnostic as plain data."""
    place = {}
    if d.span is not None:
        end_line, end_column = d.span.source.position(d.span.end)  # of the character behind it
        place = {"file": d.span.source.name, "line": d.span.line, "column": d.span.column}
        place |= {"end_line": end_line, "end_column": end_column}
    more = {key: getattr(d, key) for key in ("expected", "found", "hint") if getattr(d, key)}
    return {"code": d.code, "severity": d.severity, "message": d.message, **place, **more}
