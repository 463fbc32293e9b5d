"""Equilibria of scenes with laws: which strings are slack, which contacts closed, and what friction may hold.

The static complementarity problem says which modes have states of rest (`statics`); in each of these modes the scene is
one without laws, whose equilibria are found as always (`symbolic.interface.equilibria`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from lmoc.ir.law import LawKind
from lmoc.ir.prepared import Prepared
from lmoc.messages.diagnostics import Area, ModelError
from lmoc.symbolic import places
from lmoc.symbolic.equilibria import Equilibria, Equilibrium, LawsAtRest
from lmoc.symbolic.interface import equilibria
from lmoc.symbolic.laws.friction_limits import is_held, within_limits
from lmoc.symbolic.laws.modes import Lawful
from lmoc.symbolic.laws.statics import (
    CLOSED,
    FRICTIONS,
    MOST_FOUND,
    OPEN,
    ZERO,
    Array,
    LawChoice,
    Polyhedra,
    StaticSystem,
    choices,
)
from lmoc.symbolic.numeric import NumericSystem, contains_time
from lmoc.symbolic.places import Point
from lmoc.symbolic.rational import cancelled
from lmoc.symbolic.resting_loops import rests_of_loops
from lmoc.symbolic.rests import linear_model_at
from lmoc.symbolic.system import MOST_OPERATIONS, refuse, symbolic_system, time_stands_in_it
from lmoc.symbolic.too_long import NoSymbolsError
from lmoc.symbolic.trial import with_all_values
from lmoc.symbolic.values import NoValueError, exactly, read_values

if TYPE_CHECKING:
    import sympy

MOST_TRIED = 256  # modes of a nonlinear scene, or of one without values, which are tried one after the other
HOW = "the static complementarity problem of its laws"


def equilibria_with_laws(scene: Lawful, inputs: Point | None = None) -> Equilibria:
    """Return the states of rest for constant inputs, those not given at zero.

    Raises
    ------
    ModelError
        E0660 time in the equations, or too many modes; E0661 an unknown name; E0621 a value that does not fit.
    """
    places.check_names(inputs or {}, scene.prepared.inputs)
    given = dict.fromkeys(scene.prepared.inputs, 0.0)
    given |= places.numbers(scene.prepared, read_values(inputs or {}, scene.flat))
    try:
        system = StaticSystem(scene, given)
    except NoValueError:
        return _of_all_modes(scene, given)
    if contains_time(system.reduced.rhs):
        raise time_stands_in_it()
    if not system.is_linear():
        return _of_tried_modes(scene, system, given)
    statics = system.about(np.zeros(len(system.states)))
    polyhedra = Polyhedra(statics)
    found: list[Equilibrium] = []
    for choice in choices(polyhedra):
        found += _of_choice(scene, system, polyhedra, choice, given)
        if len(found) >= MOST_FOUND:
            return Equilibria(found, f"{HOW}; there may be more than these {MOST_FOUND}")
    return Equilibria(_sorted(found), "exact")


def _sorted(found: list[Equilibrium]) -> list[Equilibrium]:
    """Equilibria with isolated ones first."""
    return sorted(found, key=lambda e: (len(e.free), sum(e.laws.closed) if e.laws else 0))


# ---------------------------------------------------------------------- linear scenes


def _of_choice(
    scene: Lawful, system: StaticSystem, polyhedra: Polyhedra, choice: LawChoice, inputs: Mapping[str, float]
) -> Iterator[Equilibrium]:
    """Yield the equilibria of one mode, with the ranges that its laws leave."""
    mode = scene.in_mode(choice.closed == CLOSED, choice.direction)
    point = polyhedra.point(choice)
    for rest in equilibria(mode, inputs):
        whole = _with_laws(scene, mode, rest, choice)
        free = {s.name for s in whole.free}
        ranges = {n: polyhedra.range(choice, _unit(polyhedra, system.states.index(n))) for n in sorted(free)}
        limited = {n: r for n, r in ranges.items() if np.isfinite(r).any()}
        member = {} if point is None or not limited else dict(zip(system.states, point.tolist(), strict=False))
        laws = replace(
            whole.laws,
            range=limited,
            member={n: v for n, v in member.items() if n in free},
            force_range=_force_ranges(scene, polyhedra, choice),
            at_limit=_at_limit(scene, polyhedra, choice),
        )
        yield replace(whole, laws=laws)


def _unit(polyhedra: Polyhedra, k: int) -> Array:
    return np.eye(len(polyhedra.column))[k]


def _force_ranges(scene: Lawful, polyhedra: Polyhedra, choice: LawChoice) -> dict[str, tuple[float, float]]:
    """Return the ranges of the forces of closed laws that are not one number."""
    statics, found = polyhedra.statics, {}
    for law in np.flatnonzero(choice.closed == CLOSED).tolist():
        low, high = polyhedra.range(choice, statics.force(law)[0])
        size = max(abs(low), abs(high), polyhedra.column[statics.states + law])
        if np.isinf(size) or high - low > ZERO * size:
            found[scene.force_names[law]] = low, high
    return found


def _at_limit(scene: Lawful, polyhedra: Polyhedra, choice: LawChoice) -> tuple[str, ...]:
    """Return the names of closed complementarities that hold with no force, and open ones without a gap."""
    statics, found = polyhedra.statics, []
    for law, name in enumerate(scene.names):
        if statics.kinds[law] in FRICTIONS:
            continue
        row, constant = statics.force(law) if choice.closed[law] == CLOSED else statics.motion[law]
        most = polyhedra.extreme(choice, row, constant)
        size = float((np.abs(row) * polyhedra.column).max(initial=0.0))
        if most is not None and most <= ZERO * size:
            found.append(name)
    return tuple(found)


# ---------------------------------------------------------------------- of one mode


def _with_laws(scene: Lawful, mode: Prepared, rest: Equilibrium, choice: LawChoice) -> Equilibrium:
    """Return an equilibrium of a mode as one of the scene: all of its states, and the forces of closed laws."""
    import sympy as sp

    closed, released = choice.closed == CLOSED, mode.reduced.in_all_coordinates
    states = scene.prepared.reduced.state_names
    if released:  # those of the scene with all laws open have names that a person knows
        free_scene = scene.in_mode(np.zeros(scene.count, bool)).reduced
        states = list(dict.fromkeys([*free_scene.state_names, *mode.reduced.state_names]))
    forces = {scene.force_names[k]: int(scene.force[k]) for k in np.flatnonzero(closed)}
    own = {s.name: value for s, value in rest.values.items()}
    others = {n: int(v[0]) for n in states if n not in own and (v := scene.flat.find(n)) is not None}
    found = own | _variables(mode, rest, others | forces)
    named = [n for n in states if not released or scene.flat.find(n) is not None]
    values = {sp.Symbol(n): found.get(n, sp.S.Zero) for n in named}  # unnamed ones are rates, which vanish
    free = tuple(s for s in rest.free if s in values)
    laws = LawsAtRest(
        scene.words(closed), closed, np.where(closed, 0, choice.direction), {n: found[n] for n in forces if n in found}
    )
    return replace(rest, values=values, free=free, laws=laws)


def _variables(mode: Prepared, rest: Equilibrium, variables: Mapping[str, int]) -> dict[str, sympy.Expr]:
    """Return variables of a mode at rest, in its states and parameters; in numbers where there are no symbols."""
    import sympy as sp

    reduced, values = mode.reduced, mode.values
    variables = {n: v for n, v in variables.items() if v not in reduced.undetermined}
    if not variables:
        return {}
    if reduced.in_all_coordinates:
        return _in_numbers(mode, rest, variables)
    at = dict(rest.values) | dict(rest.inputs)
    try:
        system = symbolic_system(reduced, values, variables)
    except NoSymbolsError:
        return _in_numbers(mode, rest, variables)
    at |= {u: at.get(u, sp.S.Zero) for u in system.inputs}
    at |= {jet: sp.S.Zero for u in system.inputs for jet in system.jets(u)[1:]}
    return {n: _tidy(sp.sympify(system.variables[n]).xreplace(at)) for n in variables}


def _tidy(value: sympy.Expr) -> sympy.Expr:
    import sympy as sp

    return sp.factor_terms(cancelled(value) if value.count_ops() <= MOST_OPERATIONS else value)


def _in_numbers(mode: Prepared, rest: Equilibrium, variables: Mapping[str, int]) -> dict[str, sympy.Expr]:
    import sympy as sp

    system = NumericSystem(mode.reduced, mode.values, list(variables.values()))
    at = (sp.sympify(rest.get(n, 0)) for n in system.states)  # rates without a name vanish
    x = np.array([float(value.subs(dict.fromkeys(rest.free, 0))) for value in at])
    u = np.array([float(rest.inputs.get(sp.Symbol(n), 0.0)) for n in system.inputs])
    system.approach(x, u)
    value = system.matrices(x, u)[0][len(x) :]
    return dict(zip(variables, map(sp.Float, value.tolist()), strict=True))


# ---------------------------------------------------------------------- modes tried one after the other


def _still(system: StaticSystem) -> list[bool]:
    """Return for each law whether it acts on a gap, or on a velocity that vanishes at rest."""
    statics = system.about(np.zeros(len(system.states)))
    return [kind is LawKind.UNILATERAL or statics.at_rest(k) for k, kind in enumerate(statics.kinds)]


def _tried(scene: Lawful, still: list[bool]) -> Iterator[LawChoice]:
    """Yield all choices; laws on velocities that vanish at rest are closed.

    Raises
    ------
    ModelError
        E0660 there are too many.
    """
    ways = []
    for kind, rests in zip(scene.kinds, still, strict=True):
        if kind is LawKind.UNILATERAL:
            ways.append([(OPEN, 0), (CLOSED, 0)])
        elif rests:
            ways.append([(CLOSED, 0)])
        else:
            ways.append([(CLOSED, 0), *([(OPEN, 1), (OPEN, -1)] if kind in FRICTIONS else [(OPEN, 0)])])
    count = int(np.prod([float(len(w)) for w in ways]))
    if count > MOST_TRIED:
        reason = f"{count} modes of the laws would have to be tried"
        raise refuse(f"the equilibria of a nonlinear scene, or one without values, are sought mode by mode: {reason}")
    for chosen in product(*ways):
        closed, direction = np.array(chosen, int).reshape(-1, 2).T
        yield LawChoice(closed, direction)


def _rests_of(
    scene: Lawful, choice: LawChoice, inputs: Mapping[str, float], in_numbers: bool
) -> Iterator[tuple[Prepared, Equilibrium]]:
    """Yield the equilibria of a mode; none where its closed laws contradict each other."""
    try:
        mode = scene.in_mode(choice.closed == CLOSED, choice.direction)
    except ModelError as error:
        if not all(d.area is Area.STRUCTURE and d.severity == "error" for d in error.diagnostics):
            raise
        return  # a structure that cannot be: two stops that would hold one body at two places
    if in_numbers and mode.reduced.invariants is not None and len(mode.reduced.states):
        yield from _rests_of_loops(scene, mode, choice, inputs)
        return
    for rest in equilibria(mode, inputs):
        yield mode, _with_laws(scene, mode, rest, choice)


def _rests_of_loops(
    scene: Lawful, mode: Prepared, choice: LawChoice, inputs: Mapping[str, float]
) -> Iterator[tuple[Prepared, Equilibrium]]:
    """Yield the equilibria of a mode in which loops are closed, as by a taut string in the plane, on all branches."""
    import sympy as sp

    released = replace(mode, reduced=scene.release(mode.reduced))
    found, how = rests_of_loops(released.reduced, mode.values, inputs)
    for one in found:
        there = scene.reduce_at(mode.flat, mode.values, one.place)
        point = {name: one.place.get(name, 0.0) for name in there.state_names} | dict(inputs)
        given = {sp.Symbol(name): exactly(value) for name, value in inputs.items()}
        free = tuple(x for x, value in one.values.items() if value == x)
        still = {sp.Symbol(name): sp.S.Zero for name in released.reduced.state_names}
        model = linear_model_at(there, mode.values, point)
        rest = Equilibrium(still | dict(one.values), free, (), how, model, nonlinear=True, inputs=given)
        yield released, _with_laws(scene, released, rest, choice)


def _of_all_modes(scene: Lawful, inputs: Mapping[str, float]) -> Equilibria:
    """Return the equilibria in symbols of all modes, with the conditions under which each exists."""
    generator = np.random.default_rng(5)
    sample = replace(scene.prepared, values=with_all_values(scene.flat, scene.prepared.values, generator))
    system = StaticSystem(replace(scene, prepared=sample), inputs)
    found = []
    for choice in _tried(scene, _still(system)):
        for mode, rest in _rests_of(scene, choice, inputs, in_numbers=False):
            conditions = _conditions(scene, mode, rest, choice)
            if not any(c.is_negative for c in conditions):
                asked = tuple(c for c in conditions if not c.is_nonnegative)
                found.append(replace(rest, laws=replace(rest.laws, conditions=asked)))
    return Equilibria(_sorted(found), "exact")


def _conditions(scene: Lawful, mode: Prepared, rest: Equilibrium, choice: LawChoice) -> list[sympy.Expr]:
    """Return what must not be negative: gaps of open laws, forces of closed ones, what is left of friction limits."""
    found: list[sympy.Expr] = []
    closed = iter((choice.closed == CLOSED).tolist())
    for g in scene.flat.laws:
        limit = g.stick if g.friction is None else g.friction
        for row in range(g.rows):
            held = next(closed)
            if g.kind not in FRICTIONS:
                found += _variables(mode, rest, {"": int((g.force if held else g.motion)[row])}).values()
            elif held:
                columns = {"force": g.force, "limit": limit, "normal": g.normal}
                own = _variables(mode, rest, {n: int(c[row]) for n, c in columns.items() if c is not None})
                largest = own["limit"] * own.get("normal", 1)
                found += [largest - own["force"], largest + own["force"]] if "force" in own else []
    return found


def _of_tried_modes(scene: Lawful, system: StaticSystem, inputs: Mapping[str, float]) -> Equilibria:
    """Return the equilibria of a nonlinear scene: those of each mode at which forces and gaps have their signs."""
    found, how = [], "exact"
    for choice in _tried(scene, _still(system)):
        for mode, rest in _rests_of(scene, choice, inputs, in_numbers=True):
            how = rest.how if rest.how != "exact" else how
            if mode.reduced.in_all_coordinates and not any(is_held(scene, choice)):
                found += [rest] if _has_its_signs(scene, mode, rest, choice) else []
            else:
                found += within_limits(scene, system, rest, choice)
    return Equilibria(_sorted(found), how)


def _has_its_signs(scene: Lawful, mode: Prepared, rest: Equilibrium, choice: LawChoice) -> bool:
    """Return whether gaps of open laws and forces of closed ones are not negative, of a family where it is zero."""
    free = {s.name for s in rest.free}
    numbers = np.array([places.number(scene.prepared, c, free) for c in _conditions(scene, mode, rest, choice)])
    return bool((numbers >= -ZERO * (1.0 + np.abs(numbers).max(initial=0.0))).all())
