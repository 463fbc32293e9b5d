"""`lmoc equilibria`: states of rest, and whether they are stable."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING

import numpy as np

from lmoc.cli.arguments import Parser, assignment, number
from lmoc.cli.progress import working
from lmoc.cli.symbols import add_symbol_arguments, compiled, complex_numbers
from lmoc.cli.symbols import names as listed

if TYPE_CHECKING:
    from lmoc.symbolic.equilibria import Equilibrium, LawsAtRest

MOST_SHOWN = 20  # states whose values are printed one by one


def configure(parser: Parser) -> None:
    add_symbol_arguments(parser)
    parser.add_argument(
        "--input", type=assignment(number), metavar="U=VALUE", action="append", default=[],
        help="constant value of an input; may be repeated. Others stay symbols, or are zero in a numeric search",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print JSON")


def execute(arguments: argparse.Namespace) -> int:
    dae = compiled(arguments)
    with working("equilibria"):
        found = dae.equilibria(inputs=dict(arguments.input))
    if arguments.json:
        print(json.dumps([as_data(e) for e in found], indent=2, ensure_ascii=False))
        return 0
    if not found:
        reason = "nothing balances the constant loads" if found.how == "exact" else f"none found by {found.how}"
        print(f"{dae.name}: no equilibrium: {reason}")
    for i, e in enumerate(found, 1):
        print(f"{dae.name}: {'family of equilibria' if e.free else 'equilibrium'}{f' {i}' if len(found) > 1 else ''}")
        print("\n".join(f"  {line}" for line in lines(e)))
    return 0


def lines(e: Equilibrium) -> list[str]:
    """An equilibrium in words."""
    from lmoc.symbolic.notation import Notation
    from lmoc.symbolic.styles import UNICODE

    if not e.values:
        return ["no states: nothing can move by itself"]
    shown, rest = _shown(e)
    known = {*shown, *e.free[:MOST_SHOWN]}
    names = [s.name for s in (*(s for s in e.values if s in known), *e.inputs)]
    of_laws = [] if e.laws is None else [*e.laws.forces.values(), *e.laws.conditions]
    notation = Notation.of(*shown.values(), *e.conditions, *of_laws, names=names, given=e.own_names)
    lines = [f"{notation.name(symbol.name)} = {_value(notation, value)}" for symbol, value in shown.items()]
    lines += [f"{notation.name(symbol.name)}: {_any(e, symbol.name)}" for symbol in e.free[:MOST_SHOWN]]
    lines += [rest] if rest else []
    lines += [f"only if {notation.text(condition)} = 0" for condition in e.conditions]
    loads = ", ".join(f"{notation.name(u.name)} = {_value(notation, v)}" for u, v in e.inputs.items())
    lines += [f"for {loads}"] if loads else []
    lines += [] if e.laws is None else _laws(e, notation)
    lines += _stability(e, notation)
    if e.how != "exact":
        lines.append(f"found: {e.how}")
    table = [f"{UNICODE.symbol(short, 0)}: {full}" for short, full in notation.abbreviations.items()]
    return lines + ([f"with {', '.join(table)}"] if table else [])


def _shown(e: Equilibrium) -> tuple[dict, str]:
    """Return the values that are shown one by one, and a note on the others: of many states those that are not zero."""
    values = {symbol: value for symbol, value in e.values.items() if symbol not in e.free}
    if len(e.values) <= MOST_SHOWN:
        return values, ""
    moved = {symbol: value for symbol, value in values.items() if not value.is_zero}
    shown = dict(list(moved.items())[:MOST_SHOWN])
    lines = [f"the other {len(values) - len(moved)} states = 0" if moved else f"all {len(values)} states = 0"]
    lines = lines if len(moved) < len(values) else []
    lines += [f"{len(moved) - len(shown)} more values"] if len(moved) > len(shown) else []
    lines += [f"{len(e.free) - MOST_SHOWN} more with any value"] if len(e.free) > MOST_SHOWN else []
    return shown, "; ".join(lines) + (" (--json lists all)" if lines else "")


def _stability(e: Equilibrium, notation) -> list[str]:
    lines = f"stability: {e.stability or 'not known: a parameter has no value'}"
    if e.model is None:
        return [lines]
    if e.model.is_too_wide:
        return [f"{lines} (the numbers of the linear model lie too far apart for its eigenvalues)"]
    if e.nonlinear:
        symbols = {s.name for value in e.values.values() for s in value.free_symbols}
        zeroed = [f"{notation.name(u)} = 0" for u in e.model.inputs if u in symbols]
        lines += f" (by the linear model{' at ' + ', '.join(zeroed) if zeroed else ''})"
    return [lines, f"eigenvalues: {complex_numbers(e.model.eigenvalues)}"]


def _any(e: Equilibrium, name: str) -> str:
    """Describe the values that a free state may have."""
    if e.laws is None or name not in e.laws.range:
        return "any value"
    return _between(*e.laws.range[name])


def _between(low: float, high: float) -> str:
    low, high = low + 0.0, high + 0.0  # no negative zero
    if np.isinf(low) or np.isinf(high):
        return f"≥ {low:.8g}" if np.isfinite(low) else f"≤ {high:.8g}" if np.isfinite(high) else "any value"
    return f"from {low:.8g} to {high:.8g}"


def _laws(e: Equilibrium, notation) -> list[str]:
    """Return lines on the modes of the laws, and the forces of the closed ones."""
    modes: dict[str, list[str]] = {}
    for name, word in e.laws.modes.items():
        modes.setdefault(word, []).append(name)
    lines = [f"{word}: {listed(names, MOST_SHOWN)}" for word, names in modes.items()]
    for name in list(dict.fromkeys((*e.laws.forces, *e.laws.force_range)))[:MOST_SHOWN]:
        value, limits = e.laws.forces.get(name), e.laws.force_range.get(name)
        shown = [f"= {_value(notation, value)}"] if value is not None else []
        lines.append(f"{name} {', '.join([*shown, *([_between(*limits)] if limits else [])])}")
    lines += [f"only if {notation.text(condition)} ≥ 0" for condition in e.laws.conditions]
    return lines + [f"with nothing to spare: {listed(e.laws.at_limit, MOST_SHOWN)}"] * bool(e.laws.at_limit)


def _value(notation, value) -> str:
    return f"{float(value):.8g}" if value.is_Float else notation.text(value)


def as_data(e: Equilibrium) -> dict:
    """An equilibrium as plain data."""
    told = e.model is not None and not e.model.is_too_wide
    return {
        "values": {symbol.name: str(value) for symbol, value in e.values.items()},
        "inputs": {symbol.name: str(value) for symbol, value in e.inputs.items()},
        "free": [symbol.name for symbol in e.free],
        "conditions": [f"{condition} = 0" for condition in e.conditions],
        "stability": e.stability,
        "eigenvalues": [[v.real, v.imag] for v in e.model.eigenvalues.tolist()] if told else [],
        "how": e.how,
    } | ({} if e.laws is None else {"laws": _laws_data(e.laws)})


def _laws_data(laws: LawsAtRest) -> dict:
    """Return the modes of the laws as plain data; limits that are infinite as None."""
    from lmoc.report.summary import plain

    return {
        "modes": dict(laws.modes),
        "forces": {name: str(value) for name, value in laws.forces.items()},
        "force_ranges": plain(laws.force_range),
        "ranges": plain(laws.range),
        "member": plain(laws.member),
        "conditions": [f"{condition} >= 0" for condition in laws.conditions],
        "at_limit": list(laws.at_limit),
    }
