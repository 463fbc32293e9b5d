"""`lmoc equations`: the equations of motion as a person writes them."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING

from lmoc.cli.arguments import Parser, ordinal
from lmoc.cli.progress import working
from lmoc.cli.symbols import add_symbol_arguments, compiled, listed, names
from lmoc.messages.diagnostics import Diagnostic, ModelError

if TYPE_CHECKING:
    from lmoc.interface import DAE
    from lmoc.symbolic.equations import EquationsOfMotion
    from lmoc.symbolic.equilibria import Equilibrium
    from lmoc.symbolic.laws.equations import EquationsOfModes


def configure(parser: Parser) -> None:
    add_symbol_arguments(parser)
    add = parser.add_argument
    add("--with-forces", action="store_true", help="with the internal forces of rods, strings and gears")
    add("--explicit", action="store_true", help="solved for the highest derivatives")
    add("--about-equilibrium", action="store_true", help="in deviations from the equilibrium: constant loads disappear")
    add("--equilibrium", metavar="N", type=ordinal, help="in deviations from the N-th that `lmoc equilibria` lists")
    add = parser.add_mutually_exclusive_group().add_argument
    add("--latex", action="store_true", help="print LaTeX")
    add("--html", action="store_true", help="print a page with MathML")
    add("--json", action="store_true", help="print JSON")
    add("--ascii", action="store_true", help="primes instead of dots, nothing but ASCII")


def execute(arguments: argparse.Namespace) -> int:
    dae = compiled(arguments)
    rest = None
    with working("equations"):
        found = dae.equations(forces=arguments.with_forces, explicit=arguments.explicit)
        if arguments.about_equilibrium or arguments.equilibrium is not None:
            rest = equilibrium(dae, arguments.equilibrium)
            found = found.about(rest)  # of a scene with laws, in the mode that it has there
    if arguments.json:
        print(json.dumps(found.to_dict(), indent=2, ensure_ascii=False))
    elif arguments.latex:
        print(found.latex())
    elif arguments.html:
        from lmoc.report.page import page

        print(page(f"Equations of motion: {dae.name}", found.html()))
    else:
        given = f"deviations from {_rest(rest)}" if rest is not None else names(found.coordinates)
        print(f"{dae.name}: {_counted(found)}" + (f" in {given}" if given else ""))
        print()
        print(found.text(ascii=arguments.ascii))
    return 0


def equilibrium(dae: DAE, n: int | None) -> Equilibrium:
    """An equilibrium without inputs, the n-th or the only one.

    Raises
    ------
    ModelError
        E0663 where there is no such one.
    """
    if n is not None:
        return listed(dae, n, {})
    rests = dae.equilibria(inputs={u: 0 for u in dae.inputs})
    if len(rests) != 1:
        message = f"there are {len(rests)} equilibria, not one to count deviations from"
        hint = "choose one by `--equilibrium N`; `lmoc equilibria` lists them" if rests else ""
        raise ModelError([Diagnostic("E0663", message, hint=hint)])
    return rests[0]


def _rest(rest: Equilibrium) -> str:
    """Describe the reference point of the deviations: the coordinates that are not zero there."""
    from lmoc.symbolic.notation import Notation

    away = {name: value for name, value in rest.items() if value != 0}
    notation = Notation.of(*away.values(), names=list(away), given=rest.own_names)
    places = (f"{notation.name(name)} = {notation.text(value)}" for name, value in away.items())
    return f"the equilibrium {names(places) or 'at zero'}"


def _counted(found: EquationsOfMotion | EquationsOfModes) -> str:
    from lmoc.symbolic.laws.equations import EquationsOfModes

    if isinstance(found, EquationsOfModes):
        n = len(found.modes) + found.more
        return f"equations of motion of {n} mode{'s' if n != 1 else ''}"
    n = len(found.equations)
    return f"{n} equation{'s' if n != 1 else ''} of motion"
