"""`lmoc solvers`: the table of the methods and their properties."""

from __future__ import annotations

import argparse

from lmoc.cli.arguments import Parser, choice

_EXPLANATION = """\
order: of a step, and of the values between two steps. stable: A, L, nearly A (α); – is a bounded region, as explicit
methods have. symplectic: at steps of equal length. steps: of its own choice by the tolerance, or fixed (--step).
roots: every step is looked at, so that laws and events are located; of those that cannot, cvodes and idas hand over
to cvode and ida, and moreau steps over the events of laws. auto: dop853 first, taylor where many steps lie
ahead; where it meets stiffness, cvode, ida or radau by the eigenvalues of the Jacobian."""


def configure(parser: Parser) -> None:
    from lmoc.numerics.options.options import SOLVERS, solver_hint

    parser.add_argument(
        "solver", metavar="NAME", nargs="?", type=choice([n for n in SOLVERS if n != "auto"], solver_hint),
        help="one of them, with what it needs and is good for",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print the table as JSON")


def execute(arguments: argparse.Namespace) -> int:
    from lmoc.numerics.problem.base import HEAD
    from lmoc.numerics.steps.choice import table

    rows = [one.cells for one in table() if arguments.solver in (None, one.name)]
    if arguments.json:
        import json

        print(json.dumps([dict(zip(HEAD, row, strict=True)) for row in rows], indent=2, ensure_ascii=False))
    elif arguments.solver is not None:
        width = max(map(len, HEAD))
        print("\n".join(f"{name:<{width}}  {cell}" for name, cell in zip(HEAD, rows[0], strict=True)))
    else:
        last = HEAD.index("from") + 1  # what it needs and is good for are sentences
        widths = [max(len(row[k]) for row in (HEAD, *rows)) for k in range(last)]
        for row in (HEAD, *rows):
            print("  ".join(cell.ljust(width) for cell, width in zip(row[:last], widths, strict=True)).rstrip())
        print(f"\n{_EXPLANATION}\n`lmoc solvers NAME` tells what a method needs and is good for.")
    return 0
