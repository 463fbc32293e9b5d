"""`lmoc study`: many runs of a scene with random numbers."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lmoc.cli import terminal
from lmoc.cli.arguments import (
    Parser,
    UsageError,
    add_model_arguments,
    add_run_arguments,
    add_states_argument,
    initial,
    ordinal,
    positive,
)
from lmoc.messages.diagnostics import Diagnostic
from lmoc.support.quoted import partition, split

if TYPE_CHECKING:
    from lmoc.studies.ensemble import Ensemble
    from lmoc.studies.sample import Distribution

FAILED_RUN = 3
_ENDINGS = (".csv", ".parquet", ".npz")


def configure(parser: Parser) -> None:
    add_model_arguments(parser)
    add_states_argument(parser)
    add = parser.add_argument
    add("--sample", metavar="NAME~HOW", type=_sampled, action="append", default=[],
        help="a parameter or start value and its distribution, as 'k1~normal(1.6e5,1.6e4)'; also uniform(low,high), "
        "lognormal(median,deviation), triangular(low,mode,high); may be repeated")  # fmt: skip
    add("--runs", type=ordinal, metavar="N", default=100, help="number of runs (100)")
    add("--seed", type=int, metavar="N", default=0, help="the same seed gives the same values (0)")
    add("--method", choices=("latin", "sobol", "random"), default="latin", help="how the values are spread (latin)")
    add_run_arguments(parser)
    add("--rtol", type=positive, metavar="TOL", help="relative tolerance (experiment, else 1e-6)")
    add("--keep", metavar="NAME,…", action="append", help="variables of which end, min and max are kept (outputs)")
    add("--workers", metavar="N|ADDRESS", help="number of threads (one for each processor); or the address of a "
        "scheduler of dask, as tcp://host:8786")  # fmt: skip
    add("--store", metavar="DIR", type=Path, help="keep what is done there, so that an interrupted study can go on")
    add("--resume", action="store_true", help="go on with what --store holds (beside -o without it)")
    add("-o", "--output", metavar="FILE", type=Path, help="write the table of the runs: .csv, .parquet, .npz")
    add("--plot", metavar="FILE", type=Path, help="draw what the first variable kept depends on: .png, .svg, .pdf")
    add("--json", action="store_true", help="print the summary as JSON")
    add("--quiet", action="store_true", help="print nothing but errors")


def _sampled(text: str) -> tuple[str, Distribution]:
    from lmoc.studies.sample import parsed

    name, sign, how = (part.strip() for part in partition(text, "~"))
    if not (name and sign and how):
        raise argparse.ArgumentTypeError(f"expected name~distribution, as 'k~normal(30,3)'; found '{text}'")
    try:
        return name, parsed(how)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{name}: {error}") from None


def execute(arguments: argparse.Namespace) -> int:
    from lmoc.cli.progress import Progress
    from lmoc.cli.scene import compiled
    from lmoc.report.files import PICTURES, check_target
    from lmoc.studies.rows import for_all_members
    from lmoc.studies.sample import sample

    for path, endings in ((arguments.output, _ENDINGS), (arguments.plot, PICTURES)):
        if path is not None:
            check_target(path, endings)
    if not arguments.sample:
        raise UsageError([Diagnostic("E0620", "there is nothing to vary", hint="--sample 'k~normal(30,3)'")])
    names = [name for name, _ in arguments.sample]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise UsageError([Diagnostic("E0621", f"--sample: '{twice[0]}' has more than one distribution")])
    keep = [name.strip() for words in arguments.keep or () for name in split(words, ",") if name.strip()]
    with Progress(not arguments.quiet) as progress, _workers(arguments.workers) as workers:
        dae = compiled(arguments, progress)
        try:
            drawn = sample(dict(arguments.sample), n=arguments.runs, seed=arguments.seed, method=arguments.method)
        except ValueError as error:
            raise UsageError([Diagnostic("E0621", str(error))]) from None
        many = dae.ensemble(
            for_all_members(dae.flat, drawn), initial(arguments.init) or None, dict(arguments.input),
            arguments.start, arguments.stop,
            points=arguments.points, rtol=arguments.rtol, keep=keep, workers=workers, store=_store(arguments),
            series=arguments.output is not None and arguments.output.suffix.lower() == ".npz",
            progress=lambda done, count: progress.part(f"{done} of {count} runs", done / count),
        )  # fmt: skip
    _tell(many, arguments)
    return FAILED_RUN if many.failed.any() else 0


def _store(arguments: argparse.Namespace) -> Path | None:
    """Return the folder of the study, if it has one; what it holds is taken up only where that was asked for."""
    folder: Path | None = arguments.store
    if folder is None and arguments.resume:
        if arguments.output is None:
            hint = "--store DIR --resume"
            raise UsageError([Diagnostic("E0620", "--resume: there is no store and no output", hint=hint)])
        folder = arguments.output.with_suffix(".study")
    if folder is not None and not arguments.resume and (folder / "study.json").exists():
        message = f"'{folder}' holds a study already"
        raise UsageError([Diagnostic("E0620", message, hint="--resume goes on with it; or take another folder")])
    return folder


@contextmanager
def _workers(text: str | None):
    """What shares the work: a number of threads, or a client of dask."""
    if text is None or text.isdigit():
        if text == "0":
            raise UsageError([Diagnostic("E0621", "--workers: expected at least 1, found 0")])
        yield None if text is None else int(text)
        return
    try:
        from distributed import Client
    except ImportError:
        hint = "pip install 'lmoc[studies]'"
        raise UsageError([Diagnostic("E0621", f"--workers {text}: dask is not installed", hint=hint)]) from None
    try:
        client = Client(text, timeout=10)
    except (OSError, ValueError) as error:
        raise UsageError([Diagnostic("E0621", f"--workers: no scheduler answers at {text}: {error}")]) from None
    with client:
        yield client


def _tell(many: Ensemble, arguments: argparse.Namespace) -> None:
    """Files, the summary, and why runs have failed."""
    from lmoc.cli.symbols import table

    written = []
    if arguments.output is not None:
        written.append(f"table written to {many.save(arguments.output)}")
    if arguments.plot is not None:
        many.plot(path=arguments.plot, kind="tornado")
        written.append(f"picture written to {arguments.plot}")
    rows = summary(many)
    if arguments.json:
        print(json.dumps({"runs": len(many), "failed": int(many.failed.sum()), "summary": rows}, ensure_ascii=False))
    elif not arguments.quiet:
        head = ["", *next(iter(rows.values()))]
        lines = [[name, *(f"{value:.6g}" for value in own.values())] for name, own in rows.items()]
        print("\n".join([f"{many.name}: {len(many)} runs", "", table([head, *lines]), *written]))
    for reason, count in _reasons(many.reasons):
        terminal.failure(f"{count} of {len(many)} runs: {reason}")
    sys.stdout.flush()


def summary(many: Ensemble) -> dict[str, dict[str, float]]:
    """Return {what: its mean, standard deviation and quantiles} over the runs that have not failed."""
    import numpy as np

    found: dict[str, dict[str, float]] = {}
    for column, values in many.table.items():
        own: Any = values[~many.failed]
        if column in ("failed", "reason") or column in many.given or not len(own):
            continue
        low, middle, high = np.quantile(own, [0.01, 0.5, 0.99])
        found[column] = {"mean": float(np.mean(own)), "deviation": float(np.std(own)), "1 %": float(low),
                         "median": float(middle), "99 %": float(high)}  # fmt: skip
    return found or {"no run has succeeded": {}}


def _reasons(reasons: Sequence[str]) -> list[tuple[str, int]]:
    """Return the reasons of failures, the most frequent first, five at most."""
    from collections import Counter

    return Counter(reason.splitlines()[0] for reason in reasons if reason).most_common(5)
