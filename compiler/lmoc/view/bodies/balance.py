"""The forces on each body of a line or a shaft, as expressions, and their balance.

The law of each part gives the force at its port by the motion of its ports (`lmoc.symbolic.local`); the body feels the
opposite. A force that only a balance can give, as that of a rod or between two gears, stands as a symbol, unless the
balance of a point without mass gives it by the motion alone: a spring's force at the end of a string.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from lmoc.ir.flat import Kind
from lmoc.ir.reduced import Reduced
from lmoc.support.records import dataclass
from lmoc.symbolic.elimination import MOST_TERMS
from lmoc.symbolic.kinematics import Kinematics
from lmoc.symbolic.local import PartLaws
from lmoc.symbolic.motion import ports_of_elements
from lmoc.symbolic.names import base_of
from lmoc.symbolic.notation import Notation
from lmoc.symbolic.slope import slope
from lmoc.symbolic.system import SymbolicInterpreter
from lmoc.view.bodies.local import LocalForms
from lmoc.view.scene.elements import Element, Graph, Port
from lmoc.view.scene.levers import tips
from lmoc.view.scene.names import Names
from lmoc.view.scene.strip import BODIES

if TYPE_CHECKING:
    import sympy

TENSION = frozenset(
    """spring damper spring-damper rod string elastic-string stop friction torsion-spring torsion-damper clutch
    bearing-friction ratchet""".split()
)
MOST_OPERATIONS = 16  # in a formula beside an arrow
LEVERS = ("lever", "arm")


@dataclass(frozen=True)
class Force:
    """One force or torque on a body.

    Attributes
    ----------
    part : whose it is; the body itself for its weight
    value : along the coordinate, in jets of the scene's coordinates
    label : what stands at the arrow: the same by the body's own coordinate
    sense : 1 where the arrow points along the coordinate, -1 against it
    """

    part: str
    value: sympy.Expr
    label: sympy.Expr
    sense: int

    @property
    def term(self) -> sympy.Expr:
        """Return the term that stands in the balance."""
        return self.label * self.sense


@dataclass(frozen=True)
class Loaded:
    """A point of a lever at which forces act.

    Attributes
    ----------
    lever : the part
    arm : from the pivot, m, negative on its other side
    node : of the point
    small : the sine of the angle is taken as the angle
    forces : on the lever, along the coordinate of the point
    """

    lever: str
    arm: float
    node: int
    small: bool
    forces: tuple[Force, ...]


@dataclass(frozen=True)
class Balance:
    """A body with all forces on it: ``inertia = Σ force.value``.

    Attributes
    ----------
    body : the part
    others : what moves as one with it: bodies at the same port, declared later
    port : of the body
    inertia : mass times acceleration, in jets of the scene's coordinates
    mass : the factor of the acceleration alone
    turns : it turns
    points : where forces act on the levers that turn with it; `forces` has their torques
    """

    body: Element
    others: tuple[Element, ...]
    port: Port
    inertia: sympy.Expr
    mass: sympy.Expr
    forces: tuple[Force, ...]
    turns: bool
    points: tuple[Loaded, ...] = ()

    def groups(self) -> Iterator[tuple[int, tuple[Force, ...]]]:
        """Yield the nodes at which forces act, with the forces there: the body's own first."""
        yield self.port.node, self.forces
        yield from ((point.node, point.forces) for point in self.points)

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
        labels = [f.label for b in self.balances for _, forces in b.groups() for f in forces]
        expressions = [*(b.mass for b in self.balances), *labels]
        return Notation.of(*expressions, late=self.late, given=self.own)


def free_bodies(
    reduced: Reduced, values: np.ndarray, graph: Graph, cut_out: Container[str] | None = None
) -> FreeBodies:
    """Return the forces on bodies of lines and shafts.

    Parameters
    ----------
    graph : all parts of the scene
    cut_out : names of the bodies; None: all of them

    Raises
    ------
    ModelError
        E0660 where the scene is too large for symbols.
    """
    interpreter = SymbolicInterpreter(reduced, values, MOST_TERMS)
    outline = interpreter.outline()
    # the scene as it was written: set-valued laws leave their forces open, which then stand as symbols
    kinematics = Kinematics(interpreter, outline, [p for p, _ in ports_of_elements(graph.flat)])
    laws = _Laws(PartLaws(graph.flat, kinematics))
    forms = LocalForms(graph, Names(graph), kinematics)
    at: dict[int, list[tuple[Element, Port]]] = {}
    for element in graph.elements:
        for port in element.ports:
            if port.domain in ("line", "shaft"):
                at.setdefault(port.node, []).append((element, port))
    found = [_balance(together, at, laws, forms) for together in cut_bodies(graph, cut_out)]
    late = *(u.name for u in outline.inputs), *(q.name for q in kinematics.coordinates)
    return FreeBodies(tuple(found), late, {**_own_flows(found, graph), **outline.own_names})


def cut_bodies(graph: Graph, cut_out: Container[str] | None) -> list[list[Element]]:
    """Return the bodies of lines and shafts to cut out of a scene; those at one port are one body."""
    at: dict[int, list[Element]] = {}
    for element in graph.elements:
        if element.symbol in BODIES and element.ports[0].domain in ("line", "shaft"):
            at.setdefault(element.ports[0].node, []).append(element)
    return [own for own in at.values() if cut_out is None or any(e.name in cut_out for e in own)]


def _own_flows(balances: list[Balance], graph: Graph) -> dict[str, str]:
    """The model's own names for the forces that stand as symbols, and for the bodies' coordinates."""
    names = Names(graph)
    forces = [f for b in balances for _, forces in b.groups() for f in forces]
    symbols = {base_of(s.name)[0] for f in forces for s in f.label.free_symbols}
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
        # what stands for the argument of a law has the argument's text as its name
        self._helpers = {laws.symbol(v) for v in laws.unknown if "(" in laws.flat.block_at(v).path[-1][0]}
        elimination, unknowns, right = laws.solve_relations(balances=True, massless=True)
        self.known: dict[sympy.Symbol, sympy.Expr] = {}
        for v, combination in elimination.solution.items():
            if elimination.by_free[v]:
                continue
            value = sp.Add(*(c * right[j] for j, c in combination.items()))
            if not self._foreign(value):
                self.known[unknowns[v]] = value
        tied, _, plain = laws.solve_relations()
        self.tied: dict[sympy.Symbol, sympy.Expr] = {}
        for v, combination in tied.solution.items():
            symbol = unknowns.get(v) or laws.symbol(v)
            if symbol not in self.known:
                free = sp.Add(*(c * laws.symbol(x) for x, c in tied.by_free[v].items()))
                self.tied[symbol] = sp.Add(*(c * plain[j] for j, c in combination.items())) + free

    def flow(self, element: Element, port: Port) -> sympy.Expr:
        """The flow into a part at a port."""
        value = self.laws.value(port.flows[0])
        value = value.xreplace(self.known).xreplace(self.tied).xreplace(self.known)
        value = value.xreplace(self._declared(element, value))
        return self._by_name(element, port) if self._foreign(value) or _is_long(value) else value

    def _foreign(self, value: sympy.Expr) -> bool:
        """Return whether a symbol is no variable of the scene: the mode of a law, on which a massless point depends."""
        bases = {base_of(s.name)[0] for s in value.free_symbols} - {"time"} - {s.name for s in self._helpers}
        return any(self.laws.flat.find(name) is None for name in bases)

    def _declared(self, element: Element, value: sympy.Expr) -> dict[sympy.Symbol, sympy.Expr]:
        """A part's own variables in the place of what was made for the arguments of its laws."""
        found = {}
        for helper in value.free_symbols & self._helpers:
            for variable in self._forces(element):
                own = self.laws.value(variable).xreplace(self.tied)
                factor = slope(own, helper)
                if factor != 0 and not factor.has(helper) and own == factor * helper:
                    found[helper] = self.laws.symbol(variable) / factor
                    break
        return found

    def _forces(self, element: Element) -> list[int]:
        """The variables in which a part declares its force or torque."""
        names = (f"{element.name}.{name}" for name in ("f", "tau", "torque", "tm", "F"))
        variables = [self.laws.flat.find(name) for name in names]
        kinds = self.laws.flat.kind
        return [int(v[0]) for v in variables if v is not None and len(v) == 1 and kinds[v[0]] == Kind.UNKNOWN]

    def _by_name(self, element: Element, port: Port) -> sympy.Expr:
        """A flow as a symbol: the part's tension where it has one, or the force that it declares to be the same."""
        own = self._forces(element)
        if element.symbol in TENSION and len(element.ports) == 2 and own:
            return self.laws.symbol(own[0]) * (-1 if port.name == element.ports[0].name else 1)
        flow = self.laws.value(port.flows[0])
        for variable in own:
            declared = self.laws.value(variable)
            if flow in (declared, -declared):
                return self.laws.symbol(variable) * (1 if flow == declared else -1)
        return self.laws.symbol(port.flows[0])

    def parameter(self, graph: Graph, element: Element, name: str) -> sympy.Expr | None:
        """The expression of a part's parameter."""
        variable = graph.variable(element, name)
        return None if variable is None else self.laws.kinematics.interpreter.variable(variable)


def _is_long(value: sympy.Expr) -> bool:
    """Return whether a formula has no room at an arrow: cases, or a term of many operations."""
    import sympy as sp

    return value.has(sp.Piecewise) or any(sp.count_ops(t) > MOST_OPERATIONS for t in sp.Add.make_args(value))


def _balance(
    bodies: list[Element], at: Mapping[int, list[tuple[Element, Port]]], laws: _Laws, forms: LocalForms
) -> Balance:
    """Return the balance of bodies at one port; `at` has the ports at each node."""
    import sympy as sp

    body, *others = bodies
    port, graph = body.ports[0], forms.graph
    around = [(e, p) for e, p in at[port.node] if (e.name, p.name) != (body.name, port.name)]
    inertial, rest = _own_terms(body, port, laws, graph)
    forces = [weight(body, -t, graph) for t in rest]
    for element, other in around:
        if element.symbol in BODIES:  # two bodies at one place share what acts there
            more, rest = _own_terms(element, other, laws, graph)
            inertial += more
            forces += [weight(element, -t, graph) for t in rest]
        else:
            forces += _forces(element, other, laws, forms, port)
    mass = laws.parameter(graph, body, _inertia_name(port))
    inertia = sp.Add(*inertial)
    kinematics = laws.laws.kinematics
    acceleration = kinematics.rate(kinematics.rate(kinematics.value(port.potentials[0])))
    whole = mass is not None and (inertia == 0 or sp.expand(inertia - mass * acceleration) == 0)
    if not whole:  # several bodies, or one off the axis of its shaft
        mass = sp.cancel(inertia / acceleration) if acceleration != 0 else sp.S.Zero
    turns = port.domain == "shaft"
    levers = [(e, hinge) for e, hinge in around if turns and e.symbol in LEVERS]
    points = [p for e, hinge in levers for p in _points(e, hinge, at, laws, forms, port)]
    return Balance(body, tuple(others), port, inertia, mass, tuple(forces), turns, tuple(points))


def _inertia_name(port: Port) -> str:
    return "J" if port.domain == "shaft" else "m"


def _own_terms(body: Element, port: Port, laws: _Laws, graph: Graph) -> tuple[list[sympy.Expr], list[sympy.Expr]]:
    """The terms of a body's own flow: those of its inertia, and the others.

    Inertia is mass times acceleration. It has terms of velocities alone where the coordinate is not the scene's.
    """
    import sympy as sp

    own = sp.expand(laws.flow(body, port))
    mass = laws.parameter(graph, body, _inertia_name(port))
    if mass is not None:
        kinematics = laws.laws.kinematics
        inertia = sp.expand(mass * kinematics.rate(kinematics.rate(kinematics.value(port.potentials[0]))))
        rest = sp.expand(own - inertia)
        if not any(base_of(s.name)[1] >= 2 for s in rest.free_symbols):
            return [inertia], [t for t in sp.Add.make_args(rest) if t != 0]
    terms = [t for t in sp.Add.make_args(own) if t != 0]
    inertial = [t for t in terms if any(base_of(s.name)[1] >= 2 for s in t.free_symbols)]
    return inertial, [t for t in terms if t not in inertial]


def _points(
    lever: Element,
    hinge: Port,
    at: Mapping[int, list[tuple[Element, Port]]],
    laws: _Laws,
    forms: LocalForms,
    body: Port,
) -> list[Loaded]:
    """The forces at the ends of a lever that is held by its hinge; where a body is, their sum."""
    found = []
    small = forms.graph.value(lever, "smallAngle", 0.0) == 1
    for tip in tips(lever, forms.graph):
        own = next(p for p in lever.ports if p.node == tip.node and p.name != hinge.name)
        others = [(e, p) for e, p in at[tip.node] if e.name != lever.name]
        if any(e.symbol in BODIES for e, _ in others):
            value = forms.written(laws.flow(lever, own), lever, body)
            forces = [Force(lever.name, value, *_positive(value))]
        else:
            forces = [f for e, p in others for f in _forces(e, p, laws, forms, body)]
        found.append(Loaded(lever.name, tip.length, tip.node, small, tuple(forces)))
    return found


def _forces(element: Element, port: Port, laws: _Laws, forms: LocalForms, body: Port) -> list[Force]:
    """The forces of a part on the body at one of its ports, term by term."""
    import sympy as sp

    on_body = -laws.flow(element, port)
    pulls = element.symbol in TENSION and len(element.ports) == 2
    sense = 1 if element.ports[0].name == port.name else -1
    sense = -sense if element.symbol == "stop" else sense  # it pushes
    found = []
    for value in sp.Add.make_args(on_body):
        if value != 0:
            label = forms.written(value, element, body)
            found.append(Force(element.name, value, *((label * sense, sense) if pulls else _positive(label))))
    return found


def weight(body: Element, value: sympy.Expr, graph: Graph) -> Force:
    """A term of a body that is no inertia, as its weight: the arrow points to where it pulls with the values given.

    A negative number for `g` is shown itself: the letter would hide its sign.
    """
    import sympy as sp

    found = {s: graph.flat.find(s.name) for s in value.free_symbols}
    if not all(v is not None and graph.flat.kind[v[0]] <= Kind.PARAMETER for v in found.values()):
        return Force(body.name, value, *_positive(value))
    sense = -1 if value.subs({s: graph.values[v[0]] for s, v in found.items() if v is not None}) < 0 else 1
    acceleration, size = sp.Symbol(f"{body.name}.g"), graph.value(body, "g")
    label = value.subs(acceleration, sp.Float(size, 15)) if size < 0 else value
    return Force(body.name, value, label * sense, sense)


def _positive(value: sympy.Expr) -> tuple[sympy.Expr, int]:
    """An expression without a minus before it, and its sign."""
    return (-value, -1) if value.as_coeff_Mul()[0] < 0 else (value, 1)
