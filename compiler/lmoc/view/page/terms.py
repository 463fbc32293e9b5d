"""The terms of the equations as functions in the page, by which it shades each as large as it is at an instant."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field
from typing import TYPE_CHECKING, Any

import numpy as np

from lmoc.ir.flat import FlatDAE, Kind
from lmoc.report.result import Result
from lmoc.support.records import dataclass
from lmoc.symbolic.names import base_of
from lmoc.view.page.equations import PageEquations
from lmoc.view.page.simulation import OwnRun

if TYPE_CHECKING:
    import sympy

MOST_JETS = 25_000  # values of what the terms are made of: 0.13 MB of text


@dataclass(frozen=True, eq=False)
class Terms:
    """What shades the terms.

    Attributes
    ----------
    names : of parameters, variables and derivatives that the terms are made of
    constants : {name: value} of those that do not change in the run
    values : (other names, times) over the run
    modes : {law: mode} of each group of equations, None for all modes
    text : JavaScript of ``[[[[left], [right]], …], …]`` by mode, equation and side: functions of an array of values in
        the order of the names; null for what has no value, such as the force of a closed loop
    """

    names: tuple[str, ...] = ()
    constants: dict[str, float] = field(default_factory=dict)
    values: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    modes: tuple[dict[str, str] | None, ...] = ()
    text: str = "[]"


def terms_of(equations: PageEquations, run: Result, rows: np.ndarray) -> Terms:
    """Return the terms of the equations of a run at some of its output times; none where it has not kept everything."""
    if run.trajectory.kept is not None:
        return Terms()
    sides = [side for _, own in equations.modes for e in own for side in (e.left, e.right)]
    names = sorted({s.name for side in sides for c, f in side for s in (c * f).free_symbols})
    known = {n: v[rows] for n in names if (v := _over_time(run, n)) is not None}
    constants = {n: float(v[0]) for n, v in known.items() if (v == v[0]).all()}
    changing = [v for n, v in known.items() if n not in constants]
    if not known or len(changing) * len(rows) > MOST_JETS:
        return Terms()
    place = {n: k for k, n in enumerate(known)}
    text = ",".join(f"[{','.join(map(lambda e: _equation(e, place), own))}]" for _, own in equations.modes)
    modes = tuple(None if mode is None else dict(mode) for mode, _ in equations.modes)
    return Terms(tuple(known), constants, np.array(changing), modes, f"[{text}]")


def _over_time(run: Result, name: str) -> np.ndarray | None:
    """Return the values (times,) of a parameter, a variable or a derivative; None where the run does not know them."""
    for number, order in _jets(run.flat, name):
        values = run.trajectory.derivative(number, order) if order else run.values(np.array([number]))[:, 0]
        if values is not None and np.isfinite(values).any():
            return values
    return None


def _jets(flat: FlatDAE, name: str) -> Iterator[tuple[int, int]]:
    """Yield (variable, order) of what the name of a derivative may mean: der(q), and v of an equation v = der(q)."""
    base, order = base_of(name)
    found = flat.find(base)
    if found is None or len(found) != 1:
        return
    number = int(found[0])
    yield number, order
    rates = _rates(flat) if order else {}
    while order and number in rates:
        number, order = rates[number], order - 1
        yield number, order


def _rates(flat: FlatDAE) -> dict[int, int]:
    """Return the variable that an equation ``v = der(q)`` gives the derivative of another one, {q: v}."""
    found: dict[int, int] = {}
    for g in flat.groups:
        if g.left.op == g.right.op == "slot":
            (a, low), (b, high) = sorted((g.left.value, g.right.value), key=lambda s: s[1])
            if (low, high) == (0, 1):
                found |= dict(zip(g.slots[:, b].tolist(), g.slots[:, a].tolist(), strict=True))
    return found


def _equation(equation: Any, place: dict[str, int]) -> str:
    sides = (",".join(_function(c * f, place) for c, f in side) for side in (equation.left, equation.right))
    return f"[{','.join(f'[{side}]' for side in sides)}]"


def _function(term: sympy.Expr, place: dict[str, int]) -> str:
    """Return a term as a function of JavaScript, "null" where it cannot be one."""
    import sympy as sp
    from sympy.printing.jscode import JavascriptCodePrinter

    symbols = term.free_symbols
    if any(s.name not in place for s in symbols):
        return "null"
    printer = JavascriptCodePrinter({"human": False})
    _, unknown, code = printer.doprint(term.xreplace({s: sp.Symbol(f"v[{place[s.name]}]") for s in symbols}))
    return "null" if unknown or "\n" in code else f"(v)=>{code}"


def jets_data(terms: Terms, run: Result, own: OwnRun, column: int) -> list[dict[str, Any]]:
    """Return {name, value or column, register} of what the terms are made of; registers where the page's run has them.

    Parameters
    ----------
    column : the first of those of the terms' values among all of the page
    """
    found = []
    place = {n: column + k for k, n in enumerate(n for n in terms.names if n not in terms.constants)}
    for name in terms.names:
        given = {"column": place[name]} if name in place else {"value": terms.constants[name]}
        register = next((r for jet in _jets(run.flat, name) if (r := _register(own, run.flat, *jet)) >= 0), -1)
        found.append({"name": name} | given | ({"register": register} if register >= 0 else {}))
    return found


def _register(own: OwnRun, shown: FlatDAE, number: int, order: int) -> int:
    """Return the register of a jet of the run that is shown, -1 where the page's own has none."""
    if own.script is None:
        return -1
    if order:
        same = own.run.flat.find(shown.variable_name(number))
        return -1 if same is None else own.run.trajectory.observer.derivative(int(same[0]), order)
    of_kind = own.script.slots if shown.kind[number] <= Kind.PARAMETER else own.script.registers
    return int(of_kind[number])
