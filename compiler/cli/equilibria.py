"""`lmoc equilibria`: states of rest, and whether they are stable."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING

from lmoc.cli.arguments import Parser, assignment, number
from lmoc.cli.symbols import add_symbol_arguments, compiled, complex_numbers

if TYPE_CHECKING:
    from lmoc.symbolic.equilibria import Equilibrium


def configure(parser: Parser) -> None:
    add_symbol_arguments(parser)
    parser.add_argument(
        "--input", type=assignment(number), metavar="U=VALUE", action="append", default=[],
        help="constant value of an input; may be repeated. Others stay symbols, or are zero in a numeric search",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print JSON")


def execute(arguments: argparse.Namespace) -> int:
    dae = compiled(arguments)
    found = dae.equilibria(inputs=dict(arguments.input))
    if arguments.json:
        print(json.dumps([as_data(e) for e in found], indent=2, ensure_ascii=False))
        return 0
    if not found:
        print(f"{dae.name}: no equilibrium: nothing balances the constant loads")
    for i, e in enumerate(found, 1):
        print(f"{dae.name}: {'family of equilibria' if e.free else 'equilibrium'}{f' {i}' if len(found) > 1 else ''}")
        print("\n".join(f"  {line}" for line in lines(e)))
    return 0


def lines(e: Equilibrium) -> list[str]:
    """An equilibrium in words."""
    from lmoc.symbolic.notation import Notation
    from lmoc.symbolic.styles import UNICODE

    notation = Notation.of(*e.values.values(), *e.conditions, names=list(e), given=e.own_names)
    values = {symbol: value for symbol, value in e.values.items() if symbol not in e.free}
    told = [f"{notation.name(symbol.name)} = {_value(notation, value)}" for symbol, value in values.items()]
    told += [f"{notation.name(symbol.name)}: any value" for symbol in e.free]
    told += [f"only if {notation.text(condition)} = 0" for condition in e.conditions]
    stability = e.stability or "not known: a parameter has no value"
    told.append(f"stability: {stability}" + (" (by the linear model)" if e.nonlinear else ""))
    if e.model is not None:
        told.append(f"eigenvalues: {complex_numbers(e.model.eigenvalues)}")
    if e.how != "exact":
        told.append(f"found: {e.how}")
    table = [f"{UNICODE.symbol(short, 0)}: {full}" for short, full in notation.abbreviations.items()]
    return told + ([f"with {', '.join(table)}"] if table else [])


def _value(notation, value) -> str:
    return f"{float(value):.8g}" if value.is_Float else notation.text(value)


def as_data(e: Equilibrium) -> dict:
    """An equilibrium as plain data."""
    return {
        "values": {symbol.name: str(value) for symbol, value in e.values.items()},
        "free": [symbol.name for symbol in e.free],
        "conditions": [f"{condition} = 0" for condition in e.conditions],
        "stability": e.stability,
        "eigenvalues": [] if e.model is None else [[v.real, v.imag] for v in e.model.eigenvalues.tolist()],
        "how": e.how,
    }
