"""`lmoc chart`: speed against accuracy of methods, formulations and tolerances on one scene."""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path

from lmoc.cli import process, terminal
from lmoc.cli.arguments import (
    Parser,
    add_model_arguments,
    add_run_arguments,
    add_states_argument,
    initial,
    number,
    positive,
)


def configure(parser: Parser) -> None:
    add_model_arguments(parser)
    add_states_argument(parser)
    add = parser.add_argument
    add("--solvers", type=_names, metavar="NAME,…", help="the methods (all)")
    add("--formulations", type=_names, metavar="NAME,…", help="the formulations (all in which the scene differs)")
    add("--rtol", type=tolerances, metavar="TOL:TOL",
        help="from one tolerance to another in decades, or a list TOL,TOL,… (1e-3:1e-10)")  # fmt: skip
    add("--quick", action="store_true", help="few methods and tolerances, in less than 10 s")
    add("--seconds", type=positive, metavar="S", help="time that the chart may take, approximately (300)")
    add_run_arguments(parser)
    add("-o", "--output", metavar="FILE", type=Path, help="write the points: .csv or .json")
    add("--plot", metavar="FILE", type=Path, help="draw the chart: .png, .svg, .pdf")
    add("--json", action="store_true", help="print the points as JSON")
    add("--quiet", action="store_true", help="print nothing but errors")


def _names(text: str) -> list[str]:
    names = [name.strip() for name in text.split(",") if name.strip()]
    if not names:
        raise argparse.ArgumentTypeError(f"expected names separated by commas, found '{text}'")
    return names


def tolerances(text: str) -> list[float]:
    """``1e-3:1e-10`` in decades, or a list."""
    if ":" not in text:
        return [number(item) for item in text.split(",")]
    ends = [number(item) for item in text.split(":")]
    if len(ends) != 2 or not all(0 < end < 1 for end in ends):
        raise argparse.ArgumentTypeError(f"expected two tolerances between 0 and 1, as 1e-3:1e-10, found '{text}'")
    high, low = max(ends), min(ends)
    decades = math.floor(math.log10(high / low) + 1e-9)
    return [float(f"{high * 10.0**-k:.12g}") for k in range(decades + 1)]


def execute(arguments: argparse.Namespace) -> int:
    from lmoc.cli.progress import Progress
    from lmoc.cli.scene import compiled
    from lmoc.report.files import PICTURES, check_target
    from lmoc.studies.chart_text import FORMATS, as_data

    for path, endings in ((arguments.output, FORMATS), (arguments.plot, PICTURES)):
        if path is not None:
            check_target(path, endings)
    with Progress(not arguments.quiet) as progress:
        dae = compiled(arguments, progress)
        chart = dae.chart(
            arguments.solvers, arguments.formulations, arguments.rtol, arguments.quick,
            start=arguments.start, stop=arguments.stop, points=arguments.points, initial=initial(arguments.init),
            inputs=dict(arguments.input), seconds=arguments.seconds, progress=progress.part,
        )  # fmt: skip
    written = []
    if arguments.output is not None:
        written.append(("points", chart.save(arguments.output)))
    if arguments.plot is not None:
        chart.plot(arguments.plot)
        written.append(("picture", arguments.plot))
    if arguments.json:
        print(json.dumps(as_data(chart), indent=2, ensure_ascii=False))
    elif not arguments.quiet:
        print("\n".join([str(chart), *(f"{what} written to {path}" for what, path in written)]))
    if chart.interrupted:
        terminal.failure("interrupted")
        return process.interruption_code()
    return 0
