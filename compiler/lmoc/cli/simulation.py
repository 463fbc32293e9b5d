"""The options of a simulation and what they mean, for the verbs that run a scene once."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from lmoc.cli.arguments import (
    Parser,
    add_model_arguments,
    add_run_arguments,
    add_states_argument,
    choice,
    initial,
    positive,
)

if TYPE_CHECKING:
    from lmoc.run import Run


def add_simulation_arguments(parser: Parser) -> None:
    """The scene, its span, start and signals, the method and its tolerances."""
    from lmoc.numerics.formulations.table import TABLE
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
    add("--formulation", metavar="NAME", default="reduced",
        help=f"of closed loops: {', '.join(TABLE)}; baumgarte:25 with a gain in 1/s (reduced)")  # fmt: skip
    add("--keep", metavar="NAME", action="append",
        help="retain only this variable or array (large models); may be repeated")  # fmt: skip


def check_formulation(arguments: argparse.Namespace) -> None:
    """Refuse a formulation that does not exist, or does not go with the solver, before time is spent (E0626)."""
    from lmoc.numerics.options import checked_formulation

    checked_formulation(arguments.formulation, arguments.solver)


def simulate(arguments: argparse.Namespace) -> Run:
    """Compile and run the scene, with progress shown unless quiet."""
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
