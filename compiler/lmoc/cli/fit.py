"""`lmoc fit`: parameters and start values from measured data."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lmoc.cli.arguments import (
    Parser,
    UsageError,
    add_model_arguments,
    add_states_argument,
    assignment,
    number,
    ordinal,
    positive,
)
from lmoc.messages.diagnostics import Diagnostic
from lmoc.support.quoted import partition, split

if TYPE_CHECKING:
    from lmoc.interface import DAE


def configure(parser: Parser) -> None:
    add_model_arguments(parser)
    add_states_argument(parser)
    add = parser.add_argument
    add("--data", metavar="FILE", action="append", default=[], help="table with a column time; may be repeated: "
        "several experiments")  # fmt: skip
    add("--free", metavar="NAME,…", action="append", default=[],
        help="what is looked for: k,c begin at the model's values; k=30 at 30; c=1:0:10 between 0 and 10")  # fmt: skip
    add("--outputs", metavar="COLUMN=NAME", type=assignment(str), action="append", default=[],
        help="the variable that a column belongs to; by default that of the same name; may be repeated")  # fmt: skip
    add("--sigma", type=positive, metavar="S", help="standard deviation of the data (estimated)")
    add("--starts", type=ordinal, metavar="N", default=1, help="begin at N places and take the best (1)")
    add("--seed", type=int, metavar="N", default=0, help="for these places (0)")
    add("--profile", action="store_true", help="intervals by profile likelihood, too")
    add("--start", type=number, metavar="S", help="start time (experiment, else 0)")
    add("--init", type=assignment(number), metavar="NAME=VALUE", action="append", default=[],
        help="fix a variable at the start; may be repeated")  # fmt: skip
    add("--input", type=assignment(str), metavar="U=SIGNAL", action="append", default=[],
        help="a formula in time, or a table; may be repeated")  # fmt: skip
    add("--rtol", type=positive, metavar="TOL", help="relative tolerance of the runs (1e-9)")
    add("--plot", metavar="FILE", type=Path, help="draw data, fit, band and residuals: .png, .svg, .pdf")
    add("--json", action="store_true", help="print the result as JSON")
    add("--quiet", action="store_true", help="print nothing but errors")


def execute(arguments: argparse.Namespace) -> int:
    from lmoc.cli.progress import Progress
    from lmoc.cli.scene import compiled
    from lmoc.report.files import PICTURES, check_target

    if arguments.plot is not None:
        check_target(arguments.plot, PICTURES)
    for option, given, hint in (("data", arguments.data, "--data measured.csv"), ("free", arguments.free, "--free k")):
        if not given:
            raise UsageError([Diagnostic("E0620", f"lmoc fit needs --{option}", hint=hint)])
    with Progress(not arguments.quiet) as progress:
        dae = compiled(arguments, progress)
        free = dict(_free(word, dae) for words in arguments.free for word in split(words, ",") if word.strip())
        progress.stage("fit")
        found = dae.fit(
            list(arguments.data), free, dict(arguments.outputs) or None, arguments.sigma, arguments.starts,
            start=arguments.start, initial=dict(arguments.init), inputs=dict(arguments.input), rtol=arguments.rtol,
            seed=arguments.seed, profile=arguments.profile,
        )  # fmt: skip
    if arguments.plot is not None:
        found.plot(arguments.plot)
    if arguments.json:
        data = {"values": found.values, "deviations": found.deviations, "intervals": found.intervals,
                "undetermined": found.undetermined, "sigma": found.sigma, "converged": found.converged,
                "message": found.message, "differences": found.differences,
                "profiles": {name: (own.low, own.high) for name, own in found.profiles.items()}}  # fmt: skip
        from lmoc.report.summary import plain

        print(json.dumps(plain(data), indent=2, ensure_ascii=False))
    elif not arguments.quiet:
        written = [] if arguments.plot is None else [f"picture written to {arguments.plot}"]
        print("\n".join([f"{dae.name}: fit of {', '.join(found.values)}", "", str(found), *written]))
    return 0


def _free(word: str, dae: DAE) -> tuple[str, Any]:
    """Return the name, and where to begin, of ``k``, ``k=30`` or ``k=1:0:10``."""
    name, sign, text = (part.strip() for part in partition(word, "="))
    if not sign:
        if dae.flat.find(name) is None:
            from lmoc.ir.names import hint_for

            raise UsageError([Diagnostic("E0622", f"'{name}' is not in '{dae.name}'", hint=hint_for(dae.flat, name))])
        return name, _begin(name, dae.parameters[name]) if name in dae.parameters else dae.at_start()(name)
    try:
        numbers = [number(part) for part in text.split(":")]
    except argparse.ArgumentTypeError as error:
        raise UsageError([Diagnostic("E0621", f"--free {name}: {error}")]) from None
    if len(numbers) not in (1, 3):
        raise UsageError([Diagnostic("E0621", f"--free {name}: expected start, or start:low:high; found '{text}'")])
    return name, numbers[0] if len(numbers) == 1 else tuple(numbers)


def _begin(name: str, value: Any) -> float:
    """Return the value of a parameter, or the common one of an array of parameters."""
    import numpy as np

    own = np.unique(value)
    if len(own) == 1:
        return float(own[0])
    hint = f"'--free {name}=1' gives all one value, '--free {name}[1]' fits the first alone"
    text = f"--free {name}: the elements of this array have no value in common"
    raise UsageError([Diagnostic("E0621", text, hint=hint)])
