"""Free bodies whose forces have no formulas: each force is a symbol, whose value one instant of a run gives."""

from __future__ import annotations

from collections.abc import Callable, Container
from typing import TYPE_CHECKING

import numpy as np

from lmoc.ir.flat import Kind
from lmoc.view.bodies.balance import TENSION, Balance, Force, FreeBodies, cut_bodies, weight
from lmoc.view.scene.elements import Element, Graph, Port
from lmoc.view.scene.names import Names
from lmoc.view.scene.strip import BODIES

if TYPE_CHECKING:
    import sympy

GIVEN = {"force": "f", "torque": "tau"}  # along the coordinate


class Start:
    """The start of a run, with the interface of a run of one output time.

    Parameters
    ----------
    value : of a variable, by its name
    """

    def __init__(self, value: Callable[[str], float], time: float = 0.0) -> None:
        self.time = np.array([time])
        self._value = value

    def __getitem__(self, name: str) -> np.ndarray:
        return np.array([self._value(name)])


def measured_bodies(graph: Graph, cut_out: Container[str]) -> FreeBodies:
    """Return the balances of bodies of lines and shafts with a symbol for each force.

    Parameters
    ----------
    graph : all parts of the scene
    cut_out : names of the bodies
    """
    at: dict[int, list[tuple[Element, Port]]] = {}
    for element in graph.elements:
        for port in element.ports:
            if port.domain in ("line", "shaft"):
                at.setdefault(port.node, []).append((element, port))
    bodies = cut_bodies(graph, cut_out)
    balances = tuple(_balance(together, at[together[0].ports[0].node], graph) for together in bodies)
    names, own = Names(graph), {}
    for symbol in {s.name for b in balances for f in b.forces for s in f.label.free_symbols}:
        found = graph.flat.find(symbol)
        if found is not None and len(found) == 1 and (known := names.own(int(found[0]))):
            own[symbol] = known
    return FreeBodies(balances, (), own)


def _balance(bodies: list[Element], around: list[tuple[Element, Port]], graph: Graph) -> Balance:
    import sympy as sp

    body, *others = bodies
    port = body.ports[0]
    turns = port.domain == "shaft"
    inertias: list[sympy.Expr] = []
    forces: list[Force] = []
    for element, other in around:
        if element.symbol in BODIES:
            mass = _parameter(graph, element, "J" if turns else "m")
            inertias += [] if mass is None else [mass]
            if mass is not None and not turns and graph.value(element, "g", 0.0):
                forces.append(weight(element, mass * sp.Symbol(f"{element.name}.g"), graph))
        else:
            forces.append(_force(element, other, graph))
    mass = sp.Add(*inertias)
    acceleration = sp.Symbol(f"der(der({graph.name(port)}))")
    return Balance(body, tuple(others), port, mass * acceleration, mass, tuple(forces), turns)


def _parameter(graph: Graph, element: Element, name: str) -> sympy.Expr | None:
    import sympy as sp

    return None if graph.variable(element, name) is None else sp.Symbol(f"{element.name}.{name}")


def _force(element: Element, port: Port, graph: Graph) -> Force:
    """The force of a part on the body at its port: the tension of the part where it has one."""
    import sympy as sp

    known = [(n, graph.variable(element, n)) for n in ("f", "tau", "torque")]
    named = [n for n, v in known if v is not None and graph.flat.kind[v] == Kind.UNKNOWN]
    if element.symbol in TENSION and len(element.ports) == 2 and named:
        sense = 1 if element.ports[0].name == port.name else -1
        label = sp.Symbol(f"{element.name}.{named[0]}")
        return Force(element.name, sense * label, label, sense)
    if element.symbol in GIVEN and graph.variable(element, GIVEN[element.symbol]) is not None:
        given = sp.Symbol(f"{element.name}.{GIVEN[element.symbol]}")
        return Force(element.name, given, given, 1)
    flow = sp.Symbol(graph.flat.variable_name(port.flows[0]))
    return Force(element.name, -flow, flow, -1)
