"""From a scene to its free-body diagrams, with the forces of a run at some instant where one is given."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

import numpy as np

from lmoc.ir.prepared import Prepared
from lmoc.messages.diagnostics import Diagnostic, ModelError
from lmoc.symbolic.too_long import NotDerivableError
from lmoc.view.bodies.balance import Balance, Force, FreeBodies, free_bodies
from lmoc.view.bodies.diagram import WIDTH, Numbers, draw_bodies
from lmoc.view.bodies.measured import Start, measured_bodies
from lmoc.view.bodies.plane import bodies_of, draw_plane_bodies
from lmoc.view.scene.abbreviate import shown, whole
from lmoc.view.scene.arrange import strips_of
from lmoc.view.scene.block import packed
from lmoc.view.scene.compose import finished, world_gravity
from lmoc.view.scene.elements import Graph
from lmoc.view.scene.names import Names
from lmoc.view.scene.picture import Picture
from lmoc.view.scene.planar import is_planar
from lmoc.view.scene.schematic import gravity_of, style_of
from lmoc.view.scene.strip import BODIES, DOWN, RIGHT, UP, Direction

if TYPE_CHECKING:
    import sympy

ROUNDING = 1e-12  # of the largest force


class Trajectory(Protocol):
    """The part of a run that is needed."""

    @property
    def time(self) -> np.ndarray:
        """(times,) the output times, s."""
        ...

    def __getitem__(self, name: str) -> np.ndarray:
        """The values of a variable at the output times."""
        ...


def free_body_picture(
    prepared: Prepared,
    run: Trajectory | None = None,
    time: float | None = None,
    start: Callable[[], Callable[[str], float]] | None = None,
) -> Picture:
    """Return the free-body diagrams of a scene.

    Parameters
    ----------
    start : returns what gives the value of a variable at the start; called for bodies of the plane without a run
    run : for arrows to scale; without one, where the forces have no formulas, they are those at the start
    time : s, taken at the nearest output time of the run; by default its last

    Raises
    ------
    ModelError
        E0660 where there are too many parts, or no bodies.
    """
    flat, values = prepared.flat, prepared.values
    graph = shown(flat, values).graph
    on_lines = [e for e in graph.elements if e.symbol in BODIES and not is_planar(e)] if graph is not None else []
    in_plane = bodies_of(graph) if graph is not None else []
    if not on_lines and not in_plane:
        why = "too many parts" if graph is None else "no bodies"
        raise ModelError([Diagnostic("E0660", f"{flat.name} has {why} for free-body diagrams")])
    title = flat.description or flat.name
    at = -1
    if run is not None:
        at = len(run.time) - 1 if time is None else int(np.argmin(np.abs(run.time - time)))
        title = f"{title}: forces at t = {run.time[at]:g} s"
    blocks = []
    notes: tuple[str, ...] = ()
    if on_lines:
        all_parts = whole(flat, values)
        cut_out = {e.name for e in on_lines}
        try:
            found = free_bodies(prepared.reduced, values, all_parts, cut_out)
        except NotDerivableError as error:
            if start is None and run is None:
                raise
            found = measured_bodies(all_parts, cut_out)
            notes = (f"forces in numbers, for there are no formulas: {error.diagnostics[0].message}",)
            if run is None:
                run, title = Start(start()), f"{title}: forces at the start"
        numbers = None if run is None else _numbers(found, prepared, all_parts, run, at)
        blocks.append(draw_bodies(found, style_of(all_parts, Names(all_parts)), _directions(all_parts), numbers))
    if in_plane:
        value = _at(run, at) if run is not None else start()
        blocks.append(draw_plane_bodies(graph, value, world_gravity(graph), run is not None))
    return finished(packed(blocks, WIDTH, 40.0), title, notes)


def _at(run: Trajectory, at: int) -> Callable[[str], float]:
    """Return a function from the name of a variable to its value at one output time."""
    return lambda name: float(run[name][at])


def _directions(graph: Graph) -> dict[int, Direction]:
    """The direction of each node's coordinate, as in the picture of the scene."""
    found: dict[int, Direction] = {}
    for strip in strips_of(graph.elements, "line"):
        gravity = gravity_of(strip, graph)
        found |= dict.fromkeys(strip.nodes, RIGHT if not gravity else DOWN if gravity > 0 else UP)
    return found


def _numbers(bodies: FreeBodies, prepared: Prepared, graph: Graph, run: Trajectory, at: int) -> Numbers:
    """All forces at one output time."""
    value = _Values(prepared, graph, run, at)
    table: dict[int, float] = {}  # by identity of the force
    turning: set[int] = set()
    for balance in bodies.balances:
        for node, forces in balance.groups():
            for part in dict.fromkeys(f.part for f in forces):
                own = [f for f in forces if f.part == part]
                table |= {id(f): v for f, v in zip(own, value.forces(balance, node, own))}
        turning |= {id(f) for f in balance.forces if balance.turns}

    def largest(turns: bool) -> float:
        sizes = [abs(v) for key, v in table.items() if (key in turning) == turns]
        return max((s for s in sizes if np.isfinite(s)), default=0.0)

    force, torque = largest(False), largest(True)

    def of(balance: Balance, f: Force) -> float:
        value = table[id(f)]
        return 0.0 if abs(value) < ROUNDING * (torque if id(f) in turning else force) else value

    def angle(balance: Balance) -> float:
        return float(run[graph.name(balance.port)][at])

    return Numbers(of, force, torque, angle)


class _Values:
    """Values of expressions at one output time of a run."""

    def __init__(self, prepared: Prepared, graph: Graph, run: Trajectory, at: int) -> None:
        self.prepared, self.graph, self.run, self.at = prepared, graph, run, at

    def forces(self, balance: Balance, node: int, forces: list[Force]) -> list[float]:
        """The forces of one part at a node; one not known by itself is what the others leave of the whole."""
        known = [self._of(f.label) for f in forces]
        missing = [k for k, v in enumerate(known) if v is None]
        total = self._total(balance, node, forces[0].part) if len(missing) == 1 else None
        if total is not None:
            rest = sum(f.sense * v for f, v in zip(forces, known) if v is not None)
            known[missing[0]] = (total - rest) * forces[missing[0]].sense
        return [float("nan") if v is None else v for v in known]

    def _total(self, balance: Balance, node: int, part: str) -> float | None:
        """The force of a part on a body, or on a lever of it, as the run has it."""
        flat = self.prepared.flat
        if part in {p.lever for p in balance.points if p.node == node}:
            return None  # it is on the lever itself
        for element in self.graph.elements:
            for port in element.ports:
                if element.name == part and port.node == node and element not in (balance.body, *balance.others):
                    return -float(self.run[flat.variable_name(port.flows[0])][self.at])
        return None

    def _of(self, expression: sympy.Expr) -> float | None:
        numbers = {}
        for symbol in expression.free_symbols:
            value = self._symbol(symbol.name)
            if value is None:
                return None
            numbers[symbol] = value
        return float(expression.evalf(subs=numbers))

    def _symbol(self, name: str) -> float | None:
        if name == "time":
            return float(self.run.time[self.at])
        variables = self.prepared.flat.find(name)
        if variables is not None and self.prepared.flat.kind[variables[0]] <= 1:
            return float(self.prepared.values[variables[0]])
        try:
            return float(self.run[name][self.at])
        except KeyError:  # the derivative of an input
            return None

