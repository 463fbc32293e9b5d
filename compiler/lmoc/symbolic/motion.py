"""Equations of motion by the principle of virtual power.

Connections carry no power: the sum of ``flow · rate of potential`` over all ports of all parts vanishes for every
motion that the connections allow (Tellegen's theorem). With the rates of the potentials as linear functions of the
coordinates' rates, each coordinate gives one equation, ``Σ flow · ∂(rate)/∂q̇ᵢ = 0``: Lagrange's equations in the parts'
own terms, with symmetric mass matrix, in which the flows of ideal parts (rods, gears, pulleys) cancel by themselves.
Nothing is inverted, so what the user wrote stays recognizable.

Scenes whose forces are not all tied to ports get the explicit form, one solved acceleration an equation.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from lmoc.ir.flat import Kind
from lmoc.ir.reduced import Reduced
from lmoc.messages.diagnostics import ModelError
from lmoc.symbolic.kinematics import Kinematics
from lmoc.symbolic.local import NotLinearError, PartLaws
from lmoc.symbolic.slope import slope
from lmoc.symbolic.system import Interpreter, Outline, SymbolicSystem, jet_symbol, symbolic_system

if TYPE_CHECKING:
    import sympy


@dataclass(frozen=True, eq=False)
class Motion:
    """Residuals that vanish on every motion.

    Attributes
    ----------
    coordinates : tuple of Symbol
        Named as in the flat model; derivatives are ``der(q)``, ``der(der(q))``.
    orders : tuple of int
        Order of each coordinate's equation, 2 or 1.
    residuals : tuple of Expr
    forces : {name: Expr}
        Internal forces of ideal parts.
    balanced : bool
        By virtual power; otherwise each residual is a solved equation.
    own_names : {force: name of the top-level variable that is the same}
    values : {Symbol: float}
        Values of the parameters that occur.
    """

    coordinates: tuple[sympy.Symbol, ...]
    orders: tuple[int, ...]
    residuals: tuple[sympy.Expr, ...]
    forces: Mapping[str, sympy.Expr]
    balanced: bool
    own_names: Mapping[str, str] = field(default_factory=dict)
    values: Mapping[sympy.Symbol, float] = field(default_factory=dict)


def derive(reduced: Reduced, values: np.ndarray, forces: bool = False) -> tuple[Motion, Outline]:
    """Equations of motion of a reduced system.

    Parameters
    ----------
    reduced, values : as in `symbolic_system`
    forces : bool
        With the internal forces of ideal parts.

    Raises
    ------
    ModelError
        E0660 where the scene is too large, or has neither form.
    """
    interpreter = Interpreter(reduced, values)
    outline = interpreter.outline()
    try:
        found = _virtual_power(interpreter, outline, forces)
    except (ModelError, NotLinearError):
        found = None
    if found is not None and agrees(found, interpreter, values):
        return replace(found, values=dict(interpreter.parameters.used)), outline
    return explicit(symbolic_system(reduced, values)), outline


def balances(reduced: Reduced, values: np.ndarray) -> SymbolicSystem:
    """A system with the same states of rest: in the place of accelerations the forces that would cause them.

    Nothing is divided by a mass matrix, so its equations are far shorter than the solved ones. A scene without
    equations by virtual power gives its solved form.
    """
    import sympy as sp

    motion, outline = derive(reduced, values)
    if not motion.balanced:
        return symbolic_system(reduced, values)
    states = outline.states
    rest: dict[sympy.Symbol, sympy.Expr] = {}
    for q, v in outline.coordinates:
        name = states[q].name
        rest |= {jet_symbol(name, 2): sp.S.Zero, jet_symbol(name, 1): states[v] if v >= 0 else sp.S.Zero}
    rates = list(states)
    for (q, v), residual in zip(outline.coordinates, motion.residuals, strict=True):
        rates[v if v >= 0 else q] = -residual.xreplace(rest)
        if v >= 0:
            rates[q] = states[v]
    occurring = set().union(*(r.free_symbols for r in rates), set())
    return SymbolicSystem(
        name=outline.name,
        states=states,
        derivatives=tuple(rates),
        inputs=outline.inputs,
        input_jets=outline.input_jets,
        outputs={own: sp.Symbol(state) for state, own in outline.own_names.items()},
        values={s: v for s, v in motion.values.items() if s in occurring},
    )


def _virtual_power(interpreter: Interpreter, outline: Outline, forces: bool) -> Motion | None:
    import sympy as sp

    flat = interpreter.reduced.flat
    ports = _ports(flat)
    kinematics = Kinematics(interpreter, outline, [p for p, _ in ports])
    laws = PartLaws(flat, kinematics)
    elimination, unknowns, right = laws.solve_relations()
    tied = {
        unknowns[v]: sum((c * right[j] for j, c in combination.items()), sp.S.Zero)
        + sum((c * unknowns[x] for x, c in elimination.by_free[v].items()), sp.S.Zero)
        for v, combination in elimination.solution.items()
    }
    rates = [jet_symbol(q.name, 1) for q in kinematics.coordinates]
    power = {q: [] for q in rates}
    for potential, flow in ports:
        rate = kinematics.rate(kinematics.value(potential))
        for q in rates:
            weight = slope(rate, q)
            if weight != 0:
                power[q].append(laws.value(flow).xreplace(tied) * weight)
    residuals = [_without(sp.Add(*power[q]), set(unknowns.values())) for q in rates]
    if any(r is None for r in residuals):
        return None
    found, own = _reactions(laws, set(interpreter.reduced.undetermined.tolist())) if forces else ({}, {})
    return Motion(tuple(kinematics.coordinates), tuple(kinematics.orders), tuple(residuals), found, True, own)


def _ports(flat) -> list[tuple[int, int]]:
    """(potential, flow) variables of all elements."""
    pairs = []
    for part in flat.parts:
        if part.leaf:
            for p, f in part.ports:
                potential, flow = flat.blocks[p], flat.blocks[f]
                pairs += [(potential.offset + i, flow.offset + i) for i in range(flow.size)]
    return pairs


def _without(power: sympy.Expr, reactions: set) -> sympy.Expr | None:
    """The sum with the reactions cancelled; None where one stays."""
    import sympy as sp

    for reaction in sorted(power.free_symbols & reactions, key=lambda s: s.name):
        if sp.simplify(slope(power, reaction)) != 0:
            return None
    return power.xreplace({r: sp.S.Zero for r in reactions})


def _reactions(laws: PartLaws, undetermined: set[int]) -> tuple[dict[str, sympy.Expr], dict[str, str]]:
    """Internal forces of ideal parts in jets of the coordinates, and the user's own names for them.

    Those that a redundant loop leaves undetermined are left out.
    """
    import sympy as sp

    flat = laws.flat
    elimination, unknowns, right = laws.solve_relations(balances=True)
    parts: dict[int, list[int]] = {}
    for v in sorted(laws.unknown & elimination.solution.keys()):
        if not elimination.by_free[v] and v not in undetermined:
            parts.setdefault(flat.block_at(v).part, []).append(v)
    own = {}
    for v in parts.pop(0, []):  # the scene's own variables are other names for forces of parts
        same = laws.same_as(v)
        if same is not None:
            own[flat.variable_name(same)] = flat.variable_name(v)
    found = {}
    for v in (v for members in parts.values() for v in _telling(flat, members)):
        value = sum((c * right[j] for j, c in elimination.solution[v].items()), sp.S.Zero)
        found[flat.variable_name(v)] = value
    return found, own


def _telling(flat, unknown: list[int]) -> list[int]:
    """Of a part's unknown forces those it declares itself (a tension); else those on its ports, else the torques."""
    own = [v for v in unknown if not flat.block_at(v).connector and flat.block_at(v).unit in ("N", "N.m")]
    at_ports = [v for v in unknown if flat.block_at(v).connector]
    forces = [v for v in at_ports if flat.block_at(v).unit == "N"]
    return own or forces or at_ports


def accelerations(system: SymbolicSystem) -> dict[sympy.Symbol, sympy.Expr]:
    """The highest derivative of each coordinate, solved."""
    solved = explicit(system)
    highest = [jet_symbol(q.name, n) for q, n in zip(solved.coordinates, solved.orders, strict=True)]
    return {x: x - residual for x, residual in zip(highest, solved.residuals, strict=True)}


def explicit(system: SymbolicSystem) -> Motion:
    """One solved equation for each coordinate."""
    jets = {system.states[v]: jet_symbol(system.states[q].name, 1) for q, v in system.coordinates if v >= 0}
    coordinates = tuple(system.states[q] for q, _ in system.coordinates)
    orders = tuple(2 if v >= 0 else 1 for _, v in system.coordinates)
    residuals = []
    for (q, v), order in zip(system.coordinates, orders, strict=True):
        rate = system.derivatives[v if order == 2 else q].xreplace(jets)
        residuals.append(jet_symbol(system.states[q].name, order) - rate)
    return Motion(coordinates, orders, tuple(residuals), {}, False)


def agrees(motion: Motion, interpreter: Interpreter, values: np.ndarray) -> bool:
    """The residuals vanish with the rates of the numeric system, and determine them; tried at a random point."""
    point = _random_point(motion, interpreter, values)
    highest = [jet_symbol(q.name, n) for q, n in zip(motion.coordinates, motion.orders, strict=True)]
    if not highest:
        return True
    matrix = np.zeros((len(highest), len(highest)))
    for i, r in enumerate(motion.residuals):
        for j in np.flatnonzero([x in r.free_symbols for x in highest]):
            matrix[i, j] = _number(slope(r, highest[j]), point)
    largest = np.abs(matrix).max(axis=1, initial=0.0)
    if not np.all(largest > 0) or np.linalg.matrix_rank(matrix / largest[:, None]) < len(highest):
        return False
    terms = [[_number(term, point) for term in r.as_ordered_terms()] for r in motion.residuals]
    return all(abs(sum(t)) <= 1e-8 * sum(map(abs, t)) for t in terms)


def _random_point(motion: Motion, interpreter: Interpreter, values: np.ndarray) -> dict[sympy.Symbol, sympy.Float]:
    """Numbers for all symbols that fit together: the rates are those of the numeric system."""
    import sympy as sp

    from lmoc.symbolic.numeric import NumericSystem

    reduced, flat = interpreter.reduced, interpreter.reduced.flat
    generator = np.random.default_rng(7)
    values = _with_all_values(flat, values, generator)
    system = NumericSystem(reduced, values, ())
    x = generator.uniform(0.2, 0.9, len(reduced.states))
    jets = generator.uniform(0.2, 0.9, reduced.inputs.shape[1])
    rates = system.rates_with(x, jets, 0.4)
    point = {sp.Symbol("time"): 0.4}
    for (_, variable, order), value in zip(reduced.inputs.T.tolist(), jets, strict=True):
        point[jet_symbol(flat.variable_name(variable), order)] = value
    for q, v in interpreter.outline().coordinates:
        name = interpreter.w[int(reduced.states[q])].name
        numbers = [x[q], x[v], rates[v]] if v >= 0 else [x[q], rates[q]]
        point |= {jet_symbol(name, n): value for n, value in enumerate(numbers)}
    point |= {s: float(values[v]) for s, v in interpreter.parameters.variable.items()}
    symbols = set().union(*(r.free_symbols for r in motion.residuals), set())
    point |= {s: generator.uniform(0.2, 0.9) for s in symbols - set(point)}
    return {s: sp.Float(float(value), 17) for s, value in point.items()}


def _with_all_values(flat, values: np.ndarray, generator) -> np.ndarray:
    """Parameter values with random ones where there are none, and what is bound to them."""
    values = values.copy()
    bound = np.concatenate([a.target for a in flat.bindings]) if flat.bindings else np.zeros(0, int)
    free = np.isnan(values) & np.isin(flat.kind, (Kind.CONSTANT, Kind.PARAMETER))
    free[bound.astype(int)] = False
    values[free] = generator.uniform(0.5, 1.5, int(free.sum()))
    for a in flat.bindings:
        if flat.kind[a.target[0]] in (Kind.CONSTANT, Kind.PARAMETER):
            values[a.target] = np.where(np.isnan(values[a.target]), a.values(values), values[a.target])
    return values


def _number(value: sympy.Expr, point: dict[sympy.Symbol, float]) -> float:
    return float(value.xreplace(point))
