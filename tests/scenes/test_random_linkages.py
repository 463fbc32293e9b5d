"""Random scenes with large angles against Lagrange's equations evaluated by numbers.

The place of every node is carried with its gradient and Hessian in the coordinates (second-order forward
differentiation), so inertial forces come from M = Σ m p' p'ᵀ and Σ m p' (ẋᵀ p'' ẋ), and all other forces from p'.
"""

from dataclasses import dataclass, field

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles.jets import Jet
from scipy.integrate import solve_ivp

import lmoc

TIMES = np.linspace(0, 1, 6)


@dataclass
class Linkage:
    """Text for the compiler; for the oracle, how each node's place follows from older ones."""

    lines: list[str] = field(default_factory=list)
    connections: list[str] = field(default_factory=list)
    ports: list[tuple[str, str]] = field(default_factory=list)  # of each node, with "line" or "turn"
    places: list = field(default_factory=list)  # functions of the list of older places and of the coordinates
    coordinates: list[str] = field(default_factory=list)  # the bodies that carry them
    masses: list[tuple[float, int, float]] = field(default_factory=list)
    springs: list[tuple[float, int, int, float]] = field(default_factory=list)
    dampers: list[tuple[float, int, int]] = field(default_factory=list)

    def part(self, text: str) -> str:
        name = f"p{len(self.lines)}"
        self.lines.append(text.replace("@", name))
        return name

    def node(self, kind: str, port: str, place) -> int:
        self.ports.append((port, kind))
        self.places.append(place)
        return len(self.ports) - 1

    def connect(self, node: int, port: str) -> None:
        self.connections.append(f"connect({self.ports[node][0]}, {port});")

    def text(self) -> str:
        lines = [*(f"  {p};" for p in self.lines), "equation", *(f"  {c}" for c in self.connections)]
        return "\n".join(["model Linkage", *lines, "end Linkage;"])

    def at(self, x: np.ndarray) -> list[Jet]:
        places, free = [], Jet.coordinates(x)
        for place in self.places:
            places.append(place(places, free))
        return places

    def rate(self, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Accelerations of the coordinates."""
        p = self.at(x)
        M, F = np.zeros((len(x), len(x))), np.zeros(len(x))
        for m, node, g in self.masses:
            M += m * np.outer(p[node].slope, p[node].slope)
            F += m * (g - v @ p[node].bend @ v) * p[node].slope
        for k, a, b, offset in self.springs:
            F -= k * (p[b].value - p[a].value + offset) * (p[b].slope - p[a].slope)
        for c, a, b in self.dampers:
            d = p[b].slope - p[a].slope
            F -= c * (d @ v) * d
        return np.linalg.solve(M, F)


@st.composite
def linkages(draw) -> Linkage:
    s = Linkage()
    wall = s.node("line", s.part("Fixed @") + ".flange", lambda p, x: 0.0 * x[0])
    ground = s.node("turn", s.part("FixedShaft @") + ".shaft", lambda p, x: 0.0 * x[0])
    for _ in range(draw(st.integers(1, 2))):
        shaft = add_coordinate(s, draw, ground)
        for _ in range(draw(st.integers(1, 2))):
            add_transmission(s, draw, shaft)
    lines = [i for i, (_, kind) in enumerate(s.ports) if kind == "line"]
    for node in lines[1:]:
        other = draw(st.sampled_from([wall, *(i for i in lines if i < node)]))
        k, c, offset = draw(st.sampled_from([5.0, 20.0, 60.0])), draw(st.sampled_from([0.2, 1.0])), draw(OFFSET)
        name = s.part(f"SpringDamper @(k = {k}, c = {c}, L = {offset}, d0 = 0)")
        s.connect(other, f"{name}.a")
        s.connect(node, f"{name}.b")
        s.springs.append((k, other, node, offset))
        s.dampers.append((c, other, node))
    return s


LENGTH = st.sampled_from([-0.8, 0.3, 0.5, 1.0])
OFFSET = st.sampled_from([-0.2, 0.0, 0.3])


def add_coordinate(s: Linkage, draw, ground: int) -> int:
    """A rotor on a torsional spring: its angle is a coordinate."""
    J, k = draw(st.sampled_from([0.3, 1.0])), draw(st.sampled_from([2.0, 8.0]))
    name, spring = s.part(f"Inertia @(J = {J})"), s.part(f"TorsionSpring @(k = {k})")
    i = len(s.coordinates)
    s.coordinates.append(name)
    node = s.node("turn", f"{name}.shaft", lambda p, x: x[i])
    s.masses.append((J, node, 0.0))
    s.connect(ground, f"{spring}.a")
    s.connect(node, f"{spring}.b")
    s.springs.append((k, ground, node, 0.0))
    return node


def add_transmission(s: Linkage, draw, shaft: int) -> None:
    """An arm or a lever with masses at its ends, perhaps behind a gear."""
    if draw(st.booleans()):
        ratio = draw(st.sampled_from([-1.5, 0.7, 2.0]))
        name, parent = s.part(f"Gear @(N = {ratio})"), shaft
        s.connect(parent, f"{name}.a")
        shaft = s.node("turn", f"{name}.b", lambda p, x: (1 / ratio) * p[parent])
    if draw(st.booleans()):
        l = draw(LENGTH)
        name = s.part(f"Arm @(l = {l})")
        s.connect(shaft, f"{name}.shaft")
        add_mass(s, draw, s.node("line", f"{name}.flange", lambda p, x: l * p[shaft].sin()))
        return
    l1, l2 = draw(LENGTH), draw(LENGTH)
    name = s.part(f"Lever @(l1 = {l1}, l2 = {l2})")
    s.connect(shaft, f"{name}.pivot")
    add_mass(s, draw, s.node("line", f"{name}.a", lambda p, x: l1 * p[shaft].sin()))
    end = s.node("line", f"{name}.b", lambda p, x: l2 * p[shaft].sin())
    rod = s.part("Rod @(L = 0.4)")
    s.connect(end, f"{rod}.a")
    add_mass(s, draw, s.node("line", f"{rod}.b", lambda p, x: p[end] + 0.4))


def add_mass(s: Linkage, draw, node: int) -> None:
    m, g = draw(st.sampled_from([0.2, 0.5, 1.0])), draw(st.sampled_from([0.0, 9.81]))
    s.connect(node, s.part(f"Mass @(m = {m}, g = {g})") + ".flange")
    s.masses.append((m, node, g))


@settings(max_examples=8)
@given(linkages(), st.data())
def test_linkage_moves_as_lagrange_says(scene, data):
    n = len(scene.coordinates)
    x0 = np.array([data.draw(st.sampled_from([-1.2, 0.0, 0.4, 2.5])) for _ in range(n)])
    v0 = np.array([data.draw(st.sampled_from([-3.0, 0.0, 1.0])) for _ in range(n)])
    exact = solve_ivp(
        lambda t, z: np.concatenate([z[n:], scene.rate(z[:n], z[n:])]),
        (0, 1),
        np.concatenate([x0, v0]),
        method="DOP853",
        t_eval=TIMES,
        rtol=1e-10,
        atol=1e-12,
    )
    initial = {f"{body}.theta": x for body, x in zip(scene.coordinates, x0, strict=True)}
    initial |= {f"{body}.omega": v for body, v in zip(scene.coordinates, v0, strict=True)}

    dae = lmoc.compile_text(scene.text())
    assert len(dae.states) == 2 * n
    run = dae.simulate(times=TIMES, rtol=1e-9, initial=initial)
    for node, (port, kind) in enumerate(scene.ports):
        expected = np.array([scene.at(z)[node].value for z in exact.y[:n].T])
        assert np.allclose(run[port + (".q" if kind == "line" else ".theta")], expected, rtol=0, atol=1e-6)
    assert run.energy.balance < 1e-6
