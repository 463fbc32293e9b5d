"""Linear models of closed loops about a state of rest, in symbols.

In all coordinates q of its loops a scene obeys ``P(q, q̇, q̈, u) = Gᵀλ`` and ``g(q) = 0`` with G = ∂g/∂q. Some of the
coordinates are states, x; the others, z, follow from the closures, which have no solution in closed form. About a state
of rest none is needed, for it suffices to differentiate them: ``δz = κ δx`` with ``G_z κ = −G_x``. In the directions
T = [1; κ] that the closures allow the reactions do no power (Nikravesh, Computer-Aided Analysis of Mechanical Systems,
1988, ch. 9 and 14), so that

    Tᵀ(∂R/∂q̈ T δẍ + ∂R/∂q̇ T δẋ + ∂R/∂q T δx + ∂R/∂u δu) = 0,    R = P − Gᵀλ,    G_zᵀ λ = P_z,

with λ held in the derivatives, since its own change has the factor TᵀGᵀ = 0. The entries of the model consist of
parameters and of the coordinates at rest; κ and λ abbreviate them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from lmoc.ir.prepared import Prepared
from lmoc.ir.reduced import Reduced
from lmoc.support.records import dataclass
from lmoc.symbolic.elimination import MOST_TERMS, Row, eliminate
from lmoc.symbolic.lagrange_first_kind import FirstKind, derive_first_kind, numbered
from lmoc.symbolic.linearize import LinearModel
from lmoc.symbolic.loops_at_rest import LoopsAtRest
from lmoc.symbolic.numeric import linearize_numerically, variable
from lmoc.symbolic.places import numbers
from lmoc.symbolic.shortening import collected, tidy
from lmoc.symbolic.slope import slope
from lmoc.symbolic.system import coordinates_of, jet_symbol
from lmoc.symbolic.too_long import no_symbols
from lmoc.symbolic.values import NoValueError

if TYPE_CHECKING:
    import sympy

SATISFIED = 1e-6  # of the terms of an equation that holds
MOST_IN_PLACE = 6  # operations of a coefficient without an abbreviation


def linearize_loops(
    prepared: Prepared,
    released: Reduced,
    point: Mapping[str, sympy.Expr],
    outputs: Sequence[str],
) -> LinearModel:
    """Return the linear model of closed loops about a state of rest, in symbols.

    Parameters
    ----------
    prepared : the scene in minimal coordinates, whose states are those of the model
    released : its reduction with all coordinates of the loops as states
    point : {state or input: value at rest}; a state with a decimal number stays a symbol
    outputs : names of variables

    Raises
    ------
    ModelError
        E0660: not at rest, or the scene has no equations in all coordinates that could be read.
    """
    loops = derive_first_kind(released, prepared.values)
    if loops is None:
        raise no_symbols(
            "the closed loops of this scene have no linear model in symbols: masses and forces are not all in parts",
            hint="in numbers they have one: leave `symbolic` out",
        )
    minimal = prepared.reduced.state_names
    dependent = tuple(q for q in loops.motion.coordinates if q.name not in minimal)
    if len(dependent) != len(loops.closures):
        raise no_symbols("the closures of the loops do not determine the dependent coordinates")
    at = _numbers_at_rest(prepared, point, dependent)
    scene = _at_rest(loops, dependent, point, prepared.inputs)
    return _finished(scene, prepared, _expressions(loops, outputs), at)


def _numbers_at_rest(
    prepared: Prepared, point: Mapping[str, sympy.Expr], dependent: Sequence[sympy.Symbol]
) -> dict[sympy.Symbol, float]:
    """Return the states and the dependent coordinates at rest, on the branch of the start.

    Without a value for each parameter there are no numbers.
    """
    import sympy as sp

    names = [q.name for q in dependent]
    try:
        model = linearize_numerically(prepared.reduced, prepared.values, numbers(prepared, point), names)
    except NoValueError:
        return {}
    if not model.at_rest:
        raise no_symbols(
            "closed loops have a linear model in symbols about a state of rest, and this point is none",
            hint="`lmoc equilibria` lists them; in numbers any point will do",
        )
    states = {sp.Symbol(name): float(model.point[name]) for name in model.states}
    return states | {q: float(v) for q, v in zip(dependent, model.output_values, strict=True)}


def _expressions(loops: FirstKind, outputs: Sequence[str]) -> dict[str, sympy.Expr]:
    """Return the outputs in the states of all coordinates."""
    interpreter = loops.interpreter
    places = {name: variable(interpreter.reduced, name) for name in outputs}
    registers = [int(interpreter.reduced.register_of[v]) for v in places.values()]
    interpreter.fill([r for r in registers if r >= 0])
    return {name: interpreter.variable(v) for name, v in places.items()}


@dataclass(frozen=True, eq=False)
class _Scene:
    """A scene at rest.

    Attributes
    ----------
    loops : its equations in all coordinates
    velocity : {coordinate of second order: velocity}, the states
    rest : values of all that does not stay a symbol: rates, inputs, exact places
    along : {coordinate: {free coordinate: ∂coordinate/∂free}}, the matrix T, with κ as symbols
    shorthand : {κ or λ: Expr}
    meaning : {κ: (dependent coordinate, free coordinate)}
    """

    loops: FirstKind
    velocity: Mapping[sympy.Symbol, sympy.Symbol]
    rest: Mapping[sympy.Symbol, sympy.Expr]
    along: Mapping[sympy.Symbol, Mapping[sympy.Symbol, sympy.Expr]]
    shorthand: Mapping[sympy.Symbol, sympy.Expr]
    meaning: Mapping[sympy.Symbol, tuple[sympy.Symbol, sympy.Symbol]]

    @property
    def free(self) -> list[sympy.Symbol]:
        return [q for q, row in self.along.items() if q in row]

    @property
    def orders(self) -> list[int]:
        """Return the order of the equation of each coordinate, in the order of `along`."""
        own = dict(zip(self.loops.motion.coordinates, self.loops.motion.orders, strict=True))
        return [own[q] for q in self.along]

    def is_place(self, state: str) -> bool:
        """Return whether a state is a coordinate, and no velocity."""
        return any(q.name == state for q in self.along)

    def balance(self, x: sympy.Symbol) -> sympy.Expr:
        """Return the equation of motion along a free coordinate, its direction held."""
        import sympy as sp

        motion = self.loops.motion
        rows = zip(motion.coordinates, motion.residuals, strict=True)
        return sp.Add(*(self.along[q][x] * residual for q, residual in rows if x in self.along[q]))

    def slope(self, value: sympy.Expr, x: sympy.Symbol, order: int) -> sympy.Expr:
        """Return the derivative of an expression in jets by a derivative of a free coordinate, at rest."""
        import sympy as sp

        parts = ((jet_symbol(q.name, order), row[x]) for q, row in self.along.items() if x in row)
        return sp.Add(*(slope(value, jet) * rate for jet, rate in parts)).xreplace(self.rest)

    def by_states(self, values: Sequence[sympy.Expr], states: Sequence[str]) -> sympy.Matrix:
        """Return the derivatives of expressions in jets by the states, at rest."""
        import sympy as sp

        position = {v: q for q, v in self.velocity.items()}
        symbols = [sp.Symbol(name) for name in states]
        columns = [(position.get(x, x), int(x in position)) for x in symbols]
        return sp.Matrix(len(values), len(states), [self.slope(e, *column) for e in values for column in columns])

    def by_inputs(self, values: Sequence[sympy.Expr], inputs: Sequence[str], order: int) -> sympy.Matrix:
        """Return the derivatives of expressions by a derivative of the inputs, at rest."""
        import sympy as sp

        jets = [jet_symbol(u, order) for u in inputs]
        return sp.Matrix(len(values), len(jets), [slope(e, jet).xreplace(self.rest) for e in values for jet in jets])


def _at_rest(
    loops: FirstKind, dependent: Sequence[sympy.Symbol], point: Mapping[str, sympy.Expr], inputs: Sequence[str]
) -> _Scene:
    import sympy as sp

    outline, coordinates = loops.outline, loops.motion.coordinates
    velocity = {outline.states[q]: outline.states[v] for q, v in outline.coordinates if v >= 0}
    rest: dict = {jet_symbol(q.name, n): sp.S.Zero for q in coordinates for n in (1, 2)}
    rest |= dict.fromkeys(velocity.values(), sp.S.Zero)
    rest |= {jet: sp.S.Zero for jets in outline.input_jets.values() for jet in jets[1:]}
    rest |= {sp.Symbol(u): point.get(u, sp.S.Zero) for u in inputs}
    rest |= {q: point[q.name] for q in coordinates if q.name in point and not _is_decimal(point[q.name], q)}
    slopes = {(k, q): slope(g, q).xreplace(rest) for k, g in enumerate(loops.closures) for q in coordinates}
    along, kappa, meaning = _directions(loops, slopes, dependent)
    power = {q: p.xreplace(rest) for q, p in zip(coordinates, loops.power, strict=True)}
    reactions = _reactions(loops, slopes, [(q, power[q]) for q in dependent])
    rest |= {symbol: value for symbol, value in reactions.items() if value == 0}
    shorthand = kappa | {symbol: value for symbol, value in reactions.items() if value != 0}
    return _Scene(loops, velocity, rest, along, shorthand, meaning)


def _is_decimal(value: sympy.Expr, itself: sympy.Symbol) -> bool:
    """Return whether a value is no more than a number, which belongs to some parameter values only."""
    return value.is_Float or value.is_Rational and not value.is_Integer or value == itself


def _directions(
    loops: FirstKind, slopes: Mapping[tuple[int, sympy.Symbol], sympy.Expr], dependent: Sequence[sympy.Symbol]
) -> tuple[dict, dict, dict]:
    """Return how all coordinates move with the free ones, with κ as symbols; what these stand for, and mean."""
    import sympy as sp

    closures = range(len(loops.closures))
    rows = [{j: slopes[k, z] for j, z in enumerate(dependent) if slopes[k, z] != 0} for k in closures]
    solution = _solved(rows, len(dependent))
    along = {q: {q: sp.S.One} for q in loops.motion.coordinates if q not in dependent}
    places = [(j, x) for j in range(len(dependent)) for x in along if any(slopes[k, x] != 0 for k in closures)]
    values = [tidy(-sp.Add(*(c * slopes[k, x] for k, c in solution[j].items()))) for j, x in places]
    long = [not (v.is_Number or v.is_Symbol) for v in values]
    symbols = iter(numbered("kappa", sum(long), loops.interpreter.reduced.flat))
    along |= {z: {} for z in dependent}
    kappa, meaning = {}, {}
    for (j, x), value, named in zip(places, values, long, strict=True):
        if named:
            symbol = next(symbols)
            kappa[symbol], meaning[symbol] = value, (dependent[j], x)
        if value != 0:
            along[dependent[j]][x] = symbol if named else value
    return along, kappa, meaning


def _reactions(
    loops: FirstKind,
    slopes: Mapping[tuple[int, sympy.Symbol], sympy.Expr],
    power: Sequence[tuple[sympy.Symbol, sympy.Expr]],
) -> dict[sympy.Symbol, sympy.Expr]:
    """Return the multipliers at rest, which balance the power of the dependent coordinates."""
    import sympy as sp

    closures = range(len(loops.closures))
    solution = _solved([{k: slopes[k, z] for k in closures if slopes[k, z] != 0} for z, _ in power], len(closures))
    right = [p for _, p in power]
    totals = [tidy(sp.Add(*(c * right[j] for j, c in solution[k].items()))) for k in closures]
    return dict(zip(loops.multipliers, totals, strict=True))


def _solved(rows: Sequence[Row], count: int) -> Mapping[int, Row]:
    """Return each of `count` unknowns as a combination of the right-hand sides."""
    found = eliminate(rows, most=MOST_TERMS)
    if found.conditions or len(found.solution) < count:
        raise no_symbols("the closed loops are singular at this place: they have no linear model there")
    return found.solution


def _finished(
    scene: _Scene,
    prepared: Prepared,
    outputs: Mapping[str, sympy.Expr],
    at: Mapping[sympy.Symbol, float],
) -> LinearModel:
    """Return the linear model without abbreviations; its `loops` have them."""
    import sympy as sp

    states, inputs = prepared.reduced.state_names, prepared.inputs
    free, orders = scene.free, dict(zip(scene.along, scene.orders, strict=True))
    balance = [scene.balance(x) for x in free]
    by_states = scene.by_states(balance, states)
    highest = sp.Matrix(len(free), len(free), lambda i, j: scene.slope(balance[i], free[j], orders[free[j]]))
    scene, (highest, by_states) = _abbreviated(scene, highest, by_states, [scene.is_place(n) for n in states])
    inertia = [{j: h for j, h in enumerate(highest.row(i)) if h != 0} for i in range(len(free))]
    solution = _solved(inertia, len(free))
    inverse = sp.Matrix(len(free), len(free), lambda i, j: solution[i].get(j, 0))
    row_of = {scene.velocity.get(x, x).name: i for i, x in enumerate(free)}
    unit = {x.name: [int(name == v.name) for name in states] for x, v in scene.velocity.items()}

    def rates(slopes: sympy.Matrix, of_places: Mapping[str, list[int]]) -> sympy.Matrix:
        solved = (-inverse * slopes).applyfunc(tidy)
        rows = [list(solved.row(row_of[name])) if name in row_of else of_places[name] for name in states]
        return sp.Matrix(len(states), slopes.cols, [e for row in rows for e in row])

    jet = {v: jet_symbol(q.name, 1) for q, v in scene.velocity.items()}
    seen = [h.xreplace(jet) for h in outputs.values()]
    still = [0] * len(inputs)
    jets = max((len(jets) for jets in scene.loops.outline.input_jets.values()), default=1)
    short = LinearModel(
        states=list(states),
        inputs=list(inputs),
        outputs=list(outputs),
        A=rates(by_states, unit),
        Bs=tuple(rates(scene.by_inputs(balance, inputs, k), dict.fromkeys(unit, still)) for k in range(jets)),
        C=scene.by_states(seen, states).applyfunc(tidy),
        Ds=tuple(scene.by_inputs(seen, inputs, k).applyfunc(tidy) for k in range(jets)),
        point={name: sp.Symbol(name).xreplace(scene.rest) for name in (*states, *inputs)},
        drift=sp.zeros(len(states), 1),
        output_values=sp.Matrix([h.xreplace(scene.rest) for h in seen]),
        coordinates=coordinates_of(prepared.reduced),
    )
    at_rest = [collected(e.xreplace(scene.rest), scene.shorthand) for e in balance]
    return _in_full(short, scene, at_rest, at)


def _abbreviated(
    scene: _Scene, inertia: sympy.Matrix, slopes: sympy.Matrix, is_place: Sequence[bool]
) -> tuple[_Scene, tuple[sympy.Matrix, sympy.Matrix]]:
    """Return the scene and its coefficients with symbols for the long ones: inertia M, damping C, stiffness K."""
    import sympy as sp

    flat, shorthand = scene.loops.interpreter.reduced.flat, dict(scene.shorthand)

    def short(matrix: sympy.Matrix, letters: Sequence[str]) -> sympy.Matrix:
        counts = [letters.count(letter) for letter in letters]

        def entry(i: int, j: int) -> sympy.Expr:
            value = collected(matrix[i, j], scene.shorthand)
            if value.count_ops() <= MOST_IN_PLACE:
                return value
            place = letters[: j + 1].count(letters[j])
            name = f"{letters[j]}_e" + (f"{i + 1}{place}" if max(counts[j], matrix.rows) > 1 else "")
            symbol = numbered(name, 1, flat)[0]
            shorthand[symbol] = value
            return symbol

        return sp.Matrix(matrix.rows, matrix.cols, entry)

    both = short(inertia, "M" * inertia.cols), short(slopes, ["K" if place else "C" for place in is_place])
    return replace(scene, shorthand=shorthand), both


def _in_full(
    short: LinearModel, scene: _Scene, balance: Sequence[sympy.Expr], numbers: Mapping[sympy.Symbol, float]
) -> LinearModel:
    """Return a model with its abbreviations inserted, and all that explains it."""
    values = dict(scene.loops.interpreter.parameters.used)
    loops = LoopsAtRest(
        closures=tuple(g.xreplace(scene.rest) for g in scene.loops.closures),
        balance=tuple(balance),
        shorthand=scene.shorthand,
        meaning=scene.meaning,
        numbers=_with_abbreviations(scene, numbers, values) if numbers else {},
        values=values,
        own_names=scene.loops.outline.own_names,
    )
    _check_balance(loops)
    A, C = (matrix.applyfunc(loops.insert) for matrix in (short.A, short.C))
    Bs, Ds = (tuple(matrix.applyfunc(loops.insert) for matrix in of) for of in (short.Bs, short.Ds))
    return replace(short, A=A, Bs=Bs, C=C, Ds=Ds, loops=loops, short=short)


def _with_abbreviations(
    scene: _Scene, numbers: Mapping[sympy.Symbol, float], values: Mapping[sympy.Symbol, float]
) -> dict[sympy.Symbol, float]:
    """Return coordinates and abbreviations as numbers."""
    import sympy as sp

    table = {s: sp.Float(v, 17) for s, v in (*values.items(), *numbers.items())}
    for symbol, value in scene.shorthand.items():
        table[symbol] = value.evalf(17, subs=table)
    return {s: float(table[s]) for s in (*numbers, *scene.shorthand)}


def _check_balance(loops: LoopsAtRest) -> None:
    """Closures and balances hold at the place in numbers: what was found in other coordinates is at rest."""
    if not loops.numbers:
        return
    for e in (*loops.closures, *loops.balance):
        terms = loops.terms(e)
        if abs(terms.sum()) > SATISFIED * np.abs(terms).sum():
            raise no_symbols("the closures of the loops do not hold at this place, or it is no state of rest")
