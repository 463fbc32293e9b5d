"""Equations of motion as a person writes them: ``m·q̈ + c·q̇ + k·q = f``.

Each residual of `symbolic.motion` is sorted: terms in the coordinates on the left, highest derivative first, with
collected coefficients; inputs and constants on the right. Denominators that are plain products (a radius, a ratio)
are cleared, others (``k1·k2/(k1 + k2)``) stay. Nonlinear terms stay as the user factored them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from lmoc.symbolic.names import base_of
from lmoc.symbolic.notation import Formula, Notation, join_terms
from lmoc.symbolic.styles import ASCII, LATEX, MATHML, UNICODE, Style
from lmoc.symbolic.system import SymbolicSystem, jet_symbol, symbolic_system

if TYPE_CHECKING:
    import sympy

    from lmoc.structure.reduced import Reduced

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

    @property
    def term_count(self) -> int:
        """Terms after opening the brackets around coefficients."""
        import sympy as sp

        return sum(len(sp.Add.make_args(sp.numer(sp.together(c)))) for c, _ in (*self.left, *self.right))

    def write(self, notation: Notation, style: Style) -> str:
        formula = Formula(notation, style)
        sides = (join_terms((formula.term(c, f) for c, f in side), style) for side in (self.left, self.right))
        return style.equals.join(sides)


@dataclass(frozen=True, eq=False)
class EquationsOfMotion:
    """The equations of motion of a scene; print it, or ask for `latex`, `html`, `to_dict`.

    Attributes
    ----------
    equations : tuple of Equation
    forces : {name: Expr}
        Internal forces, where asked for.
    notation : Notation
    descriptions : {full name: (unit, description)}
        Of the symbols that occur.
    assumptions : tuple of str
        What was taken for granted about parameter values.
    undetermined : tuple of str
        Internal forces that a redundant loop leaves open.
    """

    name: str
    equations: tuple[Equation, ...]
    forces: Mapping[str, sympy.Expr]
    notation: Notation
    descriptions: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    assumptions: tuple[str, ...] = ()
    undetermined: tuple[str, ...] = ()

    @property
    def coordinates(self) -> tuple[str, ...]:
        return tuple(e.coordinate.name for e in self.equations)

    @property
    def operation_count(self) -> int:
        """Operations of all sides as they are written."""
        import sympy as sp

        sides = [sp.Add(*(c * f for c, f in side)) for e in self.equations for side in (e.left, e.right)]
        return sum(int(sp.count_ops(side)) for side in sides)

    def lines(self, style: Style = UNICODE) -> list[str]:
        return [e.write(self.notation, style) for e in self.equations]

    def force_lines(self, style: Style = UNICODE) -> list[str]:
        formula = Formula(self.notation, style)
        return [self.notation.name(n, style) + style.equals + formula.sum(v) for n, v in self.forces.items()]

    def text(self, ascii: bool = False) -> str:
        """For a terminal: the equations, the forces, and the table of abbreviations."""
        style = ASCII if ascii else UNICODE
        lines = self.lines(style) or ["there is no free coordinate: all motion is given"]
        if self.forces:
            lines += ["", "internal forces:", *self.force_lines(style)]
        if self.undetermined:
            lines += ["", f"not determined, because of a redundant loop: {', '.join(self.undetermined)}"]
        table = [(style.symbol(short, 0), _told(full)) for short, full in self.notation.abbreviations.items()]
        if table:
            width = max(len(short) for short, _ in table)
            lines += ["", "with", *(f"  {short:<{width}}  {full}" for short, full in table)]
        return "\n".join(lines)

    def __str__(self) -> str:
        return self.text()

    def __repr__(self) -> str:
        return self.text()

    def latex(self) -> str:
        """An `align*` environment."""
        lines = [*self.lines(LATEX), *self.force_lines(LATEX)]
        rows = " \\\\\n".join("  " + line.replace(" = ", " &= ", 1) for line in lines)
        return f"\\begin{{align*}}\n{rows}\n\\end{{align*}}"

    def _repr_latex_(self) -> str:
        return self.latex()

    def html(self) -> str:
        """The equations in MathML and the table of symbols, to be put into a page."""
        lines = [*self.lines(MATHML), *self.force_lines(MATHML)]
        shown = "\n".join(f"<p><math display='block'>{line}</math></p>" for line in lines)
        rows = []
        for full, short in self.notation.short.items():
            unit, text = self.descriptions.get(full, ("", ""))
            symbol = f"<math>{MATHML.symbol(short, 0)}</math>"
            cells = (symbol, f"<code>{escape(full)}</code>", escape(unit), escape(text))
            rows.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
        head = "<tr><th></th><th>name</th><th>unit</th><th></th></tr>"
        return f"{shown}\n<table>\n{head}\n" + "\n".join(rows) + "\n</table>"

    def to_dict(self) -> dict:
        """For JSON: each equation as text, LaTeX and residual in full names (SymPy syntax)."""
        return {
            "model": self.name,
            "equations": [
                {
                    "coordinate": e.coordinate.name,
                    "order": e.order,
                    "text": e.write(self.notation, ASCII),
                    "latex": e.write(self.notation, LATEX),
                    "residual": str(e.residual),
                }
                for e in self.equations
            ],
            "forces": {name: str(value) for name, value in self.forces.items()},
            "abbreviations": self.notation.abbreviations,
            "assumptions": list(self.assumptions),
        }

    def about(
        self, equilibrium: Mapping[str, sympy.Expr], inputs: Mapping[str, object] | None = None
    ) -> EquationsOfMotion:
        """The equations in deviations ``δq = q − q_e`` from an equilibrium: constant loads disappear.

        Parameters
        ----------
        equilibrium : {state name: value}
            From `equilibria`.
        inputs : {name: value}, optional
            The inputs' constant values at the equilibrium (zero without); ``δu = u − u_e`` where not zero.
        """
        import sympy as sp

        shift: dict[sympy.Symbol, sympy.Expr] = {}
        rename: dict[str, str] = {}
        for e in self.equations:
            rename[e.coordinate.name] = _delta(e.coordinate.name)
            for n in range(e.order + 1):
                new = jet_symbol(rename[e.coordinate.name], n)
                rest = equilibrium.get(e.coordinate.name, sp.S.Zero) if n == 0 else sp.S.Zero
                shift[jet_symbol(e.coordinate.name, n)] = new + rest
        for name, value in (inputs or {}).items():
            if value != 0:
                rename[name] = _delta(name)
                shift[sp.Symbol(name)] = sp.Symbol(rename[name]) + sp.sympify(value)
        others = set(self.notation.late) - set(self.coordinates) - set(inputs or {})
        zero = {sp.Symbol(n): sp.S.Zero for n in others}
        moved = []
        for e in self.equations:
            rest = {k: v.xreplace(zero) if k in shift else v for k, v in shift.items()}
            residual = e.residual.xreplace(rest)
            coordinate = sp.Symbol(rename[e.coordinate.name])
            late = [rename.get(n, n) for n in self.notation.late]
            coordinates = [sp.Symbol(rename[n]) for n in self.coordinates]
            moved.append(sorted_equation(residual, coordinate, e.order, coordinates, late))
        short = {rename.get(n, n): ("δ" + s if n in rename else s) for n, s in self.notation.short.items()}
        notation = Notation(short, {rename.get(n, n): i for n, i in self.notation.late.items()})
        return replace(self, equations=tuple(moved), notation=notation, forces={})


def _delta(name: str) -> str:
    return "δ" + name


def _told(full: str) -> str:
    return f"deviation of {full[1:]}" if full.startswith("δ") else full


def equations_of_motion(
    reduced: Reduced,
    values: np.ndarray | None = None,
    forces: bool = False,
    system: SymbolicSystem | None = None,
) -> EquationsOfMotion:
    """Equations of motion of a reduced system.

    Parameters
    ----------
    reduced : Reduced
    values : (flat.count,), optional
        Parameter values in force.
    forces : bool
        With the internal forces of ideal parts (rods, strings, gears).
    system : SymbolicSystem, optional
        If it is already at hand.

    Raises
    ------
    ModelError
        E0660, as `symbolic_system`.
    """
    from lmoc.symbolic.motion import accelerations, derive

    system = symbolic_system(reduced, values) if system is None else system
    motion = derive(reduced, system, values, forces)
    late = [*(u.name for u in system.inputs), *(q.name for q in motion.coordinates)]
    equations = tuple(
        sorted_equation(r, q, n, motion.coordinates, late, clear_all=not motion.balanced)
        for r, q, n in zip(motion.residuals, motion.coordinates, motion.orders, strict=True)
    )
    solved = accelerations(system) if forces else {}
    found = {name: _shortest(value, solved, late) for name, value in motion.forces.items()}
    occurring = [e.residual for e in equations] + list(found.values())
    notation = Notation.of(*occurring, names=found, late=late, given=system.own_names | motion.own_names)
    descriptions = _descriptions(reduced.flat, notation.short)
    flat = reduced.flat
    open_ones = tuple(flat.variable_name(int(v)) for v in reduced.undetermined) if forces else ()
    return EquationsOfMotion(system.name, equations, found, notation, descriptions, system.assumptions, open_ones)


def _descriptions(flat, names: Iterable[str]) -> dict[str, tuple[str, str]]:
    found = {}
    for name in names:
        variables = flat.find(name)
        if variables is not None and len(variables):
            block = flat.block_at(int(variables[0]))
            found[name] = (block.unit, block.description)
    return found


# ------------------------------------------------------------------ sorting


def sorted_equation(
    residual: sympy.Expr,
    coordinate: sympy.Symbol,
    order: int,
    coordinates: Iterable[sympy.Symbol],
    late: Iterable[str],
    clear_all: bool = False,
) -> Equation:
    """Sort a residual into terms.

    Parameters
    ----------
    residual : Expr
        In the coordinates and their derivatives ``der(q)``.
    coordinates, late : all coordinates, and the names of all inputs and coordinates
    clear_all : bool
        Clear every denominator, not only plain products.
    """
    import sympy as sp

    names = [q.name for q in coordinates]
    terms = gathered(residual, set(late))
    terms = _same_rates_together(_without_denominators(terms, clear_all))
    left = [(c, f) for c, f in terms if any(base_of(s.name)[0] in names for s in f.free_symbols)]
    right = [(_sign_inside(-c), f) for c, f in terms if not any(base_of(s.name)[0] in names for s in f.free_symbols)]
    own = base_of(coordinate.name)[0]

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
    return Equation(sp.Symbol(own), order, tuple(left), tuple(right))


def _is_negative(coefficient: sympy.Expr) -> bool:
    import sympy as sp

    return all(t.could_extract_minus_sign() for t in sp.Add.make_args(sp.numer(sp.together(coefficient))))


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
    cancelled = sp.cancel(value)
    top, bottom = sp.fraction(cancelled)
    top = sp.expand(top)
    forms = [sp.factor_terms(cancelled)]
    if top.is_Add:
        alone = [x for x in top.free_symbols if sp.degree(top, x) == 1]
        forms.append(sp.collect(top, alone, sp.factor) / sp.factor(bottom))  # Jc + Js·(1 + ρ)²
    if bottom.is_Add or top.is_Add and len(top.args) <= MOST_FACTORED:
        forms.append(sp.factor(cancelled))
    shortest = min((cancelled, *forms), key=lambda e: (len(sp.sstr(e)), not e.is_Add))
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
        if len(members) > 1 and rest.has(sp.sin) and rest.has(sp.cos):
            simpler = sp.trigsimp(rest)
            if simpler.count_ops() < rest.count_ops():
                members = _split(simpler, rate, members)
        result += members
    return result


def _same_rates_together(terms: list[Term]) -> list[Term]:
    """``J·θ̈ + m·cos²(θ)·θ̈`` as ``(J + m·cos²(θ))·θ̈``."""
    import sympy as sp

    groups: dict[sympy.Expr, list[Term]] = {}
    for c, f in terms:
        rates = sp.Mul(*(g for g in sp.Mul.make_args(f) if _is_rate(g)))
        groups.setdefault(rates if rates != 1 else f, []).append((c, f))
    return [
        members[0] if len(members) == 1 else (sp.Add(*(c * f / rate for c, f in members)), rate)
        for rate, members in groups.items()
    ]


def _is_rate(factor: sympy.Expr) -> bool:
    import sympy as sp

    base = factor.base if isinstance(factor, sp.Pow) else factor
    return base.is_Symbol and base.name.startswith("der(")


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
    parts = [sp.fraction(sp.cancel(c)) for c, _ in terms]
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


def _shortest(value: sympy.Expr, solved: Mapping, late: Iterable[str]) -> sympy.Expr:
    """A force with the accelerations as they stand or as solved, whichever is shorter."""
    import sympy as sp

    def tidy(e: sympy.Expr) -> sympy.Expr:
        return sp.factor_terms(sp.Add(*(c * f for c, f in gathered(e, set(late)))), sign=False)

    return min((tidy(value), tidy(value.xreplace(solved))), key=lambda e: e.count_ops())
