"""Remarks on a run that speak of its mechanics: what cannot move, springs far from relaxed, a scene at rest."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from lmoc.ir.flat import Block, FlatDAE
from lmoc.ir.reduced import Reduced
from lmoc.messages.diagnostics import Diagnostic
from lmoc.structure.messages.holding import bodies, held_bodies

if TYPE_CHECKING:
    from lmoc.numerics.observe.trajectory import Trajectory

_SPRINGS = {"spring", "spring-damper", "torsion-spring"}
# excess: its unit, from which amount on it is told, what it is called
_FAR = {
    "extension": (1.0, "m", "stretched", "compressed"), "length": (1.0, "m", "stretched", "compressed"),
    "twist": (2 * np.pi, "rad", "twisted", "twisted back"),
}  # fmt: skip
_SHOWN = 3


def remarks(reduced: Reduced, trajectory: Trajectory, complete: bool) -> list[Diagnostic]:
    """Return notes on what a run shows of its scene.

    Parameters
    ----------
    reduced : the scene before anything is closed or stuck
    complete : whether the run has come to its end
    """
    free = reduced.flat.closed is None or not reduced.flat.closed.any()
    held = held_bodies(reduced) if free else []
    return [*held, *_strained(trajectory), *(_at_rest(trajectory) if complete and not held else [])]


def _strained(trajectory: Trajectory) -> list[Diagnostic]:
    """A note on each spring that is far from relaxed at the start (N0561), if the start is among the output times."""
    first = next((p for p in trajectory.segments if len(p.time)), None)
    if first is None or first.time[0] != trajectory.segments[0].begin or trajectory.kept is not None:
        return []

    def at_start(variables: np.ndarray) -> np.ndarray:
        return first.observer(variables, first.time[:1], first.table[:1])[0]

    flat, found = trajectory.flat, []
    for excess, force, free in _springs(flat):
        variables = np.arange(excess.offset, excess.offset + excess.size)
        least, unit, more, less = _FAR[excess.path[-1][0]]
        values, frees = at_start(variables), at_start(np.arange(free.offset, free.offset + free.size))
        if excess.path[-1][0] == "length":  # of a spring of the plane, where one without a free length is meant to pull
            values = np.where(frees > 0, values - frees, 0.0)
        for k in np.flatnonzero(np.abs(values) > least)[:_SHOWN].tolist():
            name = excess.name(k).rpartition(".")[0]
            pull = abs(float(at_start(np.array([force.offset + k]))[0]))
            length = float(frees[k])
            amount = f"{abs(values[k]):.4g} {unit}"
            message = f"{name} is {more if values[k] > 0 else less} by {amount} at the start"
            if unit == "m":
                message += f": it is relaxed at {length:.4g} m, {_apart(float(values[k] + length))}"
            hint = f"that gives {pull:.4g} {force.unit}; start values or {free.path[-1][0]} change it"
            found.append(Diagnostic("N0561", message, flat.declared_at(excess.offset), hint=hint))
    return found[:_SHOWN]


def _apart(distance: float) -> str:
    return f"its ends are {distance:.4g} m apart" if distance >= 0 else f"its end b lies {-distance:.4g} m before a"


def _springs(flat: FlatDAE) -> Iterator[tuple[Block, Block, Block]]:
    """Of each spring its length, or excess over the relaxed length or angle; its force; the relaxed length or angle."""
    springs = {k for k, part in enumerate(flat.parts) if part.look.symbol in _SPRINGS}
    own: dict[int, dict[str, Block]] = {}
    for block in flat.blocks if springs else ():
        if block.part in springs and block.size and len(block.path) == len(flat.parts[block.part].path) + 1:
            own.setdefault(block.part, {})[block.path[-1][0]] = block
    for blocks in own.values():
        for excess, force, free in (("extension", "f", "d0"), ("length", "f", "d0"), ("twist", "tau", "theta0")):
            if excess in blocks and force in blocks and free in blocks:
                yield blocks[excess], blocks[force], blocks[free]


def _at_rest(trajectory: Trajectory) -> list[Diagnostic]:
    """A note that nothing has moved (N0562): neither a state nor, where there is none, a body."""
    pieces = trajectory.segments
    if len(trajectory.time) < 2 or len(pieces) > 1 or trajectory.events or trajectory.kept is not None:
        return []
    if trajectory.states.size and np.any(trajectory.states != trajectory.states[0]):
        return []
    variables = np.concatenate([np.concatenate(v) for _, v in bodies(trajectory.flat)] or [np.zeros(0, int)])
    if not len(variables) or np.any(trajectory.of(variables) != trajectory.of(variables)[0]):
        return []
    hint = "a start value, q(start = 0.1, fixed = true), a force or a motion sets it going"
    message = "nothing moves: the scene is at rest at the start, and no force changes that"
    return [Diagnostic("N0562", message, hint=hint)]
