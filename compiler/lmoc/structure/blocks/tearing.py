"""Tearing: few unknowns of a block are kept for the solver, the others follow from them one after the other.

A greedy heuristic after Cellier & Kofman, "Continuous System Simulation" (2006), 7.2, and Meijer, "Tearing
differential algebraic equations in an object-oriented modeling language" (2011): what no equation gives safely is
torn first, then derivatives of states (a mechanism then ends at its mass matrix), then what appears in most of the
equations. Substitution is kept shallow: along a chain it multiplies errors in each link.
"""

from __future__ import annotations

from collections.abc import Sequence

from lmoc.support.records import dataclass

DEEPEST = 6


@dataclass(frozen=True)
class Tearing:
    """The block as an order of evaluation.

    Attributes
    ----------
    torn : unknowns for the solver
    steps : pairs (equation, unknown it is solved for), in order
    residuals : the equations left for the solver, as many as `torn`
    """

    torn: tuple[int, ...]
    steps: tuple[tuple[int, int], ...]
    residuals: tuple[int, ...]


def tear(
    unknowns: Sequence[frozenset[int]],
    safe: Sequence[frozenset[int]],
    favourites: frozenset[int],
    deepest: int = DEEPEST,
) -> Tearing:
    """Order the equations of a block.

    Parameters
    ----------
    unknowns : the unknowns in each equation
    safe : those among them for which the equation can be solved whatever the state
    favourites : unknowns to tear first
    deepest : how many steps may build upon each other
    """
    users = _users(unknowns)
    missing = [set(found) for found in unknowns]
    solvable = frozenset().union(*safe)
    depth: dict[int, int] = {}
    torn: list[int] = []
    steps: list[tuple[int, int]] = []
    open_equations = set(range(len(unknowns)))

    def settle(v: int, level: int) -> None:
        depth[v] = level
        for e in users[v]:
            missing[e].discard(v)
            if len(missing[e]) == 1 and e in open_equations:
                ready.append(e)

    ready = [e for e, found in enumerate(missing) if len(found) == 1]
    while len(depth) < len(users):
        while ready:
            e = ready.pop(0)
            if e not in open_equations or len(missing[e]) != 1:
                continue
            (v,) = missing[e]
            level = 1 + max((depth[w] for w in unknowns[e] if w in depth), default=0)
            if v in safe[e] and level <= deepest:
                open_equations.discard(e)
                steps.append((e, v))
                settle(v, level)
        if len(depth) < len(users):
            rest = {v: sum(e in open_equations for e in users[v]) for v in users if v not in depth}
            torn.append(max(rest, key=lambda v: (v not in solvable, v in favourites, rest[v], -v)))
            settle(torn[-1], 0)
    return Tearing(tuple(torn), tuple(steps), tuple(sorted(open_equations)))


def _users(unknowns: Sequence[frozenset[int]]) -> dict[int, list[int]]:
    """The equations in which each unknown appears."""
    users: dict[int, list[int]] = {}
    for e, found in enumerate(unknowns):
        for v in found:
            users.setdefault(v, []).append(e)
    return users
