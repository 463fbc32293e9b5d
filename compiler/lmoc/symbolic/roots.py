"""Real roots of the few nonlinear equations that equilibria leave: closed forms, a scan, Newton from many starts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, replace
from typing import TYPE_CHECKING

import numpy as np

from lmoc.support.records import dataclass
from lmoc.symbolic.search import dense_about_zero, fineness, plain, reach_of, rests, values_at
from lmoc.symbolic.slope import in_numpy, slope
from lmoc.symbolic.values import no_value

if TYPE_CHECKING:
    import sympy

    from lmoc.symbolic.system import SymbolicSystem

STARTS = 200
SAMPLES = 8001
DENSITY = 20.0  # of the samples about zero


@dataclass(frozen=True, eq=False)
class Root:
    """Values of the unknowns, what must hold for them to be a solution, and how they were found."""

    values: Mapping[sympy.Symbol, sympy.Expr]
    conditions: tuple[sympy.Expr, ...] = field(default_factory=tuple)
    how: str = "exact"

    def extended(self, explicit: Mapping[sympy.Symbol, sympy.Expr], numbers: Mapping) -> Root:
        """With the unknowns that follow from the others: in symbols, or all in numbers where one is a number."""
        import sympy as sp

        if any(v.has(sp.Float) for v in self.values.values()):
            explicit = {x: v.xreplace(numbers) for x, v in explicit.items()}
        more = {x: sp.simplify(v.subs(self.values)) for x, v in explicit.items()}
        return replace(self, values={**self.values, **more})


@dataclass(frozen=True, eq=False)
class Sought:
    """The result of a numeric search, and its method."""

    roots: list[Root]
    how: str


def closed_roots(equation: sympy.Expr, x: sympy.Symbol, numbers: Mapping) -> list[Root] | None:
    """All real roots of one equation in closed form, factor by factor; None where there is none for some factor."""
    import sympy as sp

    if not equation.is_polynomial(x):
        return _angles(equation, x) or None
    found: list[Root] = []
    for factor, _ in sp.factor_list(equation)[1]:
        if factor.has(x):
            exact = _closed_form(sp.Poly(factor, x), x, numbers)
            if exact is None:
                return None
            found += [Root({x: value}) for value in exact]
    return found


def _closed_form(polynomial: sympy.Poly, x: sympy.Symbol, numbers: Mapping) -> list[sympy.Expr] | None:
    """Real roots of degree one, and of ``a·(x + b)^n = c``, for even n where the sign of c/a is known; else None."""
    import sympy as sp

    n = polynomial.degree()
    a, second = polynomial.coeff_monomial(x**n), polynomial.coeff_monomial(x ** (n - 1))
    shift = sp.cancel(second / (n * a))
    if n == 1:
        return [-shift]
    rest = sp.cancel(polynomial.as_expr() - sp.expand(a * (x + shift) ** n))
    if rest.has(x):
        return None
    value = sp.cancel(-rest / a)
    if n % 2 == 1:
        return [-shift + sp.sign(value) * sp.Abs(value) ** sp.Rational(1, n)]
    known = value.xreplace(numbers)
    if not known.is_number or known == 0:
        return None
    return [-shift - value ** sp.Rational(1, n), -shift + value ** sp.Rational(1, n)] if known > 0 else []


def _angles(equation: sympy.Expr, x: sympy.Symbol) -> list[Root]:
    """Plain angles that solve a trigonometric equation whatever the parameters, if those are all there are."""
    import sympy as sp

    candidates = [sp.S.Zero, sp.pi / 2, sp.pi, -sp.pi / 2]
    exact = [c for c in candidates if equation.subs(x, c) == 0]
    factors = [f for f, _ in sp.factor_list(equation)[1] if f.has(x)]
    plain = all(f in (sp.sin(x), sp.cos(x), sp.tan(x)) for f in factors)
    return [Root({x: c}, how="exact, within one turn") for c in exact] if exact and plain else []


def _with_numbers(equations: list, unknowns: list, system: SymbolicSystem) -> list:
    done = [e.xreplace(system.numbers) for e in equations]
    missing = sorted({s.name for e in done for s in e.free_symbols - set(unknowns)})
    if missing:
        raise no_value(missing)
    return done


def _periodic(equations: list, x: sympy.Symbol) -> bool:
    import sympy as sp

    return all(sp.expand(e.subs(x, x + 2 * sp.pi) - e) == 0 for e in equations)


def scan(equation: sympy.Expr, x: sympy.Symbol, system: SymbolicSystem) -> Sought:
    """Real roots of one equation with the parameter values: all of a polynomial, else the sign changes on a grid."""
    import sympy as sp

    (equation,) = _with_numbers([equation], [x], system)
    fine = fineness(system.size)
    if equation.is_polynomial(x):
        how = "all real roots of a polynomial, with numbers"
        roots = [r for r in sp.Poly(equation, x).nroots(n=17, maxsteps=200) if abs(sp.im(r)) < 1e-12 * fine]
        return Sought([Root({x: sp.re(r)}, how=how) for r in roots], how)
    turn = _periodic([equation], x)
    grid = _turn() if turn else _spread(system.size)
    where = "within one turn" if turn else f"for |{x.name}| ≤ {reach_of(system.size):g}, dense about zero"
    how = f"sign changes at {SAMPLES} points {where}; roots that touch zero without crossing are not seen"
    return Sought([Root({x: plain(r, fine)}, how=how) for r in _sign_changes(equation, x, grid)], how)


def _turn() -> np.ndarray:
    return np.linspace(-np.pi, np.pi, SAMPLES) + 1e-8  # off the special values


def _spread(size: float) -> np.ndarray:
    """Points in the reach, their distance from each other about a hundredth of that from zero."""
    reach = reach_of(size)
    density = DENSITY + np.log(reach / (reach_of(1.0) * fineness(size)))
    return dense_about_zero(np.linspace(-1, 1, SAMPLES) + 1e-9, reach, density)


def _sign_changes(equation: sympy.Expr, x: sympy.Symbol, grid: np.ndarray) -> list[float]:
    """Zeros between points of a grid, refined by bisection; not the poles."""

    f = in_numpy(x, equation)
    with np.errstate(all="ignore"):
        value = np.broadcast_to(np.asarray(f(grid), float), grid.shape)
        changes = np.flatnonzero(np.signbit(value[:-1]) != np.signbit(value[1:]))
        found = [_bisect(f, grid[i], grid[i + 1]) for i in changes]
        return [root for root in found if abs(f(root)) < 1e-6 * np.nanmax(np.abs(value))]


def _bisect(f, low: float, high: float) -> float:
    below = np.signbit(f(low))
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if np.signbit(f(middle)) == below else (low, middle)
    return 0.5 * (low + high)


def search(equations: list, unknowns: list, system: SymbolicSystem) -> Sought:
    """Newton's method from many starts in a box, families recognized; says how thorough that was."""

    equations = _with_numbers(equations, unknowns, system)
    f = in_numpy([unknowns], equations)
    jacobian = in_numpy([unknowns], [[slope(e, x) for x in unknowns] for e in equations])
    turning = np.array([_periodic(equations, x) for x in unknowns])
    found = rests(f, jacobian, turning, STARTS, system.size)
    reach = np.where(turning, np.pi, reach_of(system.size))
    box = ", ".join(f"|{x.name}| ≤ {r:.3g}" for x, r in zip(unknowns, reach, strict=True))
    how = f"Newton's method from {STARTS} starts in {box}; there may be others"
    return Sought([Root(values_at(rest, unknowns, fineness(system.size)), how=how) for rest in found], how)
