"""What cannot move, and what holds it: a mass that is connected to a wall. For messages only."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from lmoc.ir.flat import FlatDAE, Part
from lmoc.ir.program import written
from lmoc.ir.reduced import Reduced
from lmoc.messages.diagnostics import Diagnostic
from lmoc.messages.source import Span
from lmoc.structure.messages.equations import SHOWN, Equations, listed

# the coordinates of a body, by its symbol in pictures
COORDINATES = {
    "mass": ("q",), "inertia": ("theta",), "disk": ("theta",), "turning-bar": ("theta",), "particle": ("x", "y"),
    "body": ("x", "y", "theta"), "bar": ("x", "y", "theta"),
}  # fmt: skip
_MOST = 20_000  # equations: in larger scenes nobody looks for a way


def bodies(flat: FlatDAE) -> Iterator[tuple[Part, list[np.ndarray]]]:
    """Yield each part that is a body, with the variables (elements,) of each of its coordinates."""
    wanted = {k: COORDINATES[p.look.symbol] for k, p in enumerate(flat.parts) if p.look.symbol in COORDINATES}
    found: dict[int, list[np.ndarray]] = {}
    for block in flat.blocks if wanted else ():
        names = wanted.get(block.part, ())
        if block.path[-1][0] in names and len(block.path) == len(flat.parts[block.part].path) + 1:
            found.setdefault(block.part, []).append(np.arange(block.offset, block.offset + block.size))
    for k, variables in found.items():
        if len(variables) == len(wanted[k]):
            yield flat.parts[k], variables


def held_bodies(reduced: Reduced) -> list[Diagnostic]:
    """Return a note on each body that the parameters alone place (N0424), with what holds it."""
    flat, constant = reduced.flat, _constant(reduced)
    held = [
        np.stack(variables, axis=1)[fixed]
        for _, variables in bodies(flat)
        if (fixed := constant[np.stack(variables, axis=1)].all(axis=1)).any()
    ]
    if not held:
        return []
    rows = np.concatenate([rows[:, 0] for rows in held]).tolist()
    ways = Ways(flat)
    return [ways.note(variable) for variable in rows[:SHOWN]]


def holder(flat: FlatDAE, variable: int) -> str:
    """Return in words what holds a body, one of whose coordinates or velocities is given; empty where nothing does."""
    part = flat.block_at(variable).part
    own = next((v for p, v in bodies(flat) if p is flat.parts[part]), [])
    if not own:
        return ""
    element, ways = variable - flat.block_at(variable).offset, Ways(flat)
    return next(filter(None, (ways.said(int(v[element])) for v in own if element < len(v))), "")


def _constant(reduced: Reduced) -> np.ndarray:
    """(variables,) mask of those that follow from parameters."""
    registers = np.zeros(max(int(reduced.register_of.max(initial=-1)), int(reduced.known[0].max(initial=-1))) + 2, bool)
    registers[reduced.known[0]] = True
    for step in reduced.parameter_program:
        out = written(step)
        registers[out[out < len(registers) - 1]] = True
    result: np.ndarray = registers[reduced.register_of]  # -1, nowhere computed, is the last one
    return result


class Ways:
    """Ways from a position to something that does not move, along equations of two positions each."""

    def __init__(self, flat: FlatDAE):
        self.flat = flat
        self.equations = Equations(flat)
        self._at: dict[int, list[int]] = {}
        for number in range(self.equations.first_sum) if self.equations.first_sum <= _MOST else ():
            unknowns = self.equations.unknowns(number)
            if len(unknowns) <= 2 and not any(map(self._is_no_position, unknowns)):
                for v in unknowns:
                    self._at.setdefault(v, []).append(number)

    def _is_no_position(self, variable: int) -> bool:
        block = self.flat.block_at(variable)
        return block.flow or block.unit not in ("m", "rad", "")

    def hold(self, variable: int) -> list[int]:
        """Return the equations from a position to a place that is given; empty where no such way is found."""
        came: dict[int, tuple[int, int]] = {variable: (-1, -1)}
        queue = [variable]
        for v in queue:
            for number in self._at.get(v, ()):
                others = [w for w in self.equations.unknowns(number) if w != v]
                if not others:
                    way = [number]
                    while came[v][0] >= 0:
                        v, number = came[v]
                        way.append(number)
                    return way[::-1]
                if others[0] not in came:
                    came[others[0]] = (v, number)
                    queue.append(others[0])
        return []

    def said(self, variable: int) -> str:
        """In words what holds a position: ``connect(mass.flange, wall.flange) in line 8 ties it to wall``; or empty."""
        way = self.hold(variable)
        parts = self.equations.parts(way)
        own = self.flat.variable_name(variable).rpartition(".")[0]
        between = [p for p in parts if p != own]
        if not between:
            return ""
        through = f" through {listed(between[:-1])}" if between[:-1] else ""
        joint = next((s for n in way if (s := self._joint(n, {own, *parts}))), None)
        where = f"{joint.text} in line {joint.line} ties" if joint else "its connections tie"
        return f"{where} it to {between[-1]}{through}"

    def _joint(self, number: int, parts: set[str]) -> Span | None:
        """The place of a connect between two of the parts; None for one that has only led from one to the other."""
        group, _ = self.equations.place(number)
        span = self.flat.groups[group].span
        if self.flat.groups[group].origin != "connection" or span is None:
            return None
        named = re.findall(r"[(,]\s*([^(),]*)\.\w+\s*(?=[,)])", span.text)
        return span if len(named) == 2 and set(named) <= parts else None

    def note(self, variable: int) -> Diagnostic:
        """A note on a body that cannot move."""
        name = self.flat.variable_name(variable).rpartition(".")[0]
        said = self.said(variable)
        message = f"{name} cannot move" + (f": {said}" if said else ": its place follows from parameters alone")
        hint = "connect it by a spring, a damper or a joint if it should move"
        return Diagnostic("N0424", message, self.flat.declared_at(variable), hint=hint)
