"""The parts of a linear model of closed loops, as a person reads it: closures, balances, abbreviations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import TYPE_CHECKING

import numpy as np

from lmoc.support.records import dataclass
from lmoc.symbolic.notation import Formula, Notation
from lmoc.symbolic.styles import UNICODE, Style

if TYPE_CHECKING:
    import sympy


@dataclass(frozen=True, eq=False)
class LoopsAtRest:
    """The meaning of the symbols in a linear model of closed loops.

    Attributes
    ----------
    closures : vanish; they define the dependent coordinates at rest
    balance : vanish at rest, one for each free coordinate
    shorthand : {Symbol: Expr}
        Abbreviations in `balance` and in the short model, in order: each holds those before it.
    meaning : {Symbol: (dependent coordinate, free coordinate)}
        Of those abbreviations that are derivatives ``∂z/∂x``.
    numbers : {Symbol: number}
        Of coordinates and abbreviations at rest; empty where a parameter has no value.
    values : {Symbol: number}
        Of the parameters; NaN for one without a value.
    own_names : {coordinate name: the user's own name for it}
    """

    closures: tuple[sympy.Expr, ...]
    balance: tuple[sympy.Expr, ...]
    shorthand: Mapping[sympy.Symbol, sympy.Expr]
    meaning: Mapping[sympy.Symbol, tuple[sympy.Symbol, sympy.Symbol]]
    numbers: Mapping[sympy.Symbol, float]
    values: Mapping[sympy.Symbol, float]
    own_names: Mapping[str, str] = field(default_factory=dict)

    def insert(self, value: sympy.Expr) -> sympy.Expr:
        """Return an expression with what the abbreviations in it stand for."""
        for symbol in reversed(self.shorthand):
            value = value.xreplace({symbol: self.shorthand[symbol]})
        return value

    def notation(self, *expressions: sympy.Expr, names: Sequence[str] = ()) -> Notation:
        """Return the notation of some expressions beside the loops' own."""
        own = [*self.closures, *self.balance, *self.shorthand.values()]
        late = [s.name for s in (*self.shorthand, *self.numbers)]
        others = [name for name in names if name not in self.own_names.values()]
        return Notation.of(*expressions, *own, names=others, late=dict.fromkeys(late), given=self.own_names)

    def number(self, value: sympy.Expr) -> float:
        """Return an expression in parameters, coordinates and abbreviations as a number."""
        import sympy as sp

        table = {s: sp.Float(v, 17) for s, v in (*self.values.items(), *self.numbers.items())}
        return float(value.evalf(17, subs=table))

    def terms(self, value: sympy.Expr) -> np.ndarray:
        """Return the terms of a sum as numbers."""
        return np.array([self.number(term) for term in value.as_ordered_terms()])

    def lines(self, notation: Notation, style: Style = UNICODE) -> list[str]:
        """Return what a person reads beside the short model: closures, balances, abbreviations with their numbers."""
        formula = Formula(notation, style)
        lines = ["closures of the loops:", *(formula.sum(g) + style.equals + "0" for g in self.closures)]
        lines += ["", "at rest:", *(formula.sum(e) + style.equals + "0" for e in self.balance if e != 0)]
        lines += ["", "abbreviations:"]
        for symbol, value in self.shorthand.items():
            own = [notation.name(symbol.name, style)]
            if symbol in self.meaning:
                own.append("/".join("∂" + notation.name(q.name, style) for q in self.meaning[symbol]))
            number = [f"{self.numbers[symbol]:.6g}"] if symbol in self.numbers else []
            lines.append(style.equals.join([*own, formula.sum(value), *number]))
        places = [s for s in self.numbers if s not in self.shorthand and self.numbers[s] != 0]
        if places:
            shown = (notation.name(s.name, style) + style.equals + f"{self.numbers[s]:.6g}" for s in places)
            lines += ["", f"in numbers: {', '.join(shown)}"]
        return lines
