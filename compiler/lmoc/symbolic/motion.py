"""Equations of motion by the principle of virtual power.

Connections carry no power: the sum of ``flow · rate of potential`` over all ports of all parts vanishes for every
motion that the connections allow (Tellegen's theorem). With the rates of the potentials as linear functions of the
coordinates' rates, each coordinate gives one equation, ``Σ flow · ∂(rate)/∂q̇ᵢ = 0``: Lagrange's equations in the parts'
own terms, with symmetric mass matrix, in which the flows of ideal parts (rods, gears, pulleys) cancel by themselves.
Nothing is inverted, so what the user wrote stays recognizable.

What a user has written beside the parts (a circuit, a bob that is no part) stands as it is; where reactions act in
it, they are eliminated. Every equation is checked against the numeric system at a random point. Scenes for which there
are not enough such equations get the explicit form, one solved acceleration an equation.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from typing import TYPE_CHECKING

import numpy as np

from lmoc.ir.reduced import Reduced
from lmoc.support.records import dataclass
from lmoc.symbolic.elimination import MOST_TERMS, eliminate
from lmoc.symbolic.kinematics import Kinematics
from lmoc.symbolic.local import NotLinearError, PartLaws
from lmoc.symbolic.search import scene_size
from lmoc.symbolic.shortening import along_tangents
from lmoc.symbolic.slope import slope
from lmoc.symbolic.sorting import without_squares
from lmoc.symbolic.system import Outline, SymbolicInterpreter, SymbolicSystem, jet_symbol, symbolic_system
from lmoc.symbolic.too_long import NoSymbolsError
from lmoc.symbolic.trial import Trial

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


def derive(
    reduced: Reduced,
    values: np.ndarray,
    forces: bool = False,
    solved: bool = False,
    named: bool = False,
) -> tuple[Motion, Outline]:
    """Return the equations of motion of a reduced system.

    Parameters
    ----------
    reduced, values : as in `symbolic_system`
    forces : with the internal forces of ideal parts
    solved : the explicit form even where there is one that divides by nothing
    named : curves through many points by their names

    Raises
    ------
    ModelError
        E0660 where the scene is too large, or has neither form.
    """
    interpreter = SymbolicInterpreter(reduced, values, MOST_TERMS, named)
    outline = interpreter.outline()
    by_power = not solved or bool(interpreter.curves and interpreter.curves.over)  # no case of a curve stands in these
    found = _balanced(interpreter, outline, values, forces) if by_power else None
    if found is not None and solved:
        found = _solved(found)
    if found is not None:
        return replace(found, values=dict(interpreter.parameters.used)), outline
    return explicit(symbolic_system(reduced, values, most=MOST_TERMS, named=named)), outline


def balances(reduced: Reduced, values: np.ndarray) -> SymbolicSystem:
    """A system with the same states of rest: in the place of accelerations the forces that would cause them.

    Nothing is divided by a mass matrix, so its equations are far shorter than the solved ones. A scene without
    equations by virtual power gives its solved form.
    """
    import sympy as sp

    motion, outline = derive(reduced, values)
    if not motion.balanced:
        return symbolic_system(reduced, values, most=MOST_TERMS)
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
        size=scene_size(reduced.flat, values),
    )


def _balanced(interpreter: SymbolicInterpreter, outline: Outline, values: np.ndarray, forces: bool) -> Motion | None:
    """Equations that divide by nothing that moves; None where there are not enough of them."""
    ports = ports_of_elements(interpreter.reduced.flat)
    try:
        kinematics = Kinematics(interpreter, outline, [p for p, _ in ports])
        laws = PartLaws(interpreter.reduced.flat, kinematics)
        trial = Trial(interpreter, values)
        residuals = _independent(kinematics, trial, _candidates(kinematics, laws, ports, trial))
        if residuals is None:
            return None
        found, own = _reactions(laws, set(interpreter.reduced.undetermined.tolist())) if forces else ({}, {})
    except (NoSymbolsError, NotLinearError):
        return None
    residuals = tuple(along_tangents(r, interpreter.curves) for r in residuals)
    return Motion(tuple(kinematics.coordinates), tuple(kinematics.orders), residuals, found, True, own)


def _candidates(kinematics: Kinematics, laws: PartLaws, ports: list, trial: Trial) -> Iterator[sympy.Expr]:
    """Residuals that may be equations of motion, the likeliest first.

    Virtual power, also of coordinates that roll together; what a user has written beside the parts (a circuit, a bob
    that is no part); sums in which the forces between ideal parts cancel.
    """
    power, reactions = power_by_coordinate(kinematics, laws, ports)
    power = _along(power, kinematics, _rolling(kinematics, laws))
    yield from _virtual_power(power, reactions, trial)
    yield from (laws.residual(i) for i in laws.closed)
    elimination, _, right = laws.solve_relations(balances=True)
    yield from (_total(combination, right) for combination in elimination.conditions)


def _independent(
    kinematics: Kinematics, trial: Trial, candidates: Iterable[sympy.Expr]
) -> tuple[sympy.Expr, ...] | None:
    """As many true equations as there are coordinates, which determine the highest derivatives; in their order."""
    highest = [jet_symbol(q.name, n) for q, n in zip(kinematics.coordinates, kinematics.orders, strict=True)]
    rows, residuals = np.zeros((0, len(highest))), []
    for residual in candidates if highest else ():
        row = trial.slopes(residual, highest)
        more = np.vstack([rows, row])
        if not np.isfinite(row).all():
            continue
        if row.any() and np.linalg.matrix_rank(more, tol=1e-9) > len(rows) and trial.vanishes(residual):
            rows, residuals = more, [*residuals, residual]
            if len(residuals) == len(highest):
                break
    if len(residuals) < len(highest):
        return None
    place = _each_its_own(np.abs(rows) > 1e-12)
    return tuple(residuals[i] for i in place)


def _each_its_own(occurs: np.ndarray) -> list[int]:
    """For each column a row in which it occurs, all different: augmenting paths, the row of the same number first."""
    n = len(occurs)
    row_of: dict[int, int] = {}  # column -> row
    column_of: dict[int, int] = {}

    def augment(column: int, seen: set[int]) -> bool:
        for row in sorted(np.flatnonzero(occurs[:, column]).tolist(), key=lambda i: i != column):
            if row not in seen:
                seen.add(row)
                if row not in column_of or augment(column_of[row], seen):
                    row_of[column], column_of[row] = row, column
                    return True
        return False

    for column in range(n):
        augment(column, set())
    return [row_of[column] for column in range(n)]


def _total(combination: Mapping[int, sympy.Expr], right: Sequence[sympy.Expr]) -> sympy.Expr:
    import sympy as sp

    return sp.Add(*(c * right[j] for j, c in combination.items()))


def _rolling(kinematics: Kinematics, laws: PartLaws) -> dict[sympy.Symbol, sympy.Expr]:
    """Return the rates of coordinates that roll along with others, ``θ̇ = −ẋ/r``, and the rates of these.

    On a curve the factor depends on the place: ``θ̇ = −l(s)·ṡ/r``.
    """
    found: dict[sympy.Symbol, sympy.Expr] = {}
    orders = dict(zip(kinematics.coordinates, kinematics.orders, strict=True))
    first = [q for q, n in orders.items() if n == 1]
    second = [q for q, n in orders.items() if n == 2]
    known = {jet_symbol(q.name, 1) for q in second} | set(second)
    if kinematics.curves is not None:
        known |= kinematics.curves.derivative_of.keys()
    residuals = [laws.residual(i) for i in laws.closed] if first else []
    for q in first:
        rate = jet_symbol(q.name, 1)
        rows = ((slope(r, rate), r) for r in residuals if r.has(rate))
        for factor, residual in rows:
            if not factor.free_symbols <= kinematics.parameters:
                continue
            value = without_squares((rate - residual / factor).expand())
            if known >= value.free_symbols - kinematics.parameters:
                found |= {rate: value, jet_symbol(q.name, 2): kinematics.rate(value)}
                break
    return found


def _along(
    power: Sequence[sympy.Expr], kinematics: Kinematics, rolling: Mapping[sympy.Symbol, sympy.Expr]
) -> list[sympy.Expr]:
    """Return the power for a unit rate of each coordinate that does not roll along, those that do moving with it."""
    import sympy as sp

    rates = [jet_symbol(q.name, 1) for q in kinematics.coordinates]
    own = list(zip(rates, power, strict=True))
    rolled = [(rolling[rate], p) for rate, p in own if rate in rolling]
    return [
        sp.Add(p, *(slope(value, rate) * other for value, other in rolled)).xreplace(rolling)
        for rate, p in own
        if rate not in rolling
    ]


def _virtual_power(power: Sequence[sympy.Expr], reactions: set[sympy.Symbol], trial: Trial) -> Iterator[sympy.Expr]:
    """The power of all flows for a unit rate of each coordinate in turn, without those in which a reaction stays."""
    for total in power:
        residual = _without(total, reactions, trial)
        if residual is not None:
            yield residual


def power_by_coordinate(
    kinematics: Kinematics, laws: PartLaws, ports: list
) -> tuple[list[sympy.Expr], set[sympy.Symbol]]:
    """Return the power of all flows for a unit rate of each coordinate, and the symbols of unknown reactions."""
    import sympy as sp

    elimination, unknowns, right = laws.solve_relations()
    tied = {
        unknowns[v]: _total(combination, right) + sp.Add(*(c * unknowns[x] for x, c in elimination.by_free[v].items()))
        for v, combination in elimination.solution.items()
    }
    rates = [jet_symbol(q.name, 1) for q in kinematics.coordinates]
    power: dict[sympy.Symbol, list] = {q: [] for q in rates}
    for potential, flow in ports:
        rate = kinematics.rate(kinematics.value(potential))
        for q in rates:
            weight = slope(rate, q)
            if weight != 0:
                power[q].append(laws.value(flow).xreplace(tied) * weight)
    return [sp.Add(*power[q]) for q in rates], set(unknowns.values())


def ports_of_elements(flat) -> list[tuple[int, int]]:
    """(potential, flow) variables of all elements."""
    pairs = []
    for part in flat.parts:
        if part.leaf:
            for p, f in part.ports:
                potential, flow = flat.blocks[p], flat.blocks[f]
                pairs += [(potential.offset + i, flow.offset + i) for i in range(flow.size)]
    return pairs


def _without(power: sympy.Expr, reactions: set, trial: Trial) -> sympy.Expr | None:
    """The sum with the reactions cancelled; None where one stays."""
    import sympy as sp

    for reaction in sorted(power.free_symbols & reactions, key=lambda s: s.name):
        if not trial.vanishes(sp.expand(slope(power, reaction))):
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


def accelerations(solved: Motion) -> dict[sympy.Symbol, sympy.Expr]:
    """The highest derivative of each coordinate, from solved equations."""
    return {x: x - residual for x, residual in zip(_highest(solved), solved.residuals, strict=True)}


def _highest(motion: Motion) -> list[sympy.Symbol]:
    return [jet_symbol(q.name, n) for q, n in zip(motion.coordinates, motion.orders, strict=True)]


def _solved(motion: Motion) -> Motion | None:
    """Equations by virtual power, solved for the highest derivatives; None where that takes too many terms."""
    import sympy as sp

    highest = _highest(motion)
    rows = [{i: slope(r, x) for i, x in enumerate(highest) if r.has(x)} for r in motion.residuals]
    found = eliminate(rows, most=MOST_TERMS)
    if found.conditions or len(found.solution) < len(highest):
        return None
    right = [-r.xreplace(dict.fromkeys(highest, sp.S.Zero)) for r in motion.residuals]
    residuals = tuple(x - _total(found.solution[i], right) for i, x in enumerate(highest))
    return replace(motion, residuals=residuals, forces={}, balanced=False)


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
