"""The forces on each body of a line or a shaft, as expressions, and their balance.

The law of each part gives the force at its port by the motion of its ports (`lmoc.symbolic.local`); the body feels the
opposite. A force that only a balance can give, as that of a rod or between two gears, stands as a symbol, unless the
balance of a point without mass gives it by the motion alone: a spring's force at the end of a string.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lmoc.ir.reduced import Reduced
from lmoc.symbolic.elimination import MOST_TERMS
from lmoc.symbolic.kinematics import Kinematics
from lmoc.symbolic.local import PartLaws
from lmoc.symbolic.motion import ports_of_elements
from lmoc.symbolic.names import base_of
from lmoc.symbolic.notation import Notation
from lmoc.symbolic.slope import slope
from lmoc.symbolic.system import Interpreter
from lmoc.view.scene.elements import Element, Graph, Port
from lmoc.view.scene.names import Names
from lmoc.view.scene.strip import BODIES

if TYPE_CHECKING:
    import sympy

TENSION = frozenset(
    """spring damper spring-damper rod string elastic-string stop friction torsion-spring torsion-damper clutch
    bearing-friction ratchet""".split()
)


@dataclass(frozen=True)
class Force:
    """One force or torque on a body.

    Attributes
    ----------
    part : whose it is; the body itself for its weight
    label : what stands at the arrow
    sense : 1 where the arrow points along the coordinate, -1 against it
    """

    part: str
    label: sympy.Expr
    sense: int

    @property
    def value(self) -> sympy.Expr:
        """The force along the coordinate."""
        return self.label * self.sense


@dataclass(frozen=True)
class Balance:
    """A body with all forces on it: ``inertia = Σ force.value``.

    Attributes
    ----------
    body : the part
    port : of the body
    inertia : mass times acceleration, in jets of the scene's coordinates
    mass : the factor of the acceleration alone
    turns : it turns
    """

    body: Element
    port: Port
    inertia: sympy.Expr
    mass: sympy.Expr
    forces: tuple[Force, ...]
    turns: bool

    @property
    def residual(self) -> sympy.Expr:
        """Vanishes on every motion."""
        import sympy as sp

        return self.inertia - sp.Add(*(f.value for f in self.forces))


@dataclass(frozen=True)
class FreeBodies:
    """The balances of all bodies of lines and shafts, in the order of their declaration.

    Attributes
    ----------
    late : inputs and coordinates, which stand last in a product
    own : {variable: the model's own name for it}
    """

    balances: tuple[Balance, ...]
    late: tuple[str, ...]
    own: dict[str, str]

    def notation(self) -> Notation:
        """Return the names of everything that occurs."""
        expressions = [e for b in self.balances for e in (b.mass, *(f.label for f in b.forces))]
        return Notation.of(*expressions, late=self.late, given=self.own)


def free_bodies(reduced: Reduced, values: np.ndarray, graph: Graph) -> FreeBodies:
    """Return the forces on all bodies of lines and shafts.

    Raises
    ------
    ModelError
        E0660 where the scene is too large for symbols.
    """
    interpreter = Interpreter(reduced, values, MOST_TERMS)
    outline = interpreter.outline()
    kinematics = Kinematics(interpreter, outline, [p for p, _ in ports_of_elements(reduced.flat)])
    laws = _Laws(PartLaws(reduced.flat, kinematics))
    at: dict[int, list[tuple[Element, Port]]] = {}
    for element in graph.elements:
        for port in element.ports:
            if port.domain in ("line", "shaft"):
                at.setdefault(port.node, []).append((element, port))
    found = []
    for element in graph.elements:
        if element.symbol in BODIES and element.ports[0].domain in ("line", "shaft"):
            found.append(_balance(element, at[element.ports[0].node], laws, graph))
    late = *(u.name for u in outline.inputs), *(q.name for q in kinematics.coordinates)
    return FreeBodies(tuple(found), late, {**_own_flows(found, graph), **outline.own_names})


def _own_flows(balances: list[Balance], graph: Graph) -> dict[str, str]:
    """The model's own names for the forces that stand as symbols."""
    names = Names(graph)
    symbols = {s.name for b in balances for f in b.forces for s in f.label.free_symbols}
    found = {}
    for name in symbols:
        variables = graph.flat.find(name)
        if variables is not None and len(variables) == 1 and (own := names.own(int(variables[0]))):
            found[name] = own
    return found


class _Laws:
    """Flows of parts, unknown ones by the motion where that gives them."""

    def __init__(self, laws: PartLaws) -> None:
        import sympy as sp

        self.laws = laws
        elimination, unknowns, right = laws.solve_relations(balances=True, massless=True)
        self.known: dict[sympy.Symbol, sympy.Expr] = {}
        for v, combination in elimination.solution.items():
            if elimination.by_free[v]:
                continue
            self.known[unknowns[v]] = sp.Add(*(c * right[j] for j, c in combination.items()))
        tied, _, plain = laws.solve_relations()
        self.tied: dict[sympy.Symbol, sympy.Expr] = {}
        for v, combination in tied.solution.items():
            symbol = unknowns.get(v) or laws.symbol(v)
            if symbol not in self.known:
                free = sp.Add(*(c * laws.symbol(x) for x, c in tied.by_free[v].items()))
                self.tied[symbol] = sp.Add(*(c * plain[j] for j, c in combination.items())) + free

    def flow(self, port: Port) -> sympy.Expr:
        """The flow into a part at a port."""
        value = self.laws.value(port.flows[0])
        return value.xreplace(self.known).xreplace(self.tied).xreplace(self.known)

    def parameter(self, graph: Graph, element: Element, name: str) -> sympy.Expr | None:
        """The expression of a part's parameter."""
        variable = graph.variable(element, name)
        return None if variable is None else self.laws.kinematics.interpreter.variable(variable)


def _balance(body: Element, around: list[tuple[Element, Port]], laws: _Laws, graph: Graph) -> Balance:
    import sympy as sp

    port = body.ports[0]
    own = sp.expand(laws.flow(port))
    inertial = [t for t in sp.Add.make_args(own) if any(base_of(s.name)[1] >= 2 for s in t.free_symbols)]
    forces = [Force(body.name, *_positive(-t)) for t in sp.Add.make_args(own) if t not in inertial and t != 0]
    for element, other in around:
        if element.name == body.name and other.name == port.name:
            continue
        if element.symbol in BODIES:  # two bodies at one place share what acts there
            more = sp.expand(laws.flow(other))
            inertial += [t for t in sp.Add.make_args(more) if any(base_of(s.name)[1] >= 2 for s in t.free_symbols)]
            rest = [t for t in sp.Add.make_args(more) if t not in inertial and t != 0]
            forces += [Force(element.name, *_positive(-t)) for t in rest]
            continue
        forces += _forces(element, other, laws)
    name = "J" if port.domain == "shaft" else "m"
    mass = laws.parameter(graph, body, name)
    inertia = sp.Add(*inertial)
    if mass is None:
        mass = slope(inertia, next(iter(sorted(inertia.free_symbols, key=str))))
    return Balance(body, port, inertia, mass, tuple(forces), port.domain == "shaft")


def _forces(element: Element, port: Port, laws: _Laws) -> list[Force]:
    """The forces of a part on the body at one of its ports, term by term."""
    import sympy as sp

    on_body = -laws.flow(port)
    if element.symbol in TENSION and len(element.ports) == 2:
        first = element.ports[0].name == port.name
        tension = on_body if first else -on_body
        return [Force(element.name, t, 1 if first else -1) for t in sp.Add.make_args(tension) if t != 0]
    return [Force(element.name, *_positive(t)) for t in sp.Add.make_args(on_body) if t != 0]


def _positive(value: sympy.Expr) -> tuple[sympy.Expr, int]:
    """An expression without a minus before it, and its sign."""
    return (-value, -1) if value.as_coeff_Mul()[0] < 0 else (value, 1)
