"""One equation of motion sorted into terms, as a person writes it.

Terms in the coordinates stand on the left, highest derivative first, with collected coefficients; inputs and constants
on the right. Denominators that are plain products (a radius, a ratio) are cleared, others (``k1·k2/(k1 + k2)``) stay
where that is shorter. Nonlinear terms stay as the user factored them.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from lmoc.support.records import dataclass
from lmoc.symbolic.names import base_of
from lmoc.symbolic.notation import Formula, Notation, join_terms
from lmoc.symbolic.rational import cancelled
from lmoc.symbolic.styles import Style
from lmoc.symbolic.system import jet_symbol

if TYPE_CHECKING:
    import sympy

MOST_SIMPLIFIED = 300  # operations of a sum in which sines and cosines are put together
MOST_FACTORED = 12  # terms of a coefficient that is tried to be factored

Term = tuple["sympy.Expr", "sympy.Expr"]  # coefficient, what it multiplies


@dataclass(frozen=True, eq=False)
class Equation:
    """``Σ coefficient·factor = Σ coefficient·factor``: coordinates on the left, inputs and constants on the right."""

    coordinate: sympy.Symbol
    order: int
    left: tuple[Term, ...]
    right: tuple[Term, ...]

    @property
    def residual(self) -> sympy.Expr:
        """Left minus right side."""
        import sympy as sp

        return sp.Add(*(c * f for c, f in self.left)) - sp.Add(*(c * f for c, f in self.right))

    def write(self, notation: Notation, style: Style) -> str:
        formula = Formula(notation, style)

        def term(c: sympy.Expr, f: sympy.Expr) -> tuple[bool, str]:
            negative, text = formula.term(c, f)
            return negative, style.term(text)

        sides = (join_terms((term(c, f) for c, f in side), style) for side in (self.left, self.right))
        return style.equals.join(sides)


def sorted_equation(
    residual: sympy.Expr,
    coordinate: sympy.Symbol,
    order: int,
    coordinates: Iterable[sympy.Symbol],
    late: Iterable[str],
    clear_all: bool = False,
    drivers: frozenset[str] = frozenset(),
) -> Equation:
    """Sort a residual into terms.

    Parameters
    ----------
    residual : Expr
        In the coordinates and their derivatives ``der(q)``.
    coordinates, late : all coordinates, and the names of all inputs and coordinates
    clear_all : bool
        Clear every denominator, not only plain products.
    drivers : names of coordinates that drive the others (a current): undifferentiated, they stand on the right
    """
    import sympy as sp

    names = [q.name for q in coordinates]
    own = base_of(coordinate.name)[0]
    driving = drivers - {own}
    terms = gathered(residual, set(late))
    terms = _same_rates_together(_without_denominators(terms, clear_all))

    def moves(factor: sympy.Expr) -> bool:
        return any(base_of(s.name)[0] in names and s.name not in driving for s in factor.free_symbols)

    left = [(c, f) for c, f in terms if moves(f)]
    right = [(_sign_inside(-c), f) for c, f in terms if not moves(f)]

    def rank(term: Term):
        jets = [base_of(s.name) for s in term[1].free_symbols]
        jets = [(n, names.index(b)) for b, n in jets if b in names]
        highest = max(n for n, _ in jets)
        place = min(i for n, i in jets if n == highest)
        return (-highest, not term[1].is_Symbol, place, str(term[1]))

    left.sort(key=rank)
    right.sort(key=lambda t: (t[1] == 1, -max((base_of(s.name)[1] for s in t[1].free_symbols), default=0), str(t[1])))
    leading = next((c for c, f in left if f == jet_symbol(own, order)), left[0][0] if left else sp.S.One)
    if _is_negative(leading):
        left, right = ([(_sign_inside(-c), f) for c, f in side] for side in (left, right))
    if left and _is_negative(left[0][0]):  # θ̇2 - θ̇1 instead of -θ̇1 + θ̇2
        left.sort(key=lambda term: _is_negative(term[0]) or term[1] != jet_symbol(own, order))
    return Equation(sp.Symbol(own), order, tuple(left), tuple(right))


def solved_equation(rate: sympy.Expr, coordinate: sympy.Symbol, order: int) -> Equation:
    """Return ``q̈ = numerator/denominator`` for the solved highest derivative of a coordinate."""
    import sympy as sp

    top, bottom = sp.fraction(cancelled(rate))
    top, bottom = (_shortest_form(without_squares(sp.expand(part))) for part in (top, bottom))
    if bottom.could_extract_minus_sign():
        top, bottom = -top, -bottom
    sign = sp.Integer(-1 if _is_negative(top) else 1)
    right = ((sign, sign * top / bottom),) if top != 0 else ()
    return Equation(coordinate, order, ((sp.S.One, jet_symbol(coordinate.name, order)),), right)


def without_squares(polynomial: sympy.Expr) -> sympy.Expr:
    """A polynomial in sines and cosines with sin² + cos² = 1, whichever of the two that makes shorter.

    Angles in whose sine and cosine it is none, ``1/(1 + cos θ)``, stay as they are.
    """
    import sympy as sp

    for angle in sorted({f.args[0] for f in polynomial.atoms(sp.sin, sp.cos)}, key=sp.default_sort_key):
        pair = sp.sin(angle), sp.cos(angle)
        if not polynomial.is_polynomial(*pair):
            continue
        forms = [polynomial]
        for one, other in (pair, pair[::-1]):
            rest = sp.rem(polynomial, one**2 + other**2 - 1, one)
            forms.append(sp.expand(rest))
        polynomial = min(forms, key=lambda e: (e.count_ops(), len(sp.sstr(e))))
    return polynomial


def _shortest_form(polynomial: sympy.Expr) -> sympy.Expr:
    import sympy as sp

    forms = [polynomial, sp.factor_terms(polynomial)]
    if polynomial.is_Add and len(polynomial.args) <= MOST_FACTORED:
        forms.append(sp.factor(polynomial))
    return min(forms, key=lambda e: (e.count_ops(), len(sp.sstr(e))))


def _is_negative(coefficient: sympy.Expr) -> bool:
    import sympy as sp

    return all(t.could_extract_minus_sign() for t in sp.Add.make_args(sp.numer(sp.together(coefficient))))


def with_few_minus_signs(total: sympy.Expr) -> sympy.Expr:
    """A sum that has to vanish, or its negative where most of its terms are negative."""
    import sympy as sp

    negative = [t.could_extract_minus_sign() for t in sp.Add.make_args(total)]
    return -total if 2 * sum(negative) > len(negative) else total


def gathered(value: sympy.Expr, late: set[str]) -> list[Term]:
    """Terms with like factors put together; a factor holds all that moves (inputs, coordinates), 1 for constants."""
    import sympy as sp

    sums: dict[sympy.Expr, list] = {}
    for term in sp.Add.make_args(sp.expand_mul(value)):
        moving = [s for s in term.free_symbols if base_of(s.name)[0] in late or s.name == "time"]
        coefficient, factor = term.as_independent(*moving, as_Add=False) if moving else (term, sp.S.One)
        top, bottom = sp.fraction(factor)
        if factor.is_Add or bottom.is_Add and not bottom.free_symbols & set(moving):
            coefficient, factor = coefficient / bottom, top
        sums.setdefault(factor, []).append(coefficient)
    terms = [(lowest(sp.Add(*c)), f) for f, c in sums.items()]
    return _with_trigonometry([(c, f) for c, f in terms if c != 0])


def lowest(value: sympy.Expr) -> sympy.Expr:
    """A coefficient in lowest terms, in the shortest of some usual forms."""
    import sympy as sp

    if value.is_Number or value.is_Symbol:
        return value
    plain = cancelled(value)
    top, bottom = sp.fraction(plain)
    top = sp.expand(top)
    forms = [sp.factor_terms(plain)]
    if top.is_Add:
        alone = [x for x in top.free_symbols if top.is_polynomial(x) and sp.degree(top, x) == 1]
        forms.append(sp.collect(top, alone, sp.factor) / sp.factor(bottom))  # Jc + Js·(1 + ρ)²
    if bottom.is_Add or top.is_Add and len(top.args) <= MOST_FACTORED:
        forms.append(sp.factor(plain))
    shortest = min((plain, *forms), key=lambda e: (e.count_ops(), e.is_Add, len(sp.sstr(e))))
    return _sign_inside(shortest)


def _sign_inside(value: sympy.Expr) -> sympy.Expr:
    """``-a·(b - c)`` as ``a·(c - b)``."""
    import sympy as sp

    number, rest = value.as_coeff_Mul()
    mixed = next((f for f in sp.Mul.make_args(rest) if f.is_Add and _signs(f) == {True, False}), None)
    if number >= 0 or mixed is None:
        return value
    return sp.Mul(-number, rest / mixed, -mixed)


def _signs(total: sympy.Add) -> set[bool]:
    return {bool(term.as_coeff_Mul()[0] < 0) for term in total.args}


def _with_trigonometry(terms: list[Term]) -> list[Term]:
    """sin² + cos² = 1 and the like, among terms with the same velocities and accelerations."""
    import sympy as sp

    groups: dict[sympy.Expr, list[Term]] = {}
    for c, f in terms:
        rates = [g for g in sp.Mul.make_args(f) if _is_rate(g)]
        groups.setdefault(sp.Mul(*rates), []).append((c, f))
    result = []
    for rate, members in groups.items():
        rest = sp.Add(*(c * f / rate for c, f in members))
        short = rest.has(sp.sin) and rest.has(sp.cos) and rest.count_ops() <= MOST_SIMPLIFIED
        if len(members) > 1 and short and not _divided(rest):
            simpler = sp.trigsimp(rest)
            if simpler.count_ops() < rest.count_ops():
                members = _split(simpler, rate, members)
        result += members
    return result


def _divided(total: sympy.Expr) -> bool:
    """Return whether something is divided by sines or cosines, which SymPy takes very long to put together."""
    import sympy as sp

    return any(p.exp.could_extract_minus_sign() and p.base.has(sp.sin, sp.cos) for p in total.atoms(sp.Pow))


def _same_rates_together(terms: list[Term]) -> list[Term]:
    """``J·θ̈ + m·cos²(θ)·θ̈`` as ``(J + m·cos²(θ))·θ̈``."""
    import sympy as sp

    groups: dict[sympy.Expr, list[Term]] = {}
    for c, f in terms:
        rates = sp.Mul(*(g for g in sp.Mul.make_args(f) if _is_rate(g)))
        groups.setdefault(rates if rates != 1 else f, []).append((c, f))
    return [
        members[0] if len(members) == 1 else (_by_shared_sums(sp.Add(*(c * f / rate for c, f in members))), rate)
        for rate, members in groups.items()
    ]


def _by_shared_sums(total: sympy.Expr) -> sympy.Expr:
    """``(J + m·r²)·l − (J + m·r²)·r·φ'`` as ``(J + m·r²)·(l − r·φ')``; a sum without such a factor as it is."""
    import sympy as sp

    short = sp.factor_terms(total)
    return short if sum(f.is_Add for f in sp.Mul.make_args(short)) > 1 else total


def _is_rate(factor: sympy.Expr) -> bool:
    import sympy as sp

    base = factor.base if isinstance(factor, sp.Pow) else factor
    symbols = base.free_symbols if base.is_Add else {base} if base.is_Symbol else set()
    return bool(symbols) and all(s.name.startswith("der(") for s in symbols)  # also (φ̇1 + φ̇2)²


def _split(value: sympy.Expr, rate: sympy.Expr, members: list[Term]) -> list[Term]:
    import sympy as sp

    moving = set().union(*(f.free_symbols for _, f in members))
    sums: dict[sympy.Expr, sympy.Expr] = {}
    for term in sp.Add.make_args(sp.expand_mul(value)):
        coefficient, factor = term.as_independent(*moving, as_Add=False)
        sums[factor * rate] = sums.get(factor * rate, sp.S.Zero) + coefficient
    return [(lowest(c), f) for f, c in sums.items()]


def _without_denominators(terms: list[Term], clear_all: bool) -> list[Term]:
    """Multiply by denominators that are plain products, by others where that is shorter; take out what all share."""
    import sympy as sp

    if not terms:
        return terms
    parts = [sp.fraction(cancelled(c)) for c, _ in terms]
    plain = sp.lcm_list([_plain_factors(d) for _, d in parts])
    full = sp.lcm_list([sp.Mul(*(f for f in sp.Mul.make_args(sp.factor(d)) if not f.is_Number)) for _, d in parts])
    shared = sp.gcd_list([_plain_factors(n) for n, _ in parts]) if plain == 1 else sp.S.One
    modest = _multiplied(terms, plain / shared)
    if full == plain:
        return modest
    cleared = _multiplied(terms, full / shared)
    return cleared if clear_all or _operations(cleared) < _operations(modest) else modest


def _multiplied(terms: list[Term], factor: sympy.Expr) -> list[Term]:
    return terms if factor == 1 else [(lowest(c * factor), f) for c, f in terms]


def _operations(terms: list[Term]) -> int:
    return sum(int((c * f).count_ops()) for c, f in terms)


def _plain_factors(value: sympy.Expr) -> sympy.Expr:
    """The part of a product that consists of powers of symbols."""
    import sympy as sp

    factors = [f for f in sp.Mul.make_args(sp.factor_terms(value)) if (f.base if f.is_Pow else f).is_Symbol]
    return sp.Mul(*factors)
