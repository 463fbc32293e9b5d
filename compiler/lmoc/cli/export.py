"""`lmoc export`: a scene as an FMU, for other tools."""

from __future__ import annotations

import argparse
from pathlib import Path

from lmoc.cli.arguments import Parser, UsageError, add_model_arguments
from lmoc.messages.diagnostics import Diagnostic


def configure(parser: Parser) -> None:
    add_model_arguments(parser)
    parser.add_argument("-o", "--output", metavar="FILE", type=Path, help="the FMU: .fmu")
    parser.add_argument("--fmi", type=int, choices=(3, 2), default=3, help="the version of FMI; 3")
    parser.add_argument("--type", default="me,cs", metavar="TYPES", help="me (Model Exchange), cs (Co-Simulation)")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")


def execute(arguments: argparse.Namespace) -> int:
    from lmoc.cli.progress import Progress
    from lmoc.cli.scene import compiled

    if arguments.output is None:
        raise UsageError([Diagnostic("E0620", "where should the FMU be written?", hint="-o scene.fmu")])
    types = tuple(dict.fromkeys(t.strip() for t in arguments.type.split(",") if t.strip()))
    with Progress(not arguments.quiet) as progress:
        made = compiled(arguments, progress).export(arguments.output, arguments.fmi, types)
    if not arguments.quiet:
        binary = f"a binary for {made.binary}, and sources" if made.binary else "sources only: there is no C compiler"
        print(f"FMI {arguments.fmi}.0 ({', '.join(types)}) written to {made.path}, with {binary}")
        if made.fixed:
            shown = ", ".join(made.fixed[:5]) + (f" and {len(made.fixed) - 5} more" if len(made.fixed) > 5 else "")
            print(f"cannot be set in it, since structure or start depend on them: {shown}")
    return 0
