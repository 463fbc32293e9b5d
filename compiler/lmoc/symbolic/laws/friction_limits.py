"""The intervals in which dry friction holds a nonlinear scene at rest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from lmoc.symbolic import places
from lmoc.symbolic.equilibria import Equilibrium
from lmoc.symbolic.laws.at_point import held_forces, holds
from lmoc.symbolic.laws.modes import Lawful
from lmoc.symbolic.laws.statics import CLOSED, FRICTIONS, Array, LawChoice, StaticSystem
from lmoc.symbolic.search import dense_about_zero, reach_of, scene_size
from lmoc.symbolic.system import refuse

SAMPLES = 720  # along a coordinate that friction may hold …
DENSITY = 27.0  # … about zero
FAR = 1e3  # times as far as roots are searched: friction holds within wide limits
HALVINGS = 60  # of an interval with an edge, or a root


def is_held(scene: Lawful, choice: LawChoice) -> list[bool]:
    """Return for each law whether it is a friction that holds."""
    return [k in FRICTIONS and c == CLOSED for k, c in zip(scene.kinds, choice.closed, strict=True)]


def within_limits(
    scene: Lawful, system: StaticSystem, rest: Equilibrium, choice: LawChoice
) -> list[Equilibrium]:
    """Return an equilibrium of a mode where its laws allow it: once, never, or on intervals of its free state."""
    held = [s for s in rest.free if any(k in FRICTIONS for k, c in zip(system.kinds, choice.closed, strict=True) if c)]
    if not held:
        return [rest] if _allowed(scene, system, rest, choice, {}) else []
    if len(held) > 1:
        names = ", ".join(s.name for s in held)
        raise refuse(f"friction holds {names} anywhere within limits that depend on each other in a nonlinear scene")
    name = held[0].name
    turning = system.reduced.flat.block_at(int(system.reduced.flat.find(name)[0])).unit in ("rad", "deg")
    at = _looked_at(scene, system, rest, choice, name, turning)
    holds = [_allowed(scene, system, rest, choice, {name: y}) for y in at.tolist()]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]]).astype(int)))
    result = []
    ranges = []
    for first, last in edges.reshape(-1, 2).tolist():
        low, high = at[first], at[last - 1]
        low = low if first == 0 else _edge(scene, system, rest, choice, name, at[first - 1], low)
        high = high if last == len(at) else _edge(scene, system, rest, choice, name, at[last], high)
        ranges.append((low, high))
    if turning and len(ranges) > 1 and ranges[0][0] == -np.pi and ranges[-1][1] == np.pi:
        ranges = [*ranges[1:-1], (ranges[-1][0], ranges[0][1] + 2 * np.pi)]  # one range across half a turn
    for low, high in ranges:
        laws = replace(rest.laws, range={name: (low, high)}, member={name: 0.5 * (low + high)})
        result.append(replace(rest, laws=laws))
    return result


def _looked_at(
    scene: Lawful, system: StaticSystem, rest: Equilibrium, choice: LawChoice, name: str, turning: bool
) -> Array:
    """Return places of a free state, by rising values: a grid, and where friction that holds it carries nothing.

    However narrow an interval is, that is within it, unless the force turns back there.
    """
    far = FAR * reach_of(scene_size(system.reduced.flat, scene.prepared.values))
    share = np.linspace(-1.0, 1.0, SAMPLES + 1)
    at = np.pi * share if turning else dense_about_zero(share, far, DENSITY)

    def carried(y: float) -> Array:
        x = _point(scene, system, rest, {name: y})
        return held_forces(system.about(x), x, choice)[is_held(scene, choice)]

    signs = np.sign([carried(y) for y in at.tolist()])
    found = []
    for k, law in np.argwhere(signs[:-1] * signs[1:] < 0).tolist():
        low, high = float(at[k]), float(at[k + 1])
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if np.sign(carried(middle)[law]) == signs[k, law] else (low, middle)
        found.append(0.5 * (low + high))
    return np.unique(np.concatenate([at, found]))


def _edge(
    scene: Lawful, system: StaticSystem, rest: Equilibrium, choice: LawChoice, name: str, outside: float, inside: float
) -> float:
    """Return where a free state reaches the limit of what holds it, by bisection."""
    for _ in range(HALVINGS):
        middle = 0.5 * (outside + inside)
        if _allowed(scene, system, rest, choice, {name: middle}):
            inside = middle
        else:
            outside = middle
    return inside


def _allowed(
    scene: Lawful, system: StaticSystem, rest: Equilibrium, choice: LawChoice, free: Mapping[str, float]
) -> bool:
    """Return whether there are forces within their limits that keep a point at rest."""
    x = _point(scene, system, rest, free)
    return holds(system.about(x), x, choice)


def _point(scene: Lawful, system: StaticSystem, rest: Equilibrium, free: Mapping[str, float]) -> Array:
    """Return the states, (n,), of an equilibrium with its free ones at some values."""
    import sympy as sp

    held = {s: sp.Float(free.get(s.name, 0.0)) for s in rest.free}
    at = (sp.sympify(rest.get(name, 0)).xreplace(held) for name in system.states)
    return np.array([places.number(scene.prepared, value, set()) for value in at])
