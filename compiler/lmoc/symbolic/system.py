"""The reduced system in symbols: what `Reduced` computes with numbers, as SymPy expressions.

SymPy is a fourth lowering of the programs (`structure.program`), meant for scenes of up to a few hundred equations.
Everything a person reads (equations of motion, equilibria, linear models, transfer functions) starts from here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from lmoc.expression.to_sympy import lower
from lmoc.ir.flat import FlatDAE, Kind
from lmoc.ir.program import Apply, Program, Solve, Step, Total, needed_steps
from lmoc.ir.reduced import Reduced
from lmoc.messages.diagnostics import Diagnostic, ModelError
from lmoc.support.records import dataclass
from lmoc.symbolic.curves import MOST_CASES, NamedCurves, cases, named_curves
from lmoc.symbolic.elimination import eliminate
from lmoc.symbolic.jumps import has_cases
from lmoc.symbolic.parameters import ParameterSymbols
from lmoc.symbolic.rational import cancelled
from lmoc.symbolic.search import scene_size
from lmoc.symbolic.slope import slope
from lmoc.symbolic.too_long import NotDerivableError, no_symbols

if TYPE_CHECKING:
    import sympy

MOST_EQUATIONS = 3000  # flat ones; beyond, symbols help nobody
MOST_STATES = 120
MOST_OPERATIONS = 2_000  # of an expression that is brought into lowest terms; a longer one stays as it is


@dataclass(frozen=True, eq=False)
class SymbolicSystem:
    """``d states/dt = derivatives`` with plain symbols named as in the flat model.

    Attributes
    ----------
    states : tuple of Symbol
    derivatives : tuple of Expr
        In states, inputs, their derivatives, parameters and ``Symbol("time")``.
    inputs : tuple of Symbol
    input_jets : {Symbol: tuple of Symbol}
        For each input the symbols of its derivatives that occur: ``(u, der(u), …)``, itself first.
    outputs : {name: Expr}
        The top-level outputs.
    values : {Symbol: float}
        Values of the parameters that occur; NaN where there is none.
    coordinates : tuple of (position, velocity)
        Indices into `states`; velocity is -1 for a coordinate of first order, and those come last.
    variables : {name: Expr}
        Further variables of the flat model that were requested.
    assumptions : tuple of str
        What was taken for granted about the parameter values.
    size : float
        The largest length among parameters and start values, m: states of rest are searched in proportion to it.
    """

    name: str
    states: tuple[sympy.Symbol, ...]
    derivatives: tuple[sympy.Expr, ...]
    inputs: tuple[sympy.Symbol, ...] = ()
    input_jets: Mapping[sympy.Symbol, tuple[sympy.Symbol, ...]] = field(default_factory=dict)
    outputs: Mapping[str, sympy.Expr] = field(default_factory=dict)
    values: Mapping[sympy.Symbol, float] = field(default_factory=dict)
    variables: Mapping[str, sympy.Expr] = field(default_factory=dict)
    assumptions: tuple[str, ...] = ()
    size: float = 1.0

    @property
    def parameters(self) -> tuple[sympy.Symbol, ...]:
        return tuple(self.values)

    @cached_property
    def coordinates(self) -> tuple[tuple[int, int], ...]:
        velocity_of = {i: self.states.index(d) for i, d in enumerate(self.derivatives) if d in self.states}
        velocities = set(velocity_of.values())
        found = [(i, velocity_of.get(i, -1)) for i in range(len(self.states)) if i not in velocities]
        return tuple(sorted(found, key=lambda pair: pair[1] < 0))

    @property
    def ode(self) -> dict[str, sympy.Expr]:
        """{state name: expression of its derivative}."""
        return {s.name: d for s, d in zip(self.states, self.derivatives, strict=True)}

    @cached_property
    def own_names(self) -> dict[str, str]:
        """{state name: name of the top-level output that is the same}."""
        return {value.name: name for name, value in reversed(self.outputs.items()) if value in self.states}

    def jets(self, u: sympy.Symbol) -> tuple[sympy.Symbol, ...]:
        return tuple(self.input_jets.get(u, (u,)))

    @property
    def numbers(self) -> dict[sympy.Symbol, sympy.Expr]:
        """Exact values of the parameters that have one."""
        from lmoc.expression.to_sympy import exact

        return {s: exact(v) for s, v in self.values.items() if not np.isnan(v)}


@dataclass(frozen=True, eq=False)
class Outline:
    """The coordinates of a scene without its equations, as `SymbolicSystem`: for derivations without a solved form."""

    name: str
    states: tuple[sympy.Symbol, ...]
    coordinates: tuple[tuple[int, int], ...]
    inputs: tuple[sympy.Symbol, ...]
    input_jets: Mapping[sympy.Symbol, tuple[sympy.Symbol, ...]]
    own_names: Mapping[str, str]
    assumptions: tuple[str, ...]


def coordinates_of(reduced: Reduced) -> tuple[tuple[int, int], ...]:
    """(position, velocity) as indices of states, as `SymbolicSystem.coordinates`."""
    place = {int(r): i for i, r in enumerate(reduced.states)}
    velocity = {i: place[int(d)] for i, d in enumerate(reduced.derivatives) if int(d) in place}
    seen = set(velocity.values())
    found = [(i, velocity.get(i, -1)) for i in range(len(reduced.states)) if i not in seen]
    return tuple(sorted(found, key=lambda pair: pair[1] < 0))


def jet_symbol(name: str, order: int) -> sympy.Symbol:
    import sympy as sp

    return sp.Symbol("der(" * order + name + ")" * order)


def _check_size(reduced: Reduced, curves: NamedCurves | None) -> None:
    count, states = reduced.flat.equation_count, len(reduced.states)
    if count > MOST_EQUATIONS or states > MOST_STATES:
        raise no_symbols(
            f"{reduced.flat.name or 'the model'} has {count} equations and {states} states: too many for symbols",
            hint="a linear model in numbers goes further: `lmoc linearize`",
        )
    for group in reduced.flat.groups:
        named = curves is not None and all(curves.defined_by(group, row) for row in range(group.rows))
        if (count := cases(group)) > MOST_CASES and not named:
            raise no_symbols(
                f"'{reduced.flat.variable_name(int(group.slots[0, 0]))}' is a curve through many points: "
                f"an equation with {count} conditions",
                hint="a linear model in numbers goes further: `lmoc linearize`",
            )


def refuse(message: str, hint: str = "") -> NotDerivableError:
    """Return the error for what neither symbols nor numbers can do, or what does not exist."""
    return NotDerivableError([Diagnostic("E0660", message, hint=hint)])


def time_stands_in_it() -> ModelError:
    """The error for equilibria of what is driven by time itself."""
    return refuse("the equations contain time itself: nothing stays at rest", hint="make the signal an input")


def symbolic_system(
    reduced: Reduced,
    values: np.ndarray | None = None,
    variables: Sequence[str] | Mapping[str, int] = (),
    most: float = math.inf,
    named: bool = False,
) -> SymbolicSystem:
    """Interpret a reduced system in SymPy.

    Parameters
    ----------
    reduced : Reduced
    values : (flat.count,), optional
        Parameter values in force (those of the reduction without it); they tell which parameters are zero.
    variables : names, or {name: flat variable}
        Flat variables whose expressions are wanted too.
    most : terms of a coefficient in what is solved, where a person is to read it
    named : curves through many points by their names

    Raises
    ------
    ModelError
        E0660 where the scene is too large, or implicit equations have no closed solution.
    """
    flat = reduced.flat
    interpreter = SymbolicInterpreter(reduced, reduced.values if values is None else values, most, named)
    interpreter.run(reduced.rhs)
    outputs = _outputs(flat)
    wanted = [(flat.variable_name(v), v) for v in outputs] + _named(flat, variables)
    interpreter.fill([int(reduced.register_of[v]) for _, v in wanted if reduced.register_of[v] >= 0])
    values_of = {name: arrange(interpreter.variable(v), interpreter) for name, v in wanted}
    derivatives = tuple(arrange(interpreter.w[int(r)], interpreter) for r in reduced.derivatives)
    occurring = set().union(*(e.free_symbols for e in (*derivatives, *values_of.values())))
    return SymbolicSystem(
        name=flat.name,
        states=tuple(interpreter.w[int(r)] for r in reduced.states),
        derivatives=derivatives,
        inputs=tuple(interpreter.input_symbols),
        input_jets=interpreter.input_symbols,
        outputs={flat.variable_name(v): values_of[flat.variable_name(v)] for v in outputs},
        values={s: v for s, v in interpreter.parameters.used.items() if s in occurring},
        variables={n: values_of[n] for n in variables},
        assumptions=tuple(g.text for g in reduced.guards),
        size=scene_size(flat, reduced.values if values is None else values),
    )


def _named(flat: FlatDAE, variables: Sequence[str] | Mapping[str, int]) -> list[tuple[str, int]]:
    if isinstance(variables, Mapping):
        return list(variables.items())
    return [(name, _only(flat, name)) for name in variables]


def _outputs(flat) -> list[int]:
    return [n for b in flat.blocks if b.output for n in range(b.offset, b.offset + b.size)]


def _only(flat, name: str) -> int:
    from lmoc.messages.diagnostics import nearest

    found = flat.find(name)
    if found is None or len(found) != 1:
        raise ModelError([Diagnostic("E0661", f"there is no variable '{name}'", hint=nearest(name, flat.names()))])
    return int(found[0])


class SymbolicInterpreter:
    """Runs programs with SymPy expressions in the registers.

    Attributes
    ----------
    w : {register: Expr}
    parameters : ParameterSymbols
    input_symbols : {input: (input, der(input), …)}
    most : terms of a coefficient in what is solved, where a person is to read it
    curves : those that stand for themselves, by their names; None where their pieces are written out
    """

    def __init__(self, reduced: Reduced, values: np.ndarray, most: float = math.inf, named: bool = False):
        self.curves = named_curves(reduced.flat) if named else None
        _check_size(reduced, self.curves)
        self.reduced, self.most = reduced, most
        self.parameters = ParameterSymbols(reduced.flat, values)
        self.w: dict[int, sympy.Expr] = {}
        self.input_symbols: dict[sympy.Symbol, tuple[sympy.Symbol, ...]] = {}
        flat = reduced.flat
        for register, variable in reduced.known.T.tolist():
            self.w[register] = self.parameters[variable]
        for register in [*reduced.states.tolist(), *reduced.quadratures.tolist()]:
            self.w[register] = jet_symbol(
                flat.variable_name(int(reduced.registers.variable[register])), int(reduced.registers.order[register])
            )
        highest: dict[int, int] = {}
        for register, variable, order in reduced.inputs.T.tolist():
            self.w[register] = jet_symbol(flat.variable_name(variable), order)
            highest[variable] = max(order, highest.get(variable, 0))
        for v in np.flatnonzero(flat.kind == Kind.INPUT).tolist():
            name = flat.variable_name(v)
            jets = tuple(jet_symbol(name, k) for k in range(highest.get(v, 0) + 1))
            self.input_symbols[jets[0]] = jets
        self.run(reduced.parameter_program)

    @cached_property
    def _curve_of(self) -> dict[int, tuple[int, int]]:
        """{variable of a register: (curve that is the same, order of its register)}."""
        table = self.reduced.registers
        own = [] if self.curves is None else [(v, int(self.reduced.register_of[v])) for v in self.curves.over]
        return {int(table.variable[r]): (v, int(table.order[r])) for v, r in own if r >= 0 and table.variable[r] >= 0}

    def outline(self) -> Outline:
        """States, coordinates and inputs; no program is run for it."""
        reduced, flat = self.reduced, self.reduced.flat
        names = {int(r): self.w[int(r)].name for r in reduced.states}
        same = [(int(reduced.register_of[v]), flat.variable_name(v)) for v in reversed(_outputs(flat))]
        return Outline(
            name=flat.name,
            states=tuple(self.w[int(r)] for r in reduced.states),
            coordinates=coordinates_of(reduced),
            inputs=tuple(self.input_symbols),
            input_jets=self.input_symbols,
            own_names={names[r]: own for r, own in same if r in names},
            assumptions=tuple(g.text for g in reduced.guards),
        )

    def variable(self, variable: int) -> sympy.Expr:
        """Expression of a flat variable; `fill` its register before."""
        import sympy as sp

        if self.reduced.flat.kind[variable] in (Kind.CONSTANT, Kind.PARAMETER):
            return self.parameters[variable]
        register = int(self.reduced.register_of[variable])
        if register < 0 or register not in self.w:
            return sp.nan
        return self.w[register]

    def fill(self, registers: list[int]) -> None:
        """Run what is needed of the programs for some registers, and not yet done."""
        missing = np.array([r for r in registers if r not in self.w], int)
        if len(missing):
            program = self.reduced.rhs + self.reduced.observe
            self.run(needed_steps(program, missing, self.reduced.registers.count), again=False)

    def run(self, program: Program, again: bool = True) -> None:
        for step in program:
            self._step(step, again)

    def _step(self, step: Step, again: bool) -> None:
        if isinstance(step, Apply):
            for row, out in zip(step.slots.tolist(), step.out.tolist(), strict=True):
                if again or out not in self.w:
                    named = self._along_a_curve(out)
                    self.w[out] = lower(step.shape, lambda k, _, row=row: self.w[row[k]]) if named is None else named
        elif isinstance(step, Total):
            for i, out in enumerate(step.out.tolist()):
                if again or out not in self.w:
                    part = slice(step.start[i], step.start[i + 1])
                    terms = zip(step.index[part].tolist(), step.coefficient[part].tolist(), strict=True)
                    self.w[out] = sum((_times(c, self.w[r]) for r, c in terms), start=_zero())
        elif again or any(r not in self.w for r in np.ravel(step.unknowns).tolist()):
            self._solve(step)

    def _along_a_curve(self, register: int) -> sympy.Expr | None:
        """Return the symbol of a curve, or its rate by the chain rule; None for what is no curve."""
        table = self.reduced.registers
        variable = int(table.variable[register]) if register < table.count else -1  # closures have further ones
        if self.curves is None or variable not in self._curve_of:
            return None
        curve, lowest = self._curve_of[variable]
        order = int(table.order[register]) - lowest
        if order == 0:
            return self.curves.value(curve)
        jets = [self._rate_of(self.curves.over[curve], n) for n in range(1, order + 1)]
        return None if None in jets else self.curves.rate(curve, order, lambda n: jets[n - 1])

    def argument(self, curve: int) -> sympy.Expr:
        """Return what a curve goes over."""
        assert self.curves is not None, "there are no named curves"
        over = self.curves.over[curve]
        self.fill([int(r) for r in self.reduced.register_of[[over]] if r >= 0])
        return self.variable(over)

    def _rate_of(self, variable: int, order: int) -> sympy.Expr | None:
        """Return a rate of a variable that has a register of its own, as computed so far."""
        table, own = self.reduced.registers, int(self.reduced.register_of[variable])
        same = (table.variable == table.variable[own]) & (table.order == table.order[own] + order)
        return next((self.w[r] for r in np.flatnonzero(same).tolist() if r in self.w), None) if own >= 0 else None

    def _solve(self, step: Solve) -> None:
        """Solve blocks that are alike; `inner` computes the residuals of all of them."""
        import sympy as sp

        blocks = step.unknowns.tolist()
        places = [[sp.Dummy(f"x{i}") for i in range(len(unknowns))] for unknowns in blocks]
        for unknowns, place in zip(blocks, places, strict=True):
            self.w.update(zip(unknowns, place, strict=True))
        self.run(step.inner)
        solved = [self._solved(*block) for block in zip(blocks, places, step.residuals.tolist(), strict=True)]
        for unknowns, values in zip(blocks, solved, strict=True):
            self.w.update(zip(unknowns, values, strict=True))
        self.run(step.inner)

    def _solved(self, unknowns: list[int], place: list[sympy.Dummy], residuals: list[int]) -> list[sympy.Expr]:
        import sympy as sp

        left, right = [], []
        for register in residuals:
            residual = self.w[register]
            row = {i: slope(residual, x) for i, x in enumerate(place) if residual.has(x)}
            if any(c.has(*place) for c in row.values()) or has_cases(residual, place):
                raise self._no_closed_form(unknowns)
            left.append(row)
            right.append(-residual.xreplace({x: sp.S.Zero for x in place}))
        found = eliminate(left, most=self.most)
        if found.conditions or len(found.solution) < len(unknowns):
            raise self._no_closed_form(unknowns)
        return [sp.Add(*(c * right[j] for j, c in found.solution[i].items())) for i in range(len(unknowns))]

    def _no_closed_form(self, unknowns: list[int]) -> ModelError:
        names = ", ".join(self.reduced.register_name(r) for r in unknowns[:4])
        return no_symbols(
            f"the implicit equations for {names} have no solution in closed form",
            hint="prefer other coordinates (stateSelect, --states); `lmoc linearize` works in numbers",
        )


def _zero():
    import sympy as sp

    return sp.S.Zero


def _times(c: float, x: sympy.Expr) -> sympy.Expr:
    from lmoc.expression.to_sympy import exact

    return x if c == 1.0 else -x if c == -1.0 else exact(c) * x


def arrange(value: sympy.Expr, interpreter: SymbolicInterpreter) -> sympy.Expr:
    """A right-hand side as compact as it goes without expanding what the user wrote: linear ones in lowest terms."""
    reduced = interpreter.reduced
    moving = {interpreter.w[int(r)] for r in [*reduced.states, *reduced.quadratures]}
    moving |= {jet for jets in interpreter.input_symbols.values() for jet in jets}
    return in_lowest_terms(value, moving)


def in_lowest_terms(value: sympy.Expr, moving: set[sympy.Symbol]) -> sympy.Expr:
    """Write what is linear in the moving symbols as ``Σ coefficient·symbol + rest`` with cancelled coefficients."""
    import sympy as sp

    if value.count_ops() > MOST_OPERATIONS:
        return value
    if has_cases(value, moving):
        return value
    present = sorted(value.free_symbols & moving, key=lambda s: s.name)
    coefficients = [slope(value, x) for x in present]
    if any(c.free_symbols & moving for c in coefficients):
        return value
    rest = value.xreplace({x: sp.S.Zero for x in present})
    terms = [sp.factor_terms(cancelled(c)) * x for c, x in zip(coefficients, present, strict=True)]
    return sp.Add(*terms, sp.factor_terms(cancelled(rest)))
