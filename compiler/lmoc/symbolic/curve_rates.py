"""The rates of curves that stand in equations by their names."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from lmoc.symbolic.curves import Curves
from lmoc.symbolic.kinematics import Kinematics
from lmoc.symbolic.names import base_of
from lmoc.symbolic.system import jet_symbol
from lmoc.symbolic.too_long import no_symbols

if TYPE_CHECKING:
    import sympy


def along(values: Iterable[sympy.Expr], kinematics: Kinematics, curves: Curves) -> list[sympy.Expr]:
    """Return expressions with the rates of curves by the chain rule: ``h'·φ̇`` and ``h''·φ̇² + h'·φ̈``."""
    import sympy as sp

    values = list(values)
    occurring = {base_of(s.name)[0] for value in values for s in value.free_symbols if base_of(s.name)[1]}
    rates: dict[sympy.Symbol, sympy.Expr] = {}
    for name in sorted(occurring & curves.keys()):
        over, slope = curves[name]
        first = slope or f"{name}_slope"
        second = (slope and curves[slope][1]) or (f"{slope}_slope" if slope else f"{name}_curvature")
        rate = kinematics.rate(kinematics.filled(over))
        rates[jet_symbol(name, 1)] = sp.Symbol(first) * rate
        rates[jet_symbol(name, 2)] = sp.Symbol(second) * rate**2 + sp.Symbol(first) * kinematics.rate(rate)
    return [value.xreplace(rates) for value in values]


def refuse_rates(values: Iterable[sympy.Expr], curves: Curves) -> None:
    """Raise E0660 where rates of curves are left, which are no signals of their own."""
    for s in sorted({s.name for value in values for s in value.free_symbols}):
        name, order = base_of(s)
        if order and name in curves:
            hint = "a linear model in numbers has no such limit: `lmoc linearize`"
            raise no_symbols(f"'{name}' is a curve through many points, and the equations have its derivatives", hint)
