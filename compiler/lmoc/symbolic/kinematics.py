"""Known motion, without any balance of forces: parameters, inputs, states, positions, and their rates."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from lmoc.ir.flat import Kind
from lmoc.symbolic.slope import slope
from lmoc.symbolic.system import Outline, SymbolicInterpreter, jet_symbol

if TYPE_CHECKING:
    import sympy

    from lmoc.ir.reduced import Reduced


class Kinematics:
    """Known motion: parameters, inputs, states and potentials, in jets of the coordinates.

    Parameters
    ----------
    closures : vanish along the motion. A position that they make shorter is written the short way: around a loop the
        centre of a rocker hangs on its own pin, and not on crank and coupler.
    """

    def __init__(
        self,
        interpreter: SymbolicInterpreter,
        system: Outline,
        potentials: list[int],
        closures: Sequence[sympy.Expr] = (),
    ):
        reduced = interpreter.reduced
        self.interpreter = interpreter
        self._closures = closures
        self._shortest: dict[sympy.Expr, sympy.Expr] = {}
        self.coordinates = [system.states[q] for q, _ in system.coordinates]
        self.orders = [2 if v >= 0 else 1 for _, v in system.coordinates]
        self._velocity = {
            system.states[v]: jet_symbol(system.states[q].name, 1) for q, v in system.coordinates if v >= 0
        }
        self._quadrature = self._quadratures(reduced)
        registers = [*reduced.states.tolist(), *reduced.quadratures.tolist()]
        held = {int(reduced.registers.variable[r]) for r in registers if reduced.registers.order[r] == 0}
        interpreter.fill([int(reduced.register_of[v]) for v in potentials if reduced.register_of[v] >= 0])
        self.curves = interpreter.curves
        self.known = held | set(potentials) | (set() if self.curves is None else self.curves.over.keys())

    def _quadratures(self, reduced: Reduced) -> dict:
        names = [self.interpreter.w[int(r)] for r in reduced.quadratures]
        rates = [int(r) for r in reduced.quadrature_derivatives]
        self.interpreter.fill(rates)
        return {z: self._in_jets(self.interpreter.w[r]) for z, r in zip(names, rates, strict=True)}

    @property
    def parameters(self) -> set[sympy.Symbol]:
        """Return the symbols of the parameters met so far."""
        return set(self.interpreter.parameters.variable)

    def _in_jets(self, value: sympy.Expr) -> sympy.Expr:
        return value.xreplace(self._velocity)

    def value(self, variable: int) -> sympy.Expr:
        flat = self.interpreter.reduced.flat
        if flat.kind[variable] == Kind.INPUT:
            return jet_symbol(flat.variable_name(variable), 0)
        if self.curves is not None and variable in self.curves.over:
            return self.curves.value(variable)
        value = self._in_jets(self.interpreter.variable(variable))
        if not self._closures:
            return value
        if value not in self._shortest:
            self._shortest[value] = shortest(value, self._closures)
        return self._shortest[value]

    def rate(self, value: sympy.Expr) -> sympy.Expr:
        """Total time derivative."""
        import sympy as sp

        terms = [slope(value, x) * self._rate_of(x) for x in sorted(value.free_symbols, key=lambda s: s.name)]
        return sp.Add(*terms)

    def _rate_of(self, x: sympy.Symbol) -> sympy.Expr:
        import sympy as sp

        if x in self._quadrature:
            return self._quadrature[x]
        if x.name == "time":
            return sp.S.One
        if self.curves is not None and x in self.curves.derivative_of:
            curve, order = self.curves.derivative_of[x]
            return self.curves.value(curve, order + 1) * self.rate(self._in_jets(self.interpreter.argument(curve)))
        base = x.name
        order = 0
        while base.startswith("der("):
            base, order = base[4:-1], order + 1
        symbol = sp.Symbol(base)
        if symbol in self.coordinates or symbol in self.interpreter.input_symbols:
            return jet_symbol(base, order + 1)
        return sp.S.Zero


def shortest(value: sympy.Expr, closures: Sequence[sympy.Expr]) -> sympy.Expr:
    """Return a sum less such multiples of closures as leave fewer operations.

    A multiple cancels one term of the sum by one of the closure's; each step shortens, so there are few.
    """
    import sympy as sp

    value = sp.expand(value)
    while True:
        own = value.as_coefficients_dict()
        others = [
            sp.expand(value - own[term] / c * g)
            for g in closures
            for term, c in g.as_coefficients_dict().items()
            if term != 1 and own.get(term, 0) != 0
        ]
        best = min((value, *others), key=sp.count_ops)
        if best is value:
            return value
        value = best
