"""Formulas written as a person would, in one of the styles of `symbolic.styles`.

SymPy's own printers sort for machines. Here parameters come before powers, inputs and coordinates last, derivatives are
dots, and what counts up comes before what is subtracted: ``(J + m·r²)·θ̈ + c·θ̇ + k·r²·θ``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import field, replace
from typing import TYPE_CHECKING

from lmoc.support.records import dataclass
from lmoc.symbolic.names import base_of, short_names
from lmoc.symbolic.styles import ASCII, UNICODE, Style

if TYPE_CHECKING:
    import sympy


@dataclass(frozen=True)
class Notation:
    """Names of symbols and the order in which they are written.

    Attributes
    ----------
    short : {full name: name shown}
    late : frozenset of full names
        Inputs and coordinates: written after the parameters, coordinates last.
    """

    short: dict[str, str]
    late: dict[str, int] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        *expressions: sympy.Expr,
        names: Iterable[str] = (),
        late: Iterable[str] = (),
        given: Mapping[str, str] | None = None,
    ) -> Notation:
        """For the symbols of some expressions and further names; `given` as in `short_names`."""
        found = sorted({base_of(s.name)[0] for e in expressions for s in e.free_symbols})
        late = [base_of(n)[0] for n in late]
        shown = short_names([*late, *(base_of(n)[0] for n in names), *found], given)
        return cls(shown, {n: i for i, n in enumerate(late)})

    def name(self, full: str, style: Style = UNICODE) -> str:
        base, order = base_of(full)
        return style.symbol(self.short.get(base, base), order)

    def text(self, value: sympy.Expr, style: Style = UNICODE) -> str:
        return Formula(self, style).sum(value)

    def polynomial(self, value: sympy.Expr, variable: str, style: Style = UNICODE, bare: bool = False) -> str:
        """A polynomial by falling powers of its variable, in brackets where it has several terms, unless `bare`."""
        import sympy as sp

        x = sp.Symbol(variable)
        formula = Formula(replace(self, late={variable: 0}), style)  # its powers come last
        terms = sp.Poly(value, x).terms() if value.has(x) else [((0,), value)]
        parts = [formula.term(sp.factor_terms(_whole(c)), x**n if n else None) for (n,), c in terms]
        if len(parts) > 1 and all(negative for negative, _ in parts):
            return style.sign + style.brackets(join_terms(((False, text) for _, text in parts), style))
        text = join_terms(parts, style)
        a_sum = len(parts) > 1 or not value.has(x) and value.is_Add
        return style.brackets(text) if a_sum and not bare else text

    def quotient(self, top: sympy.Expr, bottom: sympy.Expr, variable: str, style: Style = UNICODE) -> str:
        """A rational function as one fraction, a sign that all of the numerator has before it."""
        import sympy as sp

        if all(_is_negative(c) for c in sp.Poly(top, sp.Symbol(variable)).coeffs()) and top != 0:
            return style.sign + self.quotient(sp.expand(-top), bottom, variable, style)
        above = self.polynomial(top, variable, style, bare=style.fills or bottom == 1)
        if bottom == 1:
            return above
        below = self.polynomial(bottom, variable, style, bare=True)
        return style.fraction(above, below, bottom.is_Symbol or bottom.is_Number)

    def legend(self, style: Style = UNICODE) -> list[str]:
        """Lines with what each abbreviation stands for, after an empty one; nothing where there is none."""
        table = [(style.symbol(short, 0), in_words(full)) for short, full in self.abbreviations.items()]
        width = max((len(short) for short, _ in table), default=0)
        return ["", "with", *(f"  {short:<{width}}  {full}" for short, full in table)] if table else []

    @property
    def abbreviations(self) -> dict[str, str]:
        """{name shown: full name} where they differ."""
        return {short: full for full, short in self.short.items() if short != full}


def in_words(full: str) -> str:
    """Return a full name as a person reads it."""
    return f"deviation of {full[1:]}" if full.startswith("δ") else full


def join_terms(parts: Iterable[tuple[bool, str]], style: Style) -> str:
    """Terms (negative?, text) as a sum."""
    text = ""
    for negative, part in parts:
        lead = (style.minus if negative else style.plus) if text else (style.sign if negative else "")
        text += lead + part
    return text or style.number("0")


@dataclass(frozen=True)
class Formula:
    """Writes expressions in one notation and style."""

    notation: Notation
    style: Style

    def term(self, coefficient: sympy.Expr, factor: sympy.Expr | None) -> tuple[bool, str]:
        """``coefficient·factor`` as (negative?, text); a sum as coefficient stays in brackets."""
        import sympy as sp

        negative = _is_negative(coefficient)
        coefficient = -coefficient if negative else coefficient
        if factor is None or factor == 1:
            if isinstance(coefficient, sp.Add):
                return negative, self.style.brackets(self.sum(coefficient)) if negative else self.sum(coefficient)
            return negative, self.product(coefficient)
        if isinstance(coefficient, sp.Add):
            return negative, self.style.brackets(self.sum(coefficient)) + self.style.times + self.product(factor)
        if sp.denom(coefficient).is_Add or self.style.fills and sp.denom(coefficient) != 1:
            return negative, self.product(coefficient) + self.style.times + self.product(factor)
        return negative, self.product(sp.Mul(coefficient, factor, evaluate=False))

    def sum(self, value: sympy.Expr) -> str:
        import sympy as sp

        terms = [(_is_negative(t), t) for t in sp.Add.make_args(value)]
        parts = [(negative, self.product(-t if negative else t), t) for negative, t in terms]
        parts.sort(key=lambda p: (p[0], self._place(p[2]), self._spoken(p[2])))
        return join_terms(((negative, text) for negative, text, _ in parts), self.style)

    def _spoken(self, term: sympy.Expr) -> tuple[str, str]:
        """Return the sort key of a term of a sum: the term without its number, in any style the same."""
        number, rest = term.as_coeff_Mul()
        return Formula(self.notation, ASCII).product(rest if rest != 1 else abs(number)), str(number)

    def _place(self, term: sympy.Expr) -> int:
        """Plain coordinates first (``q2 + L - d0``), then constants, then the rest (``J + m·cos²(θ)``)."""
        if not self._moves(term):
            return 1
        return 0 if term.as_coeff_Mul()[1].is_Symbol else 2

    def _moves(self, value: sympy.Expr) -> bool:
        return any(base_of(s.name)[0] in self.notation.late for s in value.free_symbols)

    def product(self, value: sympy.Expr) -> str:
        import sympy as sp

        if isinstance(value, sp.Add):
            return self.style.brackets(self.sum(value))
        if value.is_Number:
            return self.number(value)
        top, bottom = [], []
        number = sp.S.One
        for factor in _with_odd_roots(_factors(value)):
            if factor.is_Rational:
                number *= factor
            elif isinstance(factor, sp.Pow) and _is_negative(factor.exp):
                bottom.append(1 / factor)
            else:
                top.append(factor)
        if number.q != 1 and not _decimal(number):
            bottom.insert(0, sp.Integer(number.q))
            number = sp.Integer(number.p)
        if number != 1 or not top:
            top.insert(0, number)
        above = self.style.times.join(self.atom(f) for f in self._sorted(top))
        if not bottom:
            return above
        if self.style.fills and len(top) == 1 and isinstance(top[0], sp.Add):
            above = self.sum(top[0])
        below = self._sorted(bottom)
        alone = len(below) == 1
        plain = self.style.fills and alone and isinstance(below[0], sp.Add)
        text = self.sum(below[0]) if plain else self.style.times.join(self.atom(f) for f in below)
        return self.style.fraction(above, text, alone)

    def _sorted(self, factors: list) -> list:
        return sorted(factors, key=self._rank)

    def _rank(self, factor: sympy.Expr) -> tuple:
        import sympy as sp

        if factor.is_Number:
            return (0, 0, "")
        base = factor.base if isinstance(factor, sp.Pow) else factor
        text = str(base)
        if base in (sp.pi, sp.E):
            return (0, 1, text)
        if isinstance(base, sp.Symbol):
            name, _ = base_of(base.name)
            if name in self.notation.late:
                return (4, self.notation.late[name], text)
            return (1, factor is not base, self.notation.short.get(name, name))
        return (2 if not self._moves(base) else 3, 0, text)

    def atom(self, value: sympy.Expr) -> str:
        import sympy as sp

        if value.is_Symbol:
            return self.notation.name(value.name, self.style)
        if value.is_Number:
            return self.number(value)
        if isinstance(value, sp.Pow):
            return self._power(value)
        if isinstance(value, sp.Add):
            return self.style.brackets(self.sum(value))
        if value in (sp.pi, sp.E):
            return self.style.constant("pi" if value == sp.pi else "e")
        if isinstance(value, sp.Function) and value.func.__name__ == _ODD_ROOT:
            return self.style.odd_root(self.sum(value.args[0]), self.number(value.args[1]))
        if isinstance(value, sp.Function) and not isinstance(value, sp.Piecewise):
            return self.style.function(type(value).__name__.lower()) + self._arguments(value)
        if isinstance(value, (sp.Max, sp.Min)):
            return self.style.function(type(value).__name__.lower()) + self._arguments(value)
        if isinstance(value, sp.Piecewise):
            return self.style.cases([(self.sum(part), self._condition(c)) for part, c in value.args])
        return self.style.brackets(self._condition(value))

    def _condition(self, value: sympy.Basic) -> str:
        """Relations in words; empty for what always holds."""
        import sympy as sp

        if value == sp.true:
            return ""
        style = self.style if self.style.words("") == "" else ASCII  # formulas inside of words are plain text
        return self.style.words(Formula(self.notation, style).in_words(value))

    def in_words(self, value: sympy.Basic, inside: bool = False) -> str:
        """Return a condition as text, ``x > 0 and k*x > 0``; in brackets where it stands inside of another one."""
        import sympy as sp

        if isinstance(value, sp.core.relational.Relational):
            return f"{self.sum(value.lhs)} {value.rel_op} {self.sum(value.rhs)}"
        if isinstance(value, sp.ITE):
            condition, then, other = value.args
            value = sp.Or(sp.And(condition, then), sp.And(sp.Not(condition), other))
        joint = {sp.And: " and ", sp.Or: " or "}.get(type(value))
        if joint is None:
            return str(value)
        text = joint.join(self.in_words(part, True) for part in sorted(value.args, key=sp.default_sort_key))
        return self.style.brackets(text) if inside else text

    def _arguments(self, value: sympy.Function) -> str:
        return self.style.brackets(", ".join(self.sum(a) for a in value.args))

    def _power(self, value: sympy.Pow) -> str:
        import sympy as sp

        base, exponent = value.args
        if exponent == sp.Rational(1, 2):
            return self.style.root(self.sum(base))
        if isinstance(base, sp.Function) and exponent.is_Integer and exponent > 0:  # cos²(θ)
            name = self.style.function(type(base).__name__.lower())
            return self.style.power(name, self.number(exponent)) + self._arguments(base)
        return self.style.power(self.atom(base), self.sum(exponent))

    def number(self, value: sympy.Number) -> str:
        if value.is_Integer:
            return self.style.number(str(value))
        if value.is_Rational and not _decimal(value):
            return self.style.fraction(self.style.number(str(value.p)), self.style.number(str(value.q)), True)
        return self.style.number(f"{float(value):.10g}")


def _factors(value: sympy.Expr) -> list:
    import sympy as sp

    if not isinstance(value, sp.Mul):
        return [value]
    return [g for f in value.args for g in _factors(f)]


_ODD_ROOT = "odd_root"


def _with_odd_roots(factors: list) -> list:
    """``|x|^(1/3)·sign(x)`` as one factor, the real cube root of x."""
    import sympy as sp

    for sign in (f for f in factors if isinstance(f, sp.sign)):
        (x,) = sign.args
        for power in (f for f in factors if f.is_Pow and f.base == sp.Abs(x)):
            if power.exp.is_Rational and power.exp.p == 1 and power.exp.q % 2:
                root = sp.Function(_ODD_ROOT)(x, power.exp.q)
                return [*(f for f in factors if f not in (sign, power)), root]
    return factors


def _whole(value: sympy.Expr) -> sympy.Expr:
    """A float without a fraction as an integer: polynomials make floats of all their numbers."""
    import sympy as sp

    return sp.Integer(int(value)) if value.is_Float and float(value).is_integer() else value


def _is_negative(value: sympy.Expr) -> bool:
    import sympy as sp

    if isinstance(value, sp.Add):
        return all(_is_negative(t) for t in value.args)
    return bool(value.as_coeff_Mul()[0].is_extended_negative)  # no number, which compares with nothing, is not


def _decimal(number: sympy.Rational) -> bool:
    """A fraction that people write as a decimal number: 9.81, not 1/2 or 9/16."""
    if not number.is_Rational or number.q == 1:
        return False
    rest, fives, twos = number.q, 0, 0
    while rest % 5 == 0:
        rest, fives = rest // 5, fives + 1
    while rest % 2 == 0:
        rest, twos = rest // 2, twos + 1
    return (rest == 1 and (fives > 0 or twos > 6)) or number.q > 10_000


def plain_text(expression: sympy.Expr) -> str:
    """Return an expression as SymPy reads it, decimal numbers as people write them: ``9.81*sin(x)``, not 981/100."""
    import sympy as sp

    def written(e: sympy.Expr) -> sympy.Expr:
        if e.is_Rational:
            if not _decimal(e) or sp.Rational(repr(float(e))) != e:
                return e
            symbol = sp.Symbol(repr(float(abs(e))))
            return -symbol if e < 0 else symbol
        if e.is_Pow:
            return sp.Pow(written(e.base), e.exp)
        return e.func(*map(written, e.args)) if e.args else e

    return str(written(expression))
