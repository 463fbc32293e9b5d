"""Transfer functions and input–output equations, in symbols.

The determinant of the bordered polynomial matrix ``[[sI − A, −b(s)], [c, d(s)]]`` over that of ``sI − A``, rows scaled
free of fractions, so that everything happens in a ring of polynomials: nothing is expanded that does not stay.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from lmoc.symbolic.linearize import LinearModel
from lmoc.symbolic.notation import Notation
from lmoc.symbolic.styles import UNICODE, Style
from lmoc.symbolic.system import refuse

if TYPE_CHECKING:
    import sympy

MOST_STATES = 24
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
    """

    input: str
    output: str
    numerator: sympy.Expr
    denominator: sympy.Expr
    cancelled: tuple[sympy.Expr, ...]
    values: Mapping[sympy.Symbol, float]
    point: Mapping[str, sympy.Expr] = field(default_factory=dict)

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
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self.expression, name)

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
        return top / bottom[0], bottom / bottom[0]

    def _numbers(self, polynomial: sympy.Expr) -> np.ndarray:
        import sympy as sp

        from lmoc.expression.to_sympy import exact

        table = {p: exact(v) for p, v in self.values.items() if not np.isnan(v)}
        value = sp.Poly(polynomial.xreplace(table), self.s)
        missing = sorted(x.name for x in value.free_symbols_in_domain)
        if missing:
            raise refuse(f"poles and zeros need values for {', '.join(missing)}", hint="use `--set name=value`")
        return np.array([float(c) for c in value.all_coeffs()])

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

    def to_control(self):
        """A control.TransferFunction (python-control must be installed)."""
        import control

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
    """det(sI − A) in lowest terms, free of fractions, as a polynomial in ``Symbol("s")``."""
    import sympy as sp

    return _normal(_determinant(_pencil(model)[0]), sp.Symbol("s"))


def transfer_function(model: LinearModel, u: str, y: str, values: Mapping | None = None) -> TransferFunction:
    """Transfer function from one input to one output of a symbolic linear model.

    Raises
    ------
    ModelError
        E0661 for an unknown name, E0660 where there are too many states for symbols.
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
        sp.Matrix.hstack(pencil, sp.Matrix([-sp.cancel(d) for d in drive]).reshape(pencil.rows, 1)),
        sp.Matrix([[*(sp.cancel(last * c) for c in model.C[row, :]), sp.cancel(last * through)]]),
    )
    full = _determinant(pencil)
    top, bottom = sp.fraction(sp.cancel(_determinant(bordered) / (full * last)))
    if sp.Poly(bottom, s).LC().could_extract_minus_sign():
        top, bottom = sp.expand(-top), sp.expand(-bottom)
    point = {n: v for n, v in model.point.items() if str(v) != n}
    common = _cancelled(full, bottom, s)
    return TransferFunction(u, y, _collect(top, s), _collect(bottom, s), common, dict(values or {}), point)


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
        raise refuse(f"{n} states are too many for a transfer function", hint="`lmoc linearize` has no such limit")


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
    _check_states(n)
    scales, rows = [], []
    for i in range(n):
        entries = [sp.cancel(model.A[i, j]) for j in range(n)]
        drives = [sp.cancel(B[i, j]) for B in model.Bs for j in range(B.cols)]
        scale = sp.lcm_list([sp.fraction(e)[1] for e in [*entries, *drives]] or [sp.S.One])
        rows.append([sp.cancel(scale * ((s if i == j else 0) - e)) for j, e in enumerate(entries)])
        scales.append(scale)
    return sp.Matrix(n, n, [e for row in rows for e in row]), scales


def _determinant(matrix: sympy.Matrix) -> sympy.Expr:
    """Determinant over the ring of polynomials; rows or columns with a single entry are expanded first."""
    import sympy as sp
    from sympy.polys.matrices import DomainMatrix

    factor = sp.S.One
    while matrix.rows:
        found = _single_entry(matrix)
        if found is None:
            break
        i, j = found
        factor *= (-1) ** (i + j) * matrix[i, j]
        matrix = matrix.minor_submatrix(i, j)
    if not matrix.rows:
        return factor
    dense = DomainMatrix.from_Matrix(matrix)
    return sp.expand(factor * dense.domain.to_sympy(dense.charpoly()[-1] * (-1) ** matrix.rows))


def _single_entry(matrix: sympy.Matrix) -> tuple[int, int] | None:
    for i in range(matrix.rows):
        row = [j for j in range(matrix.cols) if matrix[i, j] != 0]
        if len(row) == 1:
            return i, row[0]
        column = [j for j in range(matrix.rows) if matrix[j, i] != 0]
        if len(column) == 1:
            return column[0], i
    return None


def _cancelled(full: sympy.Expr, left: sympy.Expr, s: sympy.Symbol) -> tuple[sympy.Expr, ...]:
    """Factors in s of the characteristic polynomial that are no longer in the denominator."""
    import sympy as sp

    rest = sp.factor_list(sp.numer(sp.cancel(full / left)))[1]
    return tuple(_collect(factor, s) for factor, count in rest for _ in range(count) if factor.has(s))


def _normal(value: sympy.Expr, s: sympy.Symbol) -> sympy.Expr:
    import sympy as sp

    factors = [f**n for f, n in sp.factor_list(sp.expand(value))[1] if f.has(s)]
    return _collect(sp.expand(sp.Mul(*factors)), s)


def _collect(value: sympy.Expr, s: sympy.Symbol) -> sympy.Expr:
    import sympy as sp

    return sp.collect(sp.expand(value), s, sp.factor_terms)
