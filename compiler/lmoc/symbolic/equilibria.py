"""Equilibria: states of rest for constant inputs, exact where there is a closed form.

Linear and polynomial equations are solved in symbols; unknowns that stand linearly are eliminated first. What remains
is a core of few nonlinear equations: in one unknown its real roots are found from closed forms or by a scan for sign
changes, in several by Newton's method from many starts. Each result says how it was found.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import field, replace
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from lmoc.support.records import dataclass
from lmoc.symbolic.elimination import eliminate
from lmoc.symbolic.jumps import NoDerivativeError, has_cases
from lmoc.symbolic.linearize import LinearModel, is_linear, linearize
from lmoc.symbolic.notebook import MOST_SHOWN, table_html
from lmoc.symbolic.rational import cancelled
from lmoc.symbolic.roots import Root, closed_roots, scan, search
from lmoc.symbolic.slope import slope
from lmoc.symbolic.system import SymbolicSystem, time_stands_in_it
from lmoc.symbolic.values import NoValueError, exactly

if TYPE_CHECKING:
    import sympy

@dataclass(frozen=True, eq=False)
class LawsAtRest:
    """The modes of a scene's laws in an equilibrium.

    Attributes
    ----------
    modes : {law name: name of its mode}
    closed, direction : (laws,) the mode, and how friction slips, for derivations in it
    forces : {force name: Expr}
        Of the closed laws, in states and parameters.
    force_range : {force name: (least, largest)}
        Of those forces that are not one number.
    range : {state name: (least, largest)}
        Of the free states that the laws hold within limits: sets of states of rest, not points.
    member : {state name: number}
        Values of these that belong together, as far from all limits of friction as possible.
    conditions : tuple of Expr
        Must not be negative for it to exist, where values of parameters are missing.
    at_limit : tuple of str
        Names of laws that hold with no force to spare.
    """

    modes: Mapping[str, str]
    closed: np.ndarray
    direction: np.ndarray
    forces: Mapping[str, sympy.Expr] = field(default_factory=dict)
    force_range: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    range: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    member: Mapping[str, float] = field(default_factory=dict)
    conditions: tuple[sympy.Expr, ...] = ()
    at_limit: tuple[str, ...] = ()


LinearAbout = Callable[[Mapping[str, float]], LinearModel]


@dataclass(frozen=True, eq=False)
class Equilibrium(Mapping):
    """A mapping {state name: value at rest}.

    Attributes
    ----------
    values : {Symbol: Expr}
        Of all states; a free state stands for itself.
    free : tuple of Symbol
        States that may have any value: a family of equilibria (a lever balanced in every position).
    conditions : tuple of Expr
        Must vanish for it to exist (the sum of the loads on something that nothing holds).
    how : str
        ``exact``, or how it was found.
    inputs : {Symbol: Expr}
        Values of the inputs that were given, or taken as zero for a search; others stand in `values` as symbols.
    model : LinearModel | None
        Numeric linear model about it; None where a value is missing.
    nonlinear : bool
    own_names : {state name: the user's own name for it}
    laws : LawsAtRest | None
        Of a scene with laws: which of them are closed, and the forces they then have.
    """

    values: Mapping[sympy.Symbol, sympy.Expr]
    free: tuple[sympy.Symbol, ...] = ()
    conditions: tuple[sympy.Expr, ...] = ()
    how: str = "exact"
    model: LinearModel | None = None
    nonlinear: bool = False
    own_names: Mapping[str, str] = field(default_factory=dict)
    inputs: Mapping[sympy.Symbol, sympy.Expr] = field(default_factory=dict)
    laws: LawsAtRest | None = None

    def __getitem__(self, name: str) -> sympy.Expr:
        import sympy as sp

        return self.values[sp.Symbol(name)]

    def __iter__(self) -> Iterator[str]:
        return (s.name for s in self.values)

    def __len__(self) -> int:
        return len(self.values)

    @property
    def isolated(self) -> bool:
        return not self.free

    @property
    def stability(self) -> str | None:
        """From the linear model: see `LinearModel.stability`.

        ``undecided`` where a nonlinear scene has an eigenvalue on the imaginary axis: the linear model cannot tell.
        """
        if self.model is None:
            return None
        if self.model.is_too_wide:
            return "undecided"
        if self.laws is not None and self.laws.at_limit:
            return "undecided"  # a law that has just closed, or friction at its limit: it may let go
        values = self.model.eigenvalues
        worst = float(values.real.max(initial=-np.inf))
        if self.nonlinear and self.isolated and abs(worst) <= 1e-6 * max(1.0, float(np.abs(values).max(initial=0.0))):
            return "undecided"
        if self.laws is not None and not len(values):
            return "stable"  # it is held fast; whether bounces die out is not a matter of the linear model
        return self.model.stability

    @property
    def member(self) -> Mapping[str, sympy.Expr]:
        """The state of rest itself: of a set that friction holds, the member that is farthest from its limits."""
        if self.laws is None or not self.laws.member:
            return self
        import sympy as sp

        chosen = {sp.Symbol(name): exactly(value) for name, value in self.laws.member.items()}
        return {name: value.xreplace(chosen) for name, value in self.items()}

    def __repr__(self) -> str:
        values = ", ".join(f"{s}: {v}" for s, v in self.values.items())
        return f"Equilibrium({{{values}}}, stability={self.stability!r})"


class Equilibria(list):
    """The equilibria that were found, by rising values; `how` tells how they were sought, also where there is none."""

    def __init__(self, found: Iterable[Equilibrium], how: str = "exact"):
        super().__init__(found)
        self.how = how

    def _repr_html_(self) -> str:
        """Return the HTML representation for notebooks: the states of each, and whether it is stable."""
        if not self:
            return f"<p><b>no equilibrium</b> ({escape(self.how)})</p>"
        names = list(dict.fromkeys(name for e in self for name in e))[:MOST_SHOWN]
        rows = [[k, *(e.get(name, "") for name in names), e.stability or "", e.how] for k, e in enumerate(self, 1)]
        kind = "equilibrium" if len(self) == 1 else "equilibria"
        return table_html(f"{len(self)} {kind}", ["", *names, "stability", "found"], rows)


def equilibria(
    system: SymbolicSystem, inputs: Mapping[str, object] | None = None, linear_model: LinearAbout | None = None
) -> Equilibria:
    """All states of rest of a system for constant inputs.

    Parameters
    ----------
    system : SymbolicSystem
        The solved form, or one with the same states of rest (`symbolic.motion.balances`).
    inputs : {name: number or expression}, optional
        Constant values; inputs not named stay symbols as long as the equations are linear or polynomial, and are
        zero in a numeric search.
    linear_model : callable, optional
        Gives the linear model about ``{name: number}``; without it, that of `system`.

    Returns
    -------
    Equilibria
        A list, empty where there is none.

    Raises
    ------
    ModelError
        E0660 where time itself appears in the equations.
    """
    import sympy as sp

    time = sp.Symbol("time")
    zero = {jet: sp.S.Zero for u in system.inputs for jet in system.jets(u)[1:]}
    given = {sp.Symbol(name): exactly(value) for name, value in (inputs or {}).items()}
    equations = [sp.sympify(d).xreplace(zero).xreplace(given) for d in system.derivatives]
    if any(e.has(time) for e in equations):
        raise time_stands_in_it()
    at_rest = {d: sp.S.Zero for d in equations if d in system.states}  # q̇ = v says v = 0
    rest = [e.xreplace(at_rest) for e in equations if e not in system.states]
    unknowns = [x for x in system.states if x not in at_rest]
    rest, balanced = _without_balanced(rest, set(unknowns), system)
    rows = [{j: slope(e, x) for j, x in enumerate(unknowns) if x in e.free_symbols} for e in rest]
    cases = any(has_cases(e, unknowns) for e in rest)
    linear = not cases and all(not s.free_symbols & set(unknowns) for row in rows for s in row.values())
    how = "exact"
    if linear:
        found = _linear(rest, rows, unknowns, set(system.inputs) - set(given))
    else:
        found, zeroed, how = _nonlinear(rest, unknowns, system)
        given |= zeroed
    found = [replace(root, conditions=(*root.conditions, *balanced)) for root in found]
    nonlinear = not is_linear(system)
    about = linear_model or (lambda point: linearize(system, {sp.Symbol(n): v for n, v in point.items()}))
    return Equilibria((_finished(system, root, at_rest, given, nonlinear, about) for root in found), how)


def _without_balanced(equations: list, unknowns: set, system: SymbolicSystem) -> tuple[list, list]:
    """Equations without those that the parameter values fulfil in every position, and what must vanish for that."""
    import sympy as sp

    left, conditions = [], []
    free = sorted(set().union(*(e.free_symbols for e in equations)), key=lambda x: x.name)
    point = {x: sp.Rational(2 * k + 3, 7) for k, x in enumerate(free)} | system.numbers
    for e in equations:
        if not _may_vanish(e.xreplace(point)):  # then no factor does, and factorizing is dear
            left.append(e)
            continue
        common = [f for f, _ in sp.factor_list(sp.numer(sp.together(e)))[1] if not f.free_symbols & unknowns]
        balance = next((f for f in common if f.is_Add and f.xreplace(system.numbers) == 0), None)
        if balance is None:
            left.append(e)
        else:
            conditions.append(balance)
    return left, conditions


def _may_vanish(value: sympy.Expr) -> bool:
    """Return whether an expression without symbols may be zero."""
    import sympy as sp

    number = sp.N(value, 15, chop=1e-9)
    return not number.is_comparable or number == 0


def _finished(system, root: Root, at_rest, given, nonlinear: bool, about: LinearAbout) -> Equilibrium:
    values = {x: at_rest.get(x, root.values.get(x, x)) for x in system.states}
    free = tuple(x for x in system.states if values[x] == x)
    model = _model(system, values, given, about)
    return Equilibrium(values, free, root.conditions, root.how, model, nonlinear, system.own_names, given)


def _model(system: SymbolicSystem, values, given, about: LinearAbout) -> LinearModel | None:
    import sympy as sp

    inputs = {u: given.get(u, sp.S.Zero) for u in system.inputs}
    free = {x: sp.S.Zero for x, v in values.items() if v == x}
    numbers = {**system.numbers, **inputs, **free}
    point = {x: sp.sympify(v).xreplace(numbers) for x, v in (values | inputs).items()}
    if not all(v.is_comparable for v in point.values()):  # a value is missing, or the point lies at infinity
        return None
    try:
        return about({x.name: float(v) for x, v in point.items()})
    except (NoValueError, NoDerivativeError):
        return None


def _linear(equations: list, rows: list[dict[int, sympy.Expr]], unknowns: list, inputs: set) -> list[Root]:
    """Solve linear equations; `rows` are their derivatives with respect to the unknowns."""
    import sympy as sp

    zero = {x: sp.S.Zero for x in unknowns}
    right = [-e.xreplace(zero) for e in equations]
    found = eliminate(rows)

    def total(combination):
        return cancelled(sp.Add(*(c * right[j] for j, c in combination.items())))

    conditions = [c for c in (_essential(total(c), inputs) for c in found.conditions) if c != 0]
    if any(not c.free_symbols & inputs for c in conditions):
        return []  # a load that nothing carries and no input can balance
    values = {}
    for i, x in enumerate(unknowns):
        if i in found.solution:
            by_free = sum((c * unknowns[j] for j, c in found.by_free[i].items()), sp.S.Zero)
            values[x] = sp.factor_terms(total(found.solution[i])) + by_free
    return [Root(values, tuple(dict.fromkeys(conditions)))]


def _essential(condition: sympy.Expr, inputs: set) -> sympy.Expr:
    """Return the expression that must vanish, without factors that cannot."""
    import sympy as sp

    top = sp.numer(cancelled(condition))
    if top == 0:
        return top
    factors = [f for f, _ in sp.factor_list(top)[1] if f.free_symbols & inputs]
    return sp.Mul(*factors) if factors else top


def _nonlinear(equations: list, unknowns: list, system: SymbolicSystem) -> tuple[list[Root], dict, str]:
    """Eliminate what occurs linearly, then solve the core: in closed form, with the inputs at zero where that helps.

    Unknowns that stand in no equation may have any value: they are not sought. Equations in which no unknown is left
    are conditions on the inputs.

    Returns
    -------
    (roots, inputs that were taken as zero, how they were sought)
    """
    import sympy as sp

    equations, unknowns, explicit = _core(equations, unknowns)
    unknowns = [x for x in unknowns if any(e.has(x) for e in equations)]
    conditions = [e for e in equations if not e.free_symbols & set(unknowns)]
    equations = [e for e in equations if e not in conditions]
    conditions = [_essential(c, set(system.inputs)) for c in conditions]
    if any(not c.free_symbols & set(system.inputs) for c in conditions):
        return [], {}, "exact"  # a load that nothing carries
    if not unknowns:
        root = Root({x: sp.simplify(v) for x, v in explicit.items()}, tuple(conditions))
        return [root], {}, "exact"
    zeroed = {u: sp.S.Zero for u in system.inputs if any(e.has(u) for e in (*equations, *explicit.values()))}
    for zero in ({}, zeroed):
        at_zero = [e.xreplace(zero) for e in equations]
        core = _exactly_solved(at_zero, unknowns, system)
        if core is not None:
            rest = tuple(c for c in (e.xreplace(zero) for e in conditions) if c != 0)
            found = [replace(root, conditions=rest) for root in core]
            return _with_explicit(found, explicit, zero, system), zero, "exact"
    zeroed |= {u: sp.S.Zero for u in system.inputs if any(c.has(u) for c in conditions)}
    if any(c.xreplace(zeroed).xreplace(system.numbers) != 0 for c in conditions):
        return [], zeroed, "exact"
    alone = len(unknowns) == 1 and len(at_zero) == 1
    sought = scan(at_zero[0], unknowns[0], system) if alone else search(at_zero, unknowns, system)
    return _with_explicit(sought.roots, explicit, zeroed, system), zeroed, sought.how


def _exactly_solved(equations: list, unknowns: list, system: SymbolicSystem) -> list[Root] | None:
    """Roots in closed form, of one unknown; None where there are none."""
    if len(unknowns) > 1:
        return None
    found = closed_roots(equations[0], unknowns[0], system.numbers)
    if found is None or len(equations) == 1:
        return found
    return [r for r in found if all(e.subs(r.values).xreplace(system.numbers).simplify() == 0 for e in equations[1:])]


def _with_explicit(roots: list[Root], explicit: dict, zero: dict, system: SymbolicSystem) -> list[Root]:
    """Roots by rising values, with the unknowns that follow from those of the core."""
    import sympy as sp

    numbers = {**system.numbers, **{u: sp.S.Zero for u in system.inputs}}

    def place(root: Root) -> list[float]:
        values = [sp.N(v.xreplace(numbers)) for v in root.values.values()]
        return [float(v) if v.is_real else 0.0 for v in values]

    explicit = {x: v.xreplace(zero) for x, v in explicit.items()}
    return [root.extended(explicit, system.numbers) for root in sorted(roots, key=place)]


def _core(equations: list, unknowns: list) -> tuple[list, list, dict]:
    """Equations and unknowns without those that stand linearly, and how these follow."""
    import sympy as sp

    explicit: dict = {}
    equations = [e for e in (sp.numer(sp.together(e)) for e in equations) if e != 0]
    unknowns = list(unknowns)
    while True:
        step = _linear_unknown(equations, unknowns)
        if step is None:
            break
        i, x, value = step
        equations.pop(i)
        unknowns.remove(x)
        equations = [sp.numer(sp.together(e.subs(x, value))) for e in equations]
        explicit = {y: v.subs(x, value) for y, v in explicit.items()} | {x: value}
    return equations, unknowns, explicit


def _linear_unknown(equations: list, unknowns: list):
    """An equation that gives an unknown explicitly, with a coefficient free of unknowns."""
    for i, equation in enumerate(equations):
        for x in unknowns:
            if not equation.has(x) or has_cases(equation, [x]):
                continue
            factor = slope(equation, x)
            if factor != 0 and not factor.free_symbols & set(unknowns):
                return i, x, -equation.subs(x, 0) / factor
    return None
