"""Equations of motion of closed loops: in all their coordinates, with a multiplier for each closure.

An explicit form in one angle of a four-bar fills pages. The textbook's form is short: Lagrange's equations of the first
kind, ``d/dt ∂L/∂q̇ − ∂L/∂q − Q = Σ λ·∂g/∂q`` beside the closures ``g(q) = 0``. The left sides are the virtual power for
each coordinate, as in an open tree, without the reactions where the loops are cut: the multipliers stand for these.
Along every motion that the closures allow the left sides must do no power, which is checked at a random point.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from lmoc.ir.flat import FlatDAE
from lmoc.ir.program import read
from lmoc.ir.reduced import Invariants, Reduced
from lmoc.support.records import dataclass
from lmoc.symbolic.elimination import MOST_TERMS
from lmoc.symbolic.kinematics import Kinematics
from lmoc.symbolic.local import NotLinearError, PartLaws
from lmoc.symbolic.motion import Motion, ports_of_elements, power_by_coordinate
from lmoc.symbolic.slope import slope
from lmoc.symbolic.sorting import with_few_minus_signs
from lmoc.symbolic.system import Outline, SymbolicInterpreter, jet_symbol
from lmoc.symbolic.too_long import NoSymbolsError
from lmoc.symbolic.trial import ROUNDING, Trial

if TYPE_CHECKING:
    import sympy

_ITERATIONS = 40


@dataclass(frozen=True, eq=False)
class FirstKind:
    """Equations of the first kind.

    Attributes
    ----------
    motion : with the multipliers in its residuals
    closures : vanish along the motion
    multipliers : one for each closure
    power : the residuals without the multipliers
    interpreter : of the reduction that they come from
    """

    motion: Motion
    outline: Outline
    closures: tuple[sympy.Expr, ...]
    multipliers: tuple[sympy.Symbol, ...]
    power: tuple[sympy.Expr, ...]
    interpreter: SymbolicInterpreter


def derive_first_kind(reduced: Reduced, values: np.ndarray) -> FirstKind | None:
    """Return the equations of a scene in all coordinates of its loops; None where there is no such form.

    Parameters
    ----------
    reduced : with these coordinates as states, closures on positions among its invariants
    """
    import sympy as sp

    own = reduced.invariants
    if own is None or (own.lower[1] < 0).any():
        return None
    interpreter = SymbolicInterpreter(reduced, values, MOST_TERMS, named=True)
    outline = interpreter.outline()
    ports = ports_of_elements(reduced.flat)
    try:
        closures = _closures(interpreter, own)
        kinematics = Kinematics(interpreter, outline, [p for p, _ in ports], closures)
        laws = PartLaws(reduced.flat, kinematics)
        power, reactions = power_by_coordinate(kinematics, laws, ports)
    except (NoSymbolsError, NotLinearError):
        return None
    left = [p.xreplace(dict.fromkeys(reactions, sp.S.Zero)) for p in power]
    closures, forces = _with_forces(closures, kinematics.coordinates, power, _tensions(laws))
    rows = [[slope(g, q) for q in kinematics.coordinates] for g in closures]
    place = _Place(interpreter, kinematics, closures)
    highest = [jet_symbol(q.name, n) for q, n in zip(kinematics.coordinates, kinematics.orders, strict=True)]
    inertia = [[slope(p, a) for a in highest] for p in left]
    if place.others or not _complete(left, rows, inertia, Trial(interpreter, values, place)):
        return None
    others = iter(numbered("lambda", forces.count(None), reduced.flat))
    multipliers = tuple(next(others) if force is None else force for force in forces)
    residuals = tuple(
        p - sp.Add(*(m * row[i] for m, row in zip(multipliers, rows, strict=True))) for i, p in enumerate(left)
    )
    motion = Motion(tuple(kinematics.coordinates), tuple(kinematics.orders), residuals, {}, True)
    return FirstKind(motion, outline, closures, multipliers, tuple(left), interpreter)


def numbered(letter: str, count: int, flat: FlatDAE) -> tuple[sympy.Symbol, ...]:
    """Return symbols ``lambda1, lambda2, …``, or one ``lambda``, none of which is a variable of the model."""
    import sympy as sp

    names = [f"{letter}{k + 1}" for k in range(count)] if count > 1 else [letter] * count
    if any(flat.find(name) is not None for name in names):
        return numbered(f"{letter}_", count, flat)
    return tuple(sp.Symbol(name) for name in names)


def _closures(interpreter: SymbolicInterpreter, own: Invariants) -> tuple[sympy.Expr, ...]:
    import sympy as sp

    interpreter.fill(np.unique(np.concatenate([read(step) for step in own.program])).tolist())
    interpreter.run(own.program, again=False)
    return tuple(with_few_minus_signs(sp.expand(interpreter.w[int(r)])) for r in own.lower[1])


def _tensions(laws: PartLaws) -> list[sympy.Symbol]:
    """Return the unknown forces that parts or the scene declare: tensions, and no flows of connectors."""
    return [laws.symbol(v) for v in sorted(laws.unknown) if not laws.flat.block_at(v).connector]


def _with_forces(
    closures: Sequence[sympy.Expr],
    coordinates: Sequence[sympy.Symbol],
    power: Sequence[sympy.Expr],
    tensions: Sequence[sympy.Symbol],
) -> tuple[tuple[sympy.Expr, ...], list[sympy.Symbol | None]]:
    """Return the closures, and of each the force that is its multiplier: a tension ``f`` in ``m·ẍ + f·x/L = 0``.

    One that pushes the other way has its closure with the other sign. None where no declared force is the multiplier.
    """
    kept, forces = [], []
    for g in closures:
        row = [slope(g, q) for q in coordinates]
        pushes = ((sign, f) for f in tensions for sign in (1, -1) if _is_multiplier(power, f, sign, row))
        sign, force = next(pushes, (1, None))
        kept.append(sign * g)
        forces.append(force)
    return tuple(kept), forces


def _is_multiplier(power: Sequence[sympy.Expr], force: sympy.Symbol, sign: int, row: Sequence[sympy.Expr]) -> bool:
    """Return whether a force does its power as the multiplier of a closure does."""
    import sympy as sp

    return all(sp.expand(slope(p, force) + sign * r) == 0 for p, r in zip(power, row, strict=True))


class _Place:
    """Moves states onto the closures, positions before velocities, by the shortest steps of Newton's method."""

    def __init__(
        self, interpreter: SymbolicInterpreter, kinematics: Kinematics, closures: tuple[sympy.Expr, ...]
    ) -> None:
        import sympy as sp

        self.parameters = interpreter.parameters.variable
        coordinates = [q for q, n in zip(kinematics.coordinates, kinematics.orders, strict=True) if n == 2]
        self.matrix = sp.Matrix([[slope(g, q) for q in coordinates] for g in closures])
        self.closures, self.coordinates = sp.Matrix(closures), coordinates
        self.place = [(q, v) for q, v in interpreter.outline().coordinates if v >= 0]
        symbols = set().union(*(g.free_symbols for g in closures))
        self.others = symbols - set(coordinates) - self.parameters.keys()

    def __call__(self, x: np.ndarray, values: np.ndarray) -> np.ndarray:
        import sympy as sp

        symbols = self.closures.free_symbols & self.parameters.keys()
        numbers = {s: sp.Float(float(values[self.parameters[s]]), 17) for s in symbols}
        residual, matrix = (sp.lambdify(self.coordinates, e.xreplace(numbers)) for e in (self.closures, self.matrix))
        at, rate = (np.array(part) for part in zip(*self.place, strict=True))
        x = x.copy()
        for _ in range(_ITERATIONS):
            x[at] -= np.linalg.lstsq(matrix(*x[at]), residual(*x[at])[:, 0], rcond=None)[0]
        slopes = matrix(*x[at])
        x[rate] -= np.linalg.lstsq(slopes, slopes @ x[rate], rcond=None)[0]
        return x if np.abs(residual(*x[at])).max() < ROUNDING else np.full_like(x, np.nan)


def _complete(
    left: list[sympy.Expr], rows: list[list[sympy.Expr]], inertia: list[list[sympy.Expr]], trial: Trial
) -> bool:
    """Return whether the left sides and the closures determine the motion, which agrees with the scene's.

    At a random point on the closures: the left sides do no power in the directions that these allow, and resist every
    acceleration in them. A mass that a user has written as equations is in no part: it resists nothing here.
    """
    terms = [np.array([trial.number(t) for t in p.as_ordered_terms()]) for p in left]
    matrix = np.array([[trial.number(g) for g in row] for row in rows])
    masses = np.array([[trial.number(m) for m in row] for row in inertia])
    if not all(np.isfinite(numbers).all() for numbers in (matrix, masses, *terms)):
        return False
    size = sum(float(np.abs(t).sum()) for t in terms)
    free = np.linalg.svd(matrix)[2][len(matrix) :]
    resists = np.linalg.matrix_rank(free @ masses @ free.T, ROUNDING * np.abs(masses).max(initial=0.0)) == len(free)
    return bool(resists and (np.abs(free @ [t.sum() for t in terms]) <= ROUNDING * size).all())
