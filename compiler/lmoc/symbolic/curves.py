"""Curves through many points as a person writes them: ``h(φ)`` by its name, no case for each of its pieces.

The derivatives of a curve are symbols as well, ``h'`` by the name of its slope where the model has it; what moves along
a curve has rates by the chain rule, ``ḣ = h'·φ̇``. An identity in these symbols holds for any curve.

Two curves are the slopes of a place in the plane, ``x'`` and ``y'``, where the model has their length
``l = √(x'² + y'²)`` and their angle ``φ = atan2(y', x')``: then these two are the symbols, ``x' = l·cos φ`` and
``y' = l·sin φ``, and what turns with the tangent has the rate ``φ'·ṡ``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from lmoc.expression.calculus import differentiate
from lmoc.expression.dag import TIME, postorder, slot, slots
from lmoc.expression.evaluate import evaluate
from lmoc.expression.to_sympy import lower_with
from lmoc.ir.flat import FlatDAE, Group, Kind
from lmoc.ir.reduced import Reduced
from lmoc.support.records import dataclass
from lmoc.symbolic.too_long import no_symbols

if TYPE_CHECKING:
    import sympy

MOST_CASES = 60  # conditions in one equation: a table of 12 points has as many, and its equation fills a page
LEAST_CASES = 8  # of a curve that is called by its name: a table of two points has as many
_ENDINGS = "", "_slope", "_curvature"  # of the symbols of a curve and its derivatives


@dataclass(frozen=True)
class Tangent:
    """Two curves by their length and angle; all four are variables of the flat model."""

    x: int
    y: int
    length: int
    angle: int


@dataclass(frozen=True, eq=False)
class NamedCurves:
    """The curves of a flat model that stand in equations by their names.

    Attributes
    ----------
    over : {curve: what it goes over}
    slope : {curve: curve that is its slope}
    rows : {curve: (group, row, column of what it goes over)}, of a tangent's length and angle -1 as the column
    tangents : {curve that is part of one: Tangent}
    """

    flat: FlatDAE
    over: Mapping[int, int]
    slope: Mapping[int, int]
    rows: Mapping[int, tuple[Group, int, int]]
    tangents: Mapping[int, Tangent]

    def value(self, curve: int, order: int = 0) -> sympy.Expr:
        """Return a curve or one of its derivatives by what it goes over: a symbol, or by a tangent's length and angle.

        Raises
        ------
        NoSymbolsError
            E0660: there is no symbol for so high a derivative.
        """
        if order > 0 and curve in self.slope:
            return self.value(self.slope[curve], order - 1)
        tangent = self.tangents.get(curve)
        if tangent is None or curve in (tangent.length, tangent.angle):
            return self._symbol(curve, order)
        if order > 0:
            return self.derivative(self.value(curve, order - 1))
        import sympy as sp

        angle = self._symbol(tangent.angle)
        return self._symbol(tangent.length) * (sp.cos(angle) if curve == tangent.x else sp.sin(angle))

    def derivative(self, value: sympy.Expr) -> sympy.Expr:
        """Return the derivative of what holds symbols of curves over the same, by what these go over."""
        import sympy as sp

        known = [(s, *self.derivative_of[s]) for s in sorted(value.free_symbols, key=str) if s in self.derivative_of]
        return sp.Add(*(value.diff(s) * self._symbol(curve, n + 1) for s, curve, n in known))

    def _symbol(self, curve: int, order: int = 0) -> sympy.Symbol:
        import sympy as sp

        if order >= len(_ENDINGS):
            hint = "a linear model in numbers goes further: `lmoc linearize`"
            name = self.flat.variable_name(curve)
            raise no_symbols(f"'{name}' is a curve through many points, and the equations have its derivatives", hint)
        name = self.flat.variable_name(curve) + _ENDINGS[order]
        while order > 0 and self.flat.find(name) is not None:  # a name that the model has given to something else
            name += "_"
        return sp.Symbol(name)

    @cached_property
    def derivative_of(self) -> dict[sympy.Symbol, tuple[int, int]]:
        """{symbol: (curve, order of the derivative)} of all symbols there may be."""
        orders = [(v, n) for n in reversed(range(len(_ENDINGS))) for v in self.over if not (n and v in self.slope)]
        return {self._symbol(v, n): (v, n) for v, n in orders}

    def rate(self, curve: int, order: int, jet: Callable[[int], sympy.Expr]) -> sympy.Expr:
        """Return the first or second rate of a curve by the chain rule.

        Parameters
        ----------
        jet : gives the n-th rate of what it goes over
        """
        first = self.value(curve, 1) * jet(order)
        return first if order == 1 else first + self.value(curve, 2) * jet(1) ** 2

    @property
    def lengths(self) -> set[sympy.Symbol]:
        """Return the symbols of the tangents' lengths."""
        return {self._symbol(tangent.length) for tangent in self.tangents.values()}

    def number(self, symbol: sympy.Symbol, at: float, values: np.ndarray) -> float:
        """Return the number of a symbol at a place.

        Parameters
        ----------
        at : what the curve goes over
        values : (flat.count,) parameter values
        """
        curve, order = self.derivative_of[symbol]
        group, row, argument = self.rows[curve]
        if argument < 0:
            return self._of_a_tangent(curve, order, lambda s: self.number(s, at, values))
        shape, columns = group.right, group.slots[row]
        for _ in range(order):
            shape = differentiate(shape, slot(argument))
        return float(evaluate(shape, lambda k, _: at if k == argument else values[columns[k]]))

    def _of_a_tangent(self, curve: int, order: int, number: Callable[[sympy.Symbol], float]) -> float:
        """Return the number of a tangent's length or angle, or of a derivative, from those of the two curves."""
        import sympy as sp

        tangent = self.tangents[curve]
        x, y = self._symbol(tangent.x), self._symbol(tangent.y)
        value = sp.sqrt(x**2 + y**2) if curve == tangent.length else sp.atan2(y, x)
        for _ in range(order):
            value = self.derivative(value)
        return float(value.subs({s: number(s) for s in value.free_symbols}))

    def defined_by(self, group: Group, row: int) -> bool:
        """Return whether a row of a group says what one of the curves is."""
        curve = int(group.slots[row, group.left.value[0]]) if group.left.op == "slot" else -1
        return curve in self.rows and self.rows[curve][:2] == (group, row)

    def names(self, reduced: Reduced) -> dict[str, tuple[str, str]]:
        """{curve: (name of what it goes over, as equations call it; name of its slope or "")}."""
        name = self.flat.variable_name
        slopes = {v: name(w) for v, w in self.slope.items()}
        return {name(v): (_called(reduced, x), slopes.get(v, "")) for v, x in self.over.items()}


def _called(reduced: Reduced, variable: int) -> str:
    register = int(reduced.register_of[variable])
    same = register >= 0 and reduced.registers.order[register] == 0
    return reduced.flat.variable_name(int(reduced.registers.variable[register]) if same else variable)


def cases(group: Group) -> int:
    """Return the number of conditions in an equation."""
    return sum(node.op == "if" for side in (group.left, group.right) for node in postorder(side))


@lru_cache(maxsize=8)
def named_curves(flat: FlatDAE) -> NamedCurves:
    """Return the curves of a flat model that have many pieces."""
    rows = {v: (g, row, column) for g in flat.groups if cases(g) >= LEAST_CASES for v, row, column in _curves(flat, g)}
    over = {v: int(g.slots[row, column]) for v, (g, row, column) in rows.items()}
    slopes, further = _slopes(flat, rows), dict(_tangents(flat, over))
    for tangent, own in further.items():
        over |= {v: over[tangent.x] for v in (tangent.length, tangent.angle)}
        rows |= {v: (*place, -1) for v, place in own.items()}
    members = {v: t for t in further for v in (t.x, t.y, t.length, t.angle)}
    return NamedCurves(flat, over, slopes, rows, members)


def _tangents(flat: FlatDAE, over: Mapping[int, int]) -> Iterator[tuple[Tangent, dict[int, tuple[Group, int]]]]:
    """Yield pairs of curves over the same whose length and angle are variables, and where these are defined."""
    lengths: dict[tuple[int, int], tuple[int, Group, int]] = {}
    angles: dict[tuple[int, int], tuple[int, Group, int]] = {}
    for group in flat.groups if len(over) > 1 else ():
        found = _length_or_angle(group)
        if found is None:
            continue
        kind, own, x, y = found
        for row, columns in enumerate(group.slots.tolist()):
            pair = columns[x], columns[y]
            if all(v in over for v in pair) and over[pair[0]] == over[pair[1]]:
                (lengths if kind == "length" else angles)[pair] = columns[own], group, row
                if kind == "length":
                    lengths[pair[::-1]] = lengths[pair]
    for pair, (angle, group, row) in angles.items():
        if pair in lengths:
            length, other, place = lengths[pair]
            yield Tangent(*pair, length, angle), {length: (other, place), angle: (group, row)}


def _length_or_angle(group: Group) -> tuple[str, int, int, int] | None:
    """Return whether rows are ``l = √(x² + y²)`` or ``φ = atan2(y, x)``, and the columns of l or φ, x and y."""
    import sympy as sp

    moving = sorted({s.value for s in slots(group.right)})
    if group.left.op != "slot" or group.left.value[1] != 0 or len(moving) != 2 or any(order for _, order in moving):
        return None
    (a, _), (b, _) = moving
    one, two = sp.symbols("one two", real=True)
    value = lower_with(group.right, lambda k, _: one if k == a else two, {})
    forms = {
        sp.sqrt(one**2 + two**2): ("length", a, b),
        sp.atan2(two, one): ("angle", a, b),
        sp.atan2(one, two): ("angle", b, a),
    }
    kind = forms.get(value)
    return None if kind is None else (kind[0], group.left.value[0], *kind[1:])


def _curves(flat: FlatDAE, group: Group) -> Iterator[tuple[int, int, int]]:
    """Yield (variable, row, column of what it goes over) of the rows of a group ``v = f(x)``."""
    moving = {s.value for s in slots(group.right) if flat.kind[group.slots[0, s.value[0]]] >= Kind.INPUT}
    if group.left.op != "slot" or group.left.value[1] != 0 or len(moving) != 1 or TIME in postorder(group.right):
        return  # what moves by itself, too, has other rates
    ((argument, order),) = moving
    column = group.left.value[0]
    if order == 0 and flat.kind[group.slots[0, column]] == Kind.UNKNOWN:
        yield from ((v, row, argument) for row, v in enumerate(group.slots[:, column].tolist()))


def _slopes(flat: FlatDAE, rows: Mapping[int, tuple[Group, int, int]]) -> dict[int, int]:
    """Return {curve: curve that is its slope}: with the pieces' coefficients as symbols, they are polynomials."""
    import sympy as sp

    pieces: dict[tuple, sympy.Dummy] = {}
    x = sp.Dummy("x")
    over = {v: g.slots[row, column] for v, (g, row, column) in rows.items()}
    form = {v: _on_a_piece(flat, g, row, column, x, pieces) for v, (g, row, column) in rows.items()}
    return {
        v: w
        for v in form
        for w in form
        if v != w and over[v] == over[w] and sp.expand(sp.diff(form[v], x) - form[w]) == 0 and form[w] != 0
    }


def _on_a_piece(flat: FlatDAE, group: Group, row: int, argument: int, x: sympy.Dummy, pieces: dict) -> sympy.Expr:
    """Return a curve where it does not pass from one piece to the next: what depends on the piece is a symbol."""
    import sympy as sp

    def column(k: int, _: int) -> sympy.Expr:
        return x if k == argument else sp.Symbol(flat.variable_name(int(group.slots[row, k])))

    def constant(*key: object) -> sympy.Dummy:
        return pieces.setdefault(key, sp.Dummy())

    def choice(condition: sympy.Basic, yes: sympy.Expr, no: sympy.Expr) -> sympy.Expr:
        moving = x in yes.free_symbols | no.free_symbols
        return sp.Piecewise((yes, condition), (no, True)) if moving else constant(condition, yes, no)

    def modulo(value: sympy.Expr, period: sympy.Expr) -> sympy.Expr:
        return value - period * constant("turns", value, period)

    return lower_with(group.right, column, {"if": choice, "mod": modulo})
