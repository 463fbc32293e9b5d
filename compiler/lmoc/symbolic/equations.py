"""Equations of motion as a person writes them: ``m·q̈ + c·q̇ + k·q = f``, with a table of names, as text and LaTeX."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import field, replace
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from lmoc.messages.diagnostics import ModelError
from lmoc.structure.linear.elimination import LENGTHS_AND_ANGLES
from lmoc.support.records import dataclass
from lmoc.symbolic.curves import named_curves
from lmoc.symbolic.notation import Formula, Notation, in_words, plain_text
from lmoc.symbolic.powers import in_powers
from lmoc.symbolic.sorting import Equation, gathered, solved_equation, sorted_equation, with_few_minus_signs
from lmoc.symbolic.styles import ASCII, LATEX, MATHML, UNICODE, Style, unit_text
from lmoc.symbolic.system import jet_symbol, no_symbols
from lmoc.symbolic.values import exactly

if TYPE_CHECKING:
    import sympy

    from lmoc.ir.flat import FlatDAE
    from lmoc.ir.prepared import Prepared
    from lmoc.ir.reduced import Reduced
    from lmoc.symbolic.motion import Motion


MOST_OPERATIONS = 1_200  # of one equation before it is sorted; a longer one is for machines
MOST_SOLVED = 3  # coordinates; with more, forces are not tried with the accelerations solved


@dataclass(frozen=True, eq=False)
class EquationsOfMotion:
    """The equations of motion of a scene; print it, or ask for `latex`, `html`, `to_dict`.

    Attributes
    ----------
    equations : tuple of Equation
    forces : {name: Expr}
        Internal forces, if requested.
    notation : Notation
    descriptions : {full name: (unit, description)}
        Of the symbols that occur.
    assumptions : tuple of str
        What was taken for granted about parameter values.
    undetermined : tuple of str
        Internal forces that a redundant loop leaves open.
    closures : tuple of Expr
        What vanishes where loops are closed; each has a multiplier in the equations, a force.
    held : {name: value}
        Discrete variables that depend on the past, taken as they start: the equations are others after an event.
    curves : {name: (what it goes over, as the equations call it; name of its slope or "")}
        Curves through many points, which stand in the equations by their names.
    """

    name: str
    equations: tuple[Equation, ...]
    forces: Mapping[str, sympy.Expr]
    notation: Notation
    descriptions: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    assumptions: tuple[str, ...] = ()
    undetermined: tuple[str, ...] = ()
    closures: tuple[sympy.Expr, ...] = ()
    held: Mapping[str, float] = field(default_factory=dict)
    curves: Mapping[str, tuple[str, str]] = field(default_factory=dict)

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

    def closure_lines(self, style: Style = UNICODE) -> list[str]:
        """Return the closures of loops, ``g(q) = 0``."""
        formula = Formula(self.notation, style)
        return [formula.sum(g) + style.equals + "0" for g in self.closures]

    def force_lines(self, style: Style = UNICODE) -> list[str]:
        formula = Formula(self.notation, style)
        return [self.notation.name(n, style) + style.equals + formula.sum(v) for n, v in self.forces.items()]

    def text(self, ascii: bool = False) -> str:
        """For a terminal: the equations, the forces, and the table of abbreviations."""
        style = ASCII if ascii else UNICODE
        lines = self.lines(style) or [NOTHING_MOVES]
        if self.closures:
            lines += ["", "closures of the loops:", *self.closure_lines(style)]
        if self.forces:
            lines += ["", "internal forces:", *self.force_lines(style)]
        if self.undetermined:
            lines += ["", f"{_UNDETERMINED} {', '.join(self.undetermined)}"]
        if self.held:
            lines += ["", self._held_text()]
        if self.curves:
            lines += ["", curves_text(self.curves)]
        return "\n".join(lines + self.notation.legend(style))

    def _held_text(self) -> str:
        """Say what is held as it starts."""
        values = ", ".join(f"{name} = {value:g}" for name, value in self.held.items())
        return f"until the first event that changes it: {values}"

    def __str__(self) -> str:
        return self.text()

    def __repr__(self) -> str:
        return self.text()

    def latex(self) -> str:
        """An `align*` environment."""
        lines = [*self.lines(LATEX), *self.closure_lines(LATEX), *self.force_lines(LATEX)]
        rows = " \\\\\n".join("  " + line.replace(" = ", " &= ", 1) for line in lines)
        return f"\\begin{{align*}}\n{rows}\n\\end{{align*}}"

    def _repr_latex_(self) -> str:
        return self.latex()

    def html(self) -> str:
        """The equations in MathML and the table of symbols, to be put into a page."""
        shown = _formulas(self.lines(MATHML)) or f"<p>{NOTHING_MOVES}</p>"
        if self.closures:
            shown += f"\n<h2>Closures of the loops</h2>\n{_formulas(self.closure_lines(MATHML))}"
        if self.forces:
            shown += f"\n<h2>Internal forces</h2>\n{_formulas(self.force_lines(MATHML))}"
        if self.undetermined:
            shown += f"\n<p>{_UNDETERMINED} {', '.join(f'<code>{escape(n)}</code>' for n in self.undetermined)}</p>"
        if self.held:
            shown += f"\n<p>{escape(self._held_text())}</p>"
        if self.curves:
            shown += f"\n<p>{escape(curves_text(self.curves))}</p>"
        rows = []
        for full, short in self.notation.short.items():
            unit, text = self.descriptions.get(full.removeprefix("δ"), ("", ""))
            symbol = f"<math>{MATHML.symbol(short, 0)}</math>"
            cells = (symbol, f"<code>{escape(in_words(full))}</code>", escape(unit_text(unit)), escape(text))
            rows.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
        head = "<tr><th></th><th>name</th><th>unit</th><th>meaning</th></tr>"
        return shown if not rows else f"{shown}\n<table>\n{head}\n" + "\n".join(rows) + "\n</table>"

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
                    "residual": plain_text(e.residual),
                }
                for e in self.equations
            ],
            "closures": [plain_text(g) for g in self.closures],
            "forces": {name: plain_text(value) for name, value in self.forces.items()},
            "abbreviations": self.notation.abbreviations,
            "undetermined": list(self.undetermined),
            "assumptions": list(self.assumptions),
            "held": dict(self.held),
            "curves": {name: over for name, (over, _) in self.curves.items()},
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

        if self.closures:
            hint = "`lmoc linearize` gives the linear model about it"
            raise no_symbols("closed loops have no equations in deviations, since their closures are not linear", hint)
        shift: dict[sympy.Symbol, sympy.Expr] = {}
        rename: dict[str, str] = {}
        for e in self.equations:
            rename[e.coordinate.name] = _delta(e.coordinate.name)
            for n in range(e.order + 1):
                new = jet_symbol(rename[e.coordinate.name], n)
                rest = exactly(equilibrium.get(e.coordinate.name, 0)) if n == 0 else sp.S.Zero
                shift[jet_symbol(e.coordinate.name, n)] = new + rest
        for name, value in (inputs or {}).items():
            if value != 0:
                rename[name] = _delta(name)
                shift[sp.Symbol(name)] = sp.Symbol(rename[name]) + exactly(value)
        others = set(self.notation.late) - set(self.coordinates) - set(inputs or {})
        zero = {sp.Symbol(n): sp.S.Zero for n in others}
        jets = {jet_symbol(rename[e.coordinate.name], n) for e in self.equations for n in range(e.order + 1)}
        constant = {k: v.xreplace(dict.fromkeys(jets, sp.S.Zero)) for k, v in shift.items()}
        moving = sorted(jets | {sp.Symbol(rename.get(n, n)) for n in others | set(inputs or {})}, key=str)
        moved = []
        for e in self.equations:
            rest = {k: v.xreplace(zero) if k in shift else v for k, v in shift.items()}
            residual = e.residual.xreplace(rest)
            if any(v != 0 for v in constant.values()):
                residual = in_powers(residual, moving)
            coordinate = sp.Symbol(rename[e.coordinate.name])
            late = [rename.get(n, n) for n in self.notation.late]
            coordinates = [sp.Symbol(rename[n]) for n in self.coordinates]
            moved.append(sorted_equation(residual, coordinate, e.order, coordinates, late))
        short = {rename.get(n, n): ("δ" + s if n in rename else s) for n, s in self.notation.short.items()}
        notation = Notation(short, {rename.get(n, n): i for n, i in self.notation.late.items()})
        return replace(self, equations=tuple(moved), notation=notation, forces={})


def curves_text(curves: Mapping[str, tuple[str, str]]) -> str:
    """Say which names stand for curves, and over what these go."""
    slopes = {slope: name for name, (_, slope) in curves.items()}
    return "curves: " + ", ".join(
        f"{name} over {over}" + (f" (the slope of {slopes[name]})" if name in slopes else "")
        for name, (over, _) in curves.items()
    )


NOTHING_MOVES = "there is no free coordinate: all motion is given"
_UNDETERMINED = "not determined, because of a redundant loop:"


def _formulas(lines: list[str]) -> str:
    return "\n".join(f"<p><math display='block'>{line}</math></p>" for line in lines)


def _delta(name: str) -> str:
    return "δ" + name


def equations_of_motion(
    reduced: Reduced,
    values: np.ndarray | None = None,
    forces: bool = False,
    solved: bool = False,
) -> EquationsOfMotion:
    """Return the equations of motion of a reduced system.

    Parameters
    ----------
    reduced : Reduced
    values : (flat.count,), optional
        Parameter values in force.
    forces : bool
        With the internal forces of ideal parts (rods, strings, gears).
    solved : bool
        For the highest derivatives, even where there is a form that divides by nothing.

    Raises
    ------
    ModelError
        E0660, as `symbolic_system`.
    """
    from lmoc.symbolic.motion import accelerations, derive

    values = reduced.values if values is None else values
    motion, outline = derive(reduced, values, forces, solved, named=True)
    if not solved:
        motion = replace(motion, residuals=tuple(_without_divided_signs(r) for r in motion.residuals))
    longest = max((r.count_ops() for r in motion.residuals), default=0)
    if longest > MOST_OPERATIONS:
        hint = "`lmoc show --stage reduce` has them step by step, `lmoc linearize` about a state of rest in numbers"
        why = f"one has {longest} operations, and {MOST_OPERATIONS} at most are shown"
        raise no_symbols(f"the equations of motion of {outline.name} are too long to be read: {why}", hint)
    curves = _curves_in((*motion.residuals, *motion.forces.values()), reduced)
    late = [*(u.name for u in outline.inputs), *curves, *(q.name for q in motion.coordinates)]
    drivers = _drivers(reduced.flat, motion)
    equations = tuple(
        solved_equation(jet_symbol(q.name, n) - r, q, n)
        if solved
        else sorted_equation(r, q, n, motion.coordinates, late, not motion.balanced, drivers)
        for r, q, n in zip(motion.residuals, motion.coordinates, motion.orders, strict=True)
    )
    small = motion.forces and len(motion.coordinates) <= MOST_SOLVED
    rates = accelerations(derive(reduced, values, solved=True, named=True)[0]) if small else {}
    found = {name: _shortest(value, rates, late) for name, value in motion.forces.items()}
    occurring = [e.residual for e in equations] + list(found.values())
    notation = Notation.of(*occurring, names=found, late=late, given={**outline.own_names, **motion.own_names})
    flat = reduced.flat
    return EquationsOfMotion(
        name=outline.name,
        equations=equations,
        forces=found,
        notation=notation,
        descriptions=_descriptions(flat, notation.short),
        assumptions=outline.assumptions,
        undetermined=tuple(flat.variable_name(int(v)) for v in reduced.undetermined) if forces else (),
        curves=curves,
    )


def equations_in_short(prepared: Prepared, release: Callable[[], Reduced]) -> EquationsOfMotion:
    """Return the equations of motion in minimal coordinates, those of closed loops in all where that is shorter.

    Parameters
    ----------
    release : gives the reduction with all coordinates of the loops as states

    Raises
    ------
    ModelError
        E0660: there are none that could be read.
    """
    try:
        return equations_of_motion(prepared.reduced, prepared.values)
    except ModelError as refused:
        if prepared.reduced.invariants is None:
            raise
        try:
            released = release()
        except ModelError:  # not all coordinates of the loops can be states
            raise refused from None
        found = equations_with_closures(released, prepared.values)
        if found is None:
            raise
        return found


def equations_with_closures(reduced: Reduced, values: np.ndarray) -> EquationsOfMotion | None:
    """Return the equations of motion in all coordinates of closed loops, with a multiplier for each closure.

    None where the scene has no such form, or a longer one than a person would read.

    Parameters
    ----------
    reduced : with all these coordinates as states
    values : (flat.count,) parameter values in force
    """
    from lmoc.symbolic.lagrange_first_kind import derive_first_kind

    found = derive_first_kind(reduced, values)
    if found is None or max(r.count_ops() for r in found.motion.residuals) > MOST_OPERATIONS:
        return None
    motion, outline = found.motion, found.outline
    multipliers = [m.name for m in found.multipliers]
    curves = _curves_in(motion.residuals, reduced)
    late = [*(u.name for u in outline.inputs), *curves, *multipliers, *(q.name for q in motion.coordinates)]
    equations = tuple(
        sorted_equation(r, q, n, motion.coordinates, late)
        for r, q, n in zip(motion.residuals, motion.coordinates, motion.orders, strict=True)
    )
    notation = Notation.of(*motion.residuals, *found.closures, names=(), late=late, given=outline.own_names)
    return EquationsOfMotion(
        name=outline.name,
        equations=equations,
        forces={},
        notation=notation,
        descriptions=_descriptions(reduced.flat, notation.short),
        assumptions=outline.assumptions,
        closures=tuple(
            g if reduced.flat.find(m.name) is None else _without_factors(g, motion.coordinates)
            for g, m in zip(found.closures, found.multipliers, strict=True)
        ),
        curves=curves,
    )


def _curves_in(values: Iterable[sympy.Expr], reduced: Reduced) -> dict[str, tuple[str, str]]:
    met = {s.name for value in values for s in value.free_symbols}
    return {name: own for name, own in named_curves(reduced.flat).names(reduced).items() if name in met}


def _without_factors(closure: sympy.Expr, coordinates: Iterable[sympy.Symbol]) -> sympy.Expr:
    """A closure without factors that do not move: ``x² + y² - L²`` for ``(L² - x² - y²)/(2·L)``."""
    import sympy as sp

    moving = sp.factor_terms(sp.together(closure)).as_independent(*coordinates, as_Add=False)[1]
    return with_few_minus_signs(sp.expand(moving))


def _without_divided_signs(residual: sympy.Expr) -> sympy.Expr:
    """A residual with signs in its denominators, such as that of a sliding velocity, multiplied by them: sign² = 1."""
    import sympy as sp

    divided = {p.base for p in residual.atoms(sp.Pow) if p.base.func is sp.sign and p.exp.is_negative}
    for sign in divided:
        residual = sp.expand(residual * sign).replace(
            lambda e, sign=sign: e.is_Pow and e.base == sign and e.exp.is_Integer,
            lambda e, sign=sign: sign ** (e.exp % 2),
        )
    return residual


def _drivers(flat: FlatDAE, motion: Motion) -> frozenset[str]:
    """Coordinates of first order that are no places: they drive the motion, as a current does a motor."""
    first = [q.name for q, n in zip(motion.coordinates, motion.orders, strict=True) if n == 1]
    units = {name: flat.block_at(int(flat.find(name)[0])).unit for name in first}
    return frozenset(name for name, unit in units.items() if unit and unit not in LENGTHS_AND_ANGLES)


def _descriptions(flat, names: Iterable[str]) -> dict[str, tuple[str, str]]:
    found = {}
    for name in names:
        variables = flat.find(name)
        if variables is not None and len(variables):
            block = flat.block_at(int(variables[0]))
            found[name] = (block.unit, block.description)
    return found


def _shortest(value: sympy.Expr, solved: Mapping, late: Iterable[str]) -> sympy.Expr:
    """A force with the accelerations as they stand or as solved, whichever is shorter."""
    import sympy as sp

    def tidy(e: sympy.Expr) -> sympy.Expr:
        return sp.factor_terms(sp.Add(*(c * f for c, f in gathered(e, set(late)))), sign=False)

    return min((tidy(value), tidy(value.xreplace(solved))), key=lambda e: e.count_ops())
