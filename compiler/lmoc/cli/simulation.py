"""The options of a simulation and what they mean, for the verbs that run a scene once."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from lmoc.cli.arguments import (
    Parser,
    Range,
    add_model_arguments,
    add_run_arguments,
    add_states_argument,
    choice,
    initial,
    positive,
)
from lmoc.support.quoted import split

if TYPE_CHECKING:
    from lmoc.ir.flat import FlatDAE
    from lmoc.run import Run
    from lmoc.studies.sweep import Sweep


def add_simulation_arguments(parser: Parser, ranges: bool = False) -> None:
    """The scene, its span, start and signals, the method and its tolerances; `ranges` as in `add_model_arguments`."""
    from lmoc.numerics.options.formulations import TABLE
    from lmoc.numerics.options.options import FIXED_STEP, SOLVERS, solver_hint

    add_model_arguments(parser, ranges)
    add_states_argument(parser)
    add_run_arguments(parser)
    add = parser.add_argument
    add("--rtol", type=positive, metavar="TOL", help="relative tolerance (experiment, else 1e-6)")
    add("--atol", type=positive, metavar="TOL", help="absolute tolerance (rtol/1000 of each variable's nominal value)")
    add("--max-step", type=positive, metavar="S", help="longest step of the integrator (no limit)")
    add("--step", type=positive, metavar="S",
        help=f"length of every step (a thousandth of the run): {', '.join(FIXED_STEP)}; gauss")  # fmt: skip
    add("--solver", type=choice(SOLVERS, solver_hint), metavar="NAME", default="auto", help=", ".join(SOLVERS))
    add("--formulation", metavar="NAME", default="auto",
        help=f"of closed loops: {', '.join(TABLE)}; baumgarte:25 with a gain in 1/s (auto)")  # fmt: skip
    add("--keep", metavar="NAME", action="append",
        help="retain only this variable or array (large models); may be repeated")  # fmt: skip


def check_formulation(arguments: argparse.Namespace) -> None:
    """Refuse a formulation that does not exist, or does not go with the solver, before time is spent (E0626)."""
    from lmoc.numerics.options.options import checked_formulation

    checked_formulation(arguments.formulation, arguments.solver)


def simulate(
    arguments: argparse.Namespace, assumptions: bool = False, check: Callable[[FlatDAE], object] | None = None
) -> Run:
    """Compile and run the scene, with progress shown unless quiet.

    Parameters
    ----------
    assumptions : those that the reduction makes of the parameters are needed; one that an earlier process has kept has
        the values in their place
    check : called with the compiled scene before it is run, to refuse what cannot be done with its result
    """
    from lmoc.cli.progress import Progress
    from lmoc.cli.scene import compiled, recalled_or_compiled

    if arguments.quiet:
        import logging

        logging.getLogger("lmoc").setLevel(logging.ERROR)
    with Progress(not arguments.quiet) as progress:
        dae = (compiled if assumptions else recalled_or_compiled)(arguments, progress)
        if check is not None:
            check(dae.flat)
        wanted = [name.strip() for name in split(getattr(arguments, "sensitivity", ""), ",") if name.strip()]
        return dae.simulate(
            **options_of(arguments), sensitivities=wanted, listener=progress.stage, progress=progress.reached
        )


def options_of(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the arguments of `DAE.simulate` that a command gives."""
    return {
        "start": arguments.start,
        "stop": arguments.stop,
        "points": arguments.points,
        "rtol": arguments.rtol,
        "atol": arguments.atol,
        "solver": arguments.solver,
        "formulation": arguments.formulation,
        "initial": initial(arguments.init),
        "inputs": dict(arguments.input),
        "keep": arguments.keep,
        "max_step": arguments.max_step,
        "step": arguments.step,
    }


def ranges_of(arguments: argparse.Namespace) -> dict[str, tuple[float, ...]]:
    """Take the parameters with several values out of `arguments.set`, and return them."""
    found = {name: given.values for name, given in arguments.set if isinstance(given, Range)}
    arguments.set = [(name, given) for name, given in arguments.set if not isinstance(given, Range)]
    return found


def sweep(
    arguments: argparse.Namespace, values: Mapping[str, tuple[float, ...]], check: Callable[[FlatDAE], object]
) -> Sweep:
    """Compile the scene once and run it for several values of parameters; `check` as of `simulate`."""
    from lmoc.cli.progress import Progress
    from lmoc.cli.scene import recalled_or_compiled

    with Progress(not arguments.quiet) as progress:
        dae = recalled_or_compiled(arguments, progress)
        check(dae.flat)
        return dae.sweep(values, options=options_of(arguments) | {"progress": progress.reached})
