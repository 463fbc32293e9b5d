"""Transfer functions and input–output equations, in symbols.

The determinant of the bordered polynomial matrix ``[[sI − A, −b(s)], [c, d(s)]]`` over that of ``sI − A``, rows scaled
free of fractions, so that everything happens in a ring of polynomials: nothing is expanded that does not stay.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from lmoc.support.records import dataclass
from lmoc.symbolic.determinant import TooLongError, determinant
from lmoc.symbolic.linearize import LinearModel, python_control
from lmoc.symbolic.notation import Notation
from lmoc.symbolic.rational import cancelled
from lmoc.symbolic.styles import LATEX, UNICODE, Style
from lmoc.symbolic.system import refuse
from lmoc.symbolic.too_long import NoSymbolsError, no_symbols

if TYPE_CHECKING:
    import sympy

    from lmoc.symbolic.loops_at_rest import LoopsAtRest

MOST_STATES = 24
MOST_TERMS = 4_000  # of the minors of a determinant; more is not tried in symbols
MOST_SHOWN = 160  # terms of numerator and denominator; longer ones are given in numbers
ROUNDED = 1e-11  # of the terms of a difference: less is rounding


@dataclass(frozen=True, eq=False, repr=False)
class TransferFunction:
    """``output = numerator(s)/denominator(s) · input``, without common factors.

    Attributes
    ----------
    numerator, denominator : polynomials in `s`
    cancelled : tuple of polynomials
        Factors in s that numerator and characteristic polynomial had in common: modes that this output does not
        show or this input does not move.
    values : {Symbol: float}
        Parameter values for poles, zeros and plots.
    point : {name: value}
        States and inputs about which a nonlinear scene is linear; empty for a linear one.
    short : TransferFunction | None
        Of closed loops: the same with the abbreviations that `loops` explains.
    loops : LoopsAtRest | None
    """

    input: str
    output: str
    numerator: sympy.Expr
    denominator: sympy.Expr
    cancelled: tuple[sympy.Expr, ...]
    values: Mapping[sympy.Symbol, float]
    point: Mapping[str, sympy.Expr] = field(default_factory=dict)
    short: TransferFunction | None = None
    loops: LoopsAtRest | None = None

    @property
    def s(self) -> sympy.Symbol:
        import sympy as sp

        return sp.Symbol("s")

    @property
    def expression(self) -> sympy.Expr:
        return self.numerator / self.denominator

    def _sympy_(self) -> sympy.Expr:
        return self.expression

    def __getattr__(self, name: str):
        """Whatever a SymPy expression can do."""
        if not name.startswith("_") and hasattr(self.expression, name):
            return getattr(self.expression, name)
        raise AttributeError(f"a transfer function has no attribute '{name}'")

    def __add__(self, other) -> sympy.Expr:
        return self.expression + other

    def __sub__(self, other) -> sympy.Expr:
        return self.expression - other

    def __mul__(self, other) -> sympy.Expr:
        return self.expression * other

    def __truediv__(self, other) -> sympy.Expr:
        return self.expression / other

    def __neg__(self) -> sympy.Expr:
        return -self.expression

    def __str__(self) -> str:
        return str(self.expression)

    __repr__ = __str__

    @cached_property
    def coefficients(self) -> tuple[np.ndarray, np.ndarray]:
        """Numerator and denominator as numbers, highest power first; the denominator's leading one is 1."""
        top, bottom = (self._numbers(e) for e in (self.numerator, self.denominator))
        with np.errstate(all="ignore"):
            top, bottom = top / bottom[0], bottom / bottom[0]
        if not (np.isfinite(top).all() and np.isfinite(bottom).all()):
            raise refuse("its coefficients are too large for numbers", hint="look at very large and very small values")
        return top, bottom

    def _numbers(self, polynomial: sympy.Expr) -> np.ndarray:
        import sympy as sp

        from lmoc.expression.to_sympy import exact

        table = {p: exact(v) for p, v in self.values.items() if not np.isnan(v)}
        value = sp.Poly(polynomial.xreplace(table), self.s)
        missing = sorted(x.name for x in value.free_symbols_in_domain)
        if missing:
            raise refuse(f"poles and zeros need values for {', '.join(missing)}", hint="use `--set name=value`")
        return np.array([float(c.evalf(17)) for c in value.all_coeffs()])

    @cached_property
    def numeric(self) -> TransferFunction:
        """The same with numbers for the parameters, its denominator's leading coefficient 1.

        Raises
        ------
        ModelError
            E0660 for a parameter without a value.
        """
        top, bottom = (_with_numbers(p.tolist(), self.s) for p in self.coefficients)
        return replace(self, numerator=top, denominator=bottom, cancelled=(), values={}, short=None, loops=None)

    @property
    def poles(self) -> np.ndarray:
        return np.roots(self.coefficients[1])

    @property
    def zeros(self) -> np.ndarray:
        return np.roots(self.coefficients[0])

    @property
    def gain(self) -> float:
        """Static gain; infinite where a pole is at zero."""
        top, bottom = self.coefficients
        with np.errstate(divide="ignore", invalid="ignore"):
            return float(np.float64(top[-1]) / np.float64(bottom[-1]))

    @property
    def input_output_equation(self) -> InputOutputEquation:
        """The differential equation that ties output and input, in the operator p = d/dt."""
        import sympy as sp

        p = {self.s: sp.Symbol("p")}
        return InputOutputEquation(self.input, self.output, self.denominator.xreplace(p), self.numerator.xreplace(p))

    def response(self, omega: np.ndarray) -> np.ndarray:
        """Frequency response at angular frequencies in rad/s."""
        top, bottom = self.coefficients
        return np.polyval(top, 1j * omega) / np.polyval(bottom, 1j * omega)

    def to_scipy(self):
        from scipy.signal import TransferFunction as Scipy

        return Scipy(*self.coefficients)

    def _repr_latex_(self) -> str:
        """Return the LaTeX representation for notebooks."""
        notation = Notation.of(self.numerator, self.denominator, names=(self.output, self.input))
        quotient = notation.quotient(self.numerator, self.denominator, "s", LATEX)
        names = (notation.name(name, LATEX) for name in (self.output, self.input))
        return "$\\displaystyle \\frac{{{}}}{{{}}} = {}$".format(*names, quotient)

    def to_control(self):
        """Return a control.TransferFunction.

        Raises
        ------
        ModuleNotFoundError
            The package python-control is not installed.
        """
        control = python_control()
        return control.tf(*self.coefficients, inputs=self.input, outputs=self.output)


@dataclass(frozen=True)
class InputOutputEquation:
    """``left(p)·output = right(p)·input`` with the derivative operator p = d/dt."""

    input: str
    output: str
    left: sympy.Expr
    right: sympy.Expr

    def __iter__(self) -> Iterator[sympy.Expr]:
        return iter((self.left, self.right))

    def __str__(self) -> str:
        notation = Notation.of(self.left, self.right, names=(self.input, self.output))
        return self.write(notation, UNICODE)

    def _repr_latex_(self) -> str:
        """Return the LaTeX representation for notebooks."""
        notation = Notation.of(self.left, self.right, names=(self.input, self.output))
        return f"$\\displaystyle {self.write(notation, LATEX)}$"

    def write(self, notation: Notation, style: Style) -> str:
        """In the names and the style given."""
        sides = ((self.left, self.output), (self.right, self.input))
        return style.equals.join(_side(notation, style, operator, name) for operator, name in sides)


def _side(notation: Notation, style: Style, operator: sympy.Expr, name: str) -> str:
    """``(J·p² + k) y``; a factor one is not written, and nothing is left of a factor zero."""
    shown = notation.name(name, style)
    if operator == 0:
        return style.number("0")
    if operator in (1, -1):
        return shown if operator == 1 else style.sign + shown
    return notation.polynomial(operator, "p", style) + style.applied + shown


def characteristic_polynomial(model: LinearModel) -> sympy.Expr:
    """Return det(sI − A) in lowest terms, free of fractions, as a polynomial in ``Symbol("s")``."""
    import sympy as sp

    return _normal(_determinant(_pencil(model)[0]), sp.Symbol("s"))


def transfer_function(model: LinearModel, u: str, y: str, values: Mapping | None = None) -> TransferFunction:
    """Return the transfer function from one input to one output of a symbolic linear model.

    Raises
    ------
    ModelError
        E0661 for an unknown name, E0660 (`NoSymbolsError`) where the symbols grow long.
    """
    import sympy as sp

    s = sp.Symbol("s")
    column, row = index_of(model.inputs, u, "input"), index_of(model.outputs, y, "output")
    pencil, scale = _pencil(model)
    drive = [
        scale[i] * sum((B[i, column] * s**k for k, B in enumerate(model.Bs)), sp.S.Zero) for i in range(len(scale))
    ]
    through = sum((D[row, column] * s**k for k, D in enumerate(model.Ds)), sp.S.Zero)
    last = sp.lcm_list([sp.fraction(sp.together(c))[1] for c in [*model.C[row, :], through]] or [sp.S.One])
    bordered = sp.Matrix.vstack(
        sp.Matrix.hstack(pencil, sp.Matrix([-cancelled(d) for d in drive]).reshape(pencil.rows, 1)),
        sp.Matrix([[*(cancelled(last * c) for c in model.C[row, :]), cancelled(last * through)]]),
    )
    full = _determinant(pencil)
    top, bottom = sp.fraction(cancelled(_determinant(bordered) / (full * last)))
    if sp.Poly(bottom, s).LC().could_extract_minus_sign():
        top, bottom = sp.expand(-top), sp.expand(-bottom)
    if len(sp.Add.make_args(sp.expand(top))) + len(sp.Add.make_args(sp.expand(bottom))) > MOST_SHOWN:
        raise _too_long()
    point = {n: v for n, v in model.point.items() if str(v) != n}
    common = _cancelled(full, bottom, s)
    return TransferFunction(u, y, _collect(top, s), _collect(bottom, s), common, dict(values or {}), point)


def transfer_function_of_loops(model: LinearModel, u: str, y: str) -> TransferFunction:
    """As `transfer_function`, of closed loops about a state of rest."""
    loops = model.loops
    short = transfer_function(model.short, u, y, {**loops.values, **loops.numbers})
    top, bottom = (loops.insert(polynomial) for polynomial in (short.numerator, short.denominator))
    factors = tuple(map(loops.insert, short.cancelled))
    return replace(short, numerator=top, denominator=bottom, cancelled=factors, short=short, loops=loops)


def transfer_function_of_numbers(model: LinearModel, u: str, y: str) -> TransferFunction:
    """As `transfer_function`, of a model in numbers: ``det(sI − A + b c) + (d − 1)·det(sI − A)`` over ``det(sI − A)``.

    Common factors are not looked for; coefficients that rounding alone has left are zero.

    Raises
    ------
    ModelError
        E0661 for an unknown name, E0660 where there are too many states for polynomials.
    """
    import sympy as sp

    column, row = index_of(model.inputs, u, "input"), index_of(model.outputs, y, "output")
    _check_states(len(model.states))
    proper = model.realization()
    A, b, c = proper.A, proper.B[:, [column]], proper.C[[row]]
    bottom, closed = (np.poly(M) if len(A) else np.ones(1) for M in (A, A - b @ c))
    top = np.where(np.abs(closed - bottom) <= ROUNDED * (np.abs(closed) + np.abs(bottom)), 0.0, closed - bottom)
    for k, D in enumerate(proper.Ds):
        top = np.polyadd(top, np.polymul(bottom, [float(D[row, column]), *[0.0] * k]))
    s = sp.Symbol("s")
    point = {name: sp.Float(value) for name, value in model.point.items() if value != 0}
    top, bottom = (_with_numbers(p.tolist(), s) for p in (top, bottom))
    return TransferFunction(u, y, top, bottom, (), {}, point)


def _with_numbers(coefficients: list[float], s: sympy.Symbol) -> sympy.Expr:
    """A polynomial, highest power first; whole numbers as such."""
    import sympy as sp

    exact = [sp.Integer(round(c)) if abs(c - round(c)) <= 1e-14 * abs(c) else sp.Float(c, 15) for c in coefficients]
    return sp.Add(*(c * s**n for n, c in enumerate(reversed(exact))))


def _check_states(n: int) -> None:
    if n > MOST_STATES:
        raise refuse(f"{n} states are too many for a transfer function", hint="`lmoc linearize` goes further")


def index_of(names: list[str], name: str, what: str) -> int:
    """Place of a name; E0661 for one that is not there."""
    from lmoc.messages.diagnostics import Diagnostic, ModelError, nearest

    if name in names:
        return names.index(name)
    hint = nearest(name, names) or f"{what}s are: {', '.join(names) or 'none'}"
    raise ModelError([Diagnostic("E0661", f"there is no {what} '{name}'", hint=hint)])


def _pencil(model: LinearModel) -> tuple[sympy.Matrix, list[sympy.Expr]]:
    """``sI − A`` with each row scaled free of fractions, and the scales."""
    import sympy as sp

    s = sp.Symbol("s")
    n = len(model.states)
    if n > MOST_STATES:
        raise _too_long()
    scales, rows = [], []
    for i in range(n):
        entries = [cancelled(model.A[i, j]) for j in range(n)]
        drives = [cancelled(B[i, j]) for B in model.Bs for j in range(B.cols)]
        scale = sp.lcm_list([sp.fraction(e)[1] for e in [*entries, *drives]] or [sp.S.One])
        rows.append([cancelled(scale * ((s if i == j else 0) - e)) for j, e in enumerate(entries)])
        scales.append(scale)
    return sp.Matrix(n, n, [e for row in rows for e in row]), scales


def _determinant(matrix: sympy.Matrix) -> sympy.Expr:
    """Determinant of a matrix of polynomials, multiplied out."""
    import sympy as sp
    from sympy.polys.constructor import construct_domain

    entries = matrix.todok()
    domain, elements = construct_domain([sp.S.One, *entries.values()], field=False)
    if not domain.is_Composite:
        domain, elements = construct_domain([sp.S.One, *entries.values(), sp.Symbol("s")], field=False)
    rows: list[dict] = [{} for _ in range(matrix.rows)]
    for (i, j), element in zip(entries, elements[1:], strict=False):
        rows[i][j] = element
    try:
        return domain.to_sympy(determinant(rows, domain.one, MOST_TERMS))
    except TooLongError:
        raise _too_long() from None


def _too_long() -> NoSymbolsError:
    return no_symbols("the transfer function in symbols is too long to be read", hint="`.numeric` has numbers")


def _cancelled(full: sympy.Expr, left: sympy.Expr, s: sympy.Symbol) -> tuple[sympy.Expr, ...]:
    """Factors in s of the characteristic polynomial that are no longer in the denominator."""
    import sympy as sp

    rest = sp.factor_list(sp.numer(cancelled(full / left)))[1]
    return tuple(_collect(factor, s) for factor, count in rest for _ in range(count) if factor.has(s))


def _normal(value: sympy.Expr, s: sympy.Symbol) -> sympy.Expr:
    import sympy as sp

    factors = [f**n for f, n in sp.factor_list(sp.expand(value))[1] if f.has(s)]
    return _collect(sp.expand(sp.Mul(*factors)), s)


def _collect(value: sympy.Expr, s: sympy.Symbol) -> sympy.Expr:
    import sympy as sp

    return sp.collect(sp.expand(value), s, sp.factor_terms)
