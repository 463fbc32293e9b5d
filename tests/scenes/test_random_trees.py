"""Random trees of parts against an assembly by hand.

The compiler sees components and connections, the oracle (`lagrange`) sees numbers. They share no line of code.
"""

from dataclasses import dataclass, field

import numpy as np
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from oracles.lagrange import Assembly, split, state_counts, trajectory, well_posed

import lmoc
from lmoc.ir.flat import Kind
from lmoc.messages.diagnostics import Report
from lmoc.messages.source import Source
from lmoc.syntax.format import format
from lmoc.syntax.parse import parse

OMEGA = 2.0  # of all driving forces and torques
TIMES = np.linspace(0, 1, 6)


# ------------------------------------------------------------------------------------ scene


@dataclass
class Scene:
    """Parts and connections as text, and the same as numbers."""

    parts: list[str] = field(default_factory=list)
    kinds: list[str] = field(default_factory=list)  # of the nodes: "line" or "turn"
    ports: list[list[str]] = field(default_factory=list)  # the ports that meet in a node
    places: list[tuple[dict[int, float], float]] = field(default_factory=list)  # {coordinate: coefficient}, constant
    coordinates: int = 0
    springs: list[tuple[float, int, int, float]] = field(default_factory=list)  # k, a, b, offset
    dampers: list[tuple[float, int, int]] = field(default_factory=list)
    masses: list[tuple[float, int, float, str]] = field(default_factory=list)  # m, node, g, name
    drives: list[tuple[float, int]] = field(default_factory=list)  # amplitude, node

    def part(self, text: str) -> str:
        name = f"p{len(self.parts)}"
        self.parts.append(text.replace("@", name))
        return name

    def node(self, kind: str, place, port: str) -> int:
        self.kinds.append(kind)
        self.places.append(place)
        self.ports.append([port])
        return len(self.kinds) - 1

    def free(self) -> tuple[dict[int, float], float]:
        self.coordinates += 1
        return {self.coordinates - 1: 1.0}, 0.0

    def text(self) -> str:
        lines = [f"  {p};" for p in self.parts] + ["equation"]
        lines += [f"  connect({ports[0]}, {other});" for ports in self.ports for other in ports[1:]]
        return "\n".join(["model Tree", *lines, "end Tree;"])

    def potential(self, node: int) -> str:
        return self.ports[node][0] + (".q" if self.kinds[node] == "line" else ".theta")


def combine(*terms) -> tuple[dict[int, float], float]:
    """Σ factor·place for pairs (factor, place)."""
    row: dict[int, float] = {}
    for factor, (coefficients, _) in terms:
        for i, value in coefficients.items():
            row[i] = row.get(i, 0.0) + factor * value
    return row, sum(factor * constant for factor, (_, constant) in terms)


RATIO = st.sampled_from([-2.0, -0.75, 0.5, 0.8, 1.25, 2.0])
STIFFNESS = st.integers(2, 30).map(lambda n: 5.0 * n)
DAMPING = st.integers(1, 20).map(lambda n: 0.2 * n)
INERTIA = st.integers(2, 10).map(lambda n: 0.2 * n)
OFFSET = st.sampled_from([-0.3, 0.0, 0.1, 0.25])


@st.composite
def trees(draw) -> Scene:
    s = Scene()
    s.node("line", ({}, 0.0), s.part("Fixed @") + ".flange")
    s.node("turn", ({}, 0.0), s.part("FixedShaft @") + ".shaft")
    grow_free(s, draw, "line")
    for _ in range(draw(st.integers(1, 5))):
        grow(s, draw)
    for node in range(2, len(s.kinds)):
        if draw(st.booleans()):
            add_drive(s, node, draw(st.sampled_from([-3.0, 1.0, 4.0])))
    for _ in range(draw(st.integers(0, 2))):
        add_element(s, draw, draw(st.integers(2, len(s.kinds) - 1)))
    return s


def grow(s: Scene, draw) -> None:
    """Add a part that hangs on one node, with the nodes it brings along."""
    how = draw(st.sampled_from(["free", "rod", "gear", "drum", "arm", "lever", "pulley"]))
    if how == "free":
        return grow_free(s, draw, draw(st.sampled_from(["line", "turn"])))
    kinds = {"rod": ("line",), "gear": ("turn",), "pulley": ("line",)}.get(how, ("line", "turn"))
    parent = draw(st.sampled_from([i for i, kind in enumerate(s.kinds) if kind in kinds]))
    before = len(s.kinds)
    TRANSMISSIONS[how](s, draw, parent)
    for node in range(before, len(s.kinds)):
        if draw(st.booleans()):
            add_mass(s, draw, node)


def grow_free(s: Scene, draw, kind: str) -> None:
    """A node that moves by itself, with or without a mass, tied to an older one by a spring or a damper."""
    older = draw(st.sampled_from([i for i, other in enumerate(s.kinds) if other == kind]))
    prefix = "" if kind == "line" else "Torsion"
    if draw(st.integers(0, 3)):
        k = draw(STIFFNESS)
        name = s.part(f"{prefix}Spring @(k = {k})")
        s.springs.append((k, older, len(s.kinds), 0.0))
    else:
        c = draw(DAMPING)
        name = s.part(f"{prefix}Damper @(c = {c})")
        s.dampers.append((c, older, len(s.kinds)))
    s.ports[older].append(f"{name}.a")
    node = s.node(kind, s.free(), f"{name}.b")
    if draw(st.integers(0, 3)):
        add_mass(s, draw, node)
    elif draw(st.booleans()):
        add_element(s, draw, node)


def rod(s: Scene, draw, parent: int) -> None:
    length = draw(OFFSET)
    name = s.part(f"Rod @(L = {length})")
    here, there, sign = draw(st.sampled_from([("a", "b", 1), ("b", "a", -1)]))
    s.ports[parent].append(f"{name}.{here}")
    row, constant = s.places[parent]
    s.node("line", (row, constant + sign * length), f"{name}.{there}")


def gear(s: Scene, draw, parent: int) -> None:
    ratio = draw(RATIO)
    name = s.part(f"Gear @(N = {ratio})")
    here, there, factor = draw(st.sampled_from([("a", "b", 1 / ratio), ("b", "a", ratio)]))
    s.ports[parent].append(f"{name}.{here}")
    s.node("turn", combine((factor, s.places[parent])), f"{name}.{there}")


def drum(s: Scene, draw, parent: int, text: str = "Drum @(r = {})") -> None:
    r = draw(RATIO)
    name = s.part(text.format(r))
    turns = s.kinds[parent] == "turn"
    s.ports[parent].append(f"{name}.{'shaft' if turns else 'flange'}")
    other = ("line", combine((r, s.places[parent])), f"{name}.flange")
    s.node(*(other if turns else ("turn", combine((1 / r, s.places[parent])), f"{name}.shaft")))


def arm(s: Scene, draw, parent: int) -> None:
    drum(s, draw, parent, "Arm @(l = {}, smallAngle = true)")


def lever(s: Scene, draw, parent: int) -> None:
    l1, l2 = draw(RATIO), draw(RATIO)
    name = s.part(f"Lever @(l1 = {l1}, l2 = {l2}, smallAngle = true)")
    here = "pivot" if s.kinds[parent] == "turn" else draw(st.sampled_from(["a", "b"]))
    angle = combine(({"pivot": 1.0, "a": 1 / l1, "b": 1 / l2}[here], s.places[parent]))
    s.ports[parent].append(f"{name}.{here}")
    for port, kind, factor in (("pivot", "turn", 1.0), ("a", "line", l1), ("b", "line", l2)):
        if port != here:
            s.node(kind, combine((factor, angle)), f"{name}.{port}")


def pulley(s: Scene, draw, parent: int) -> None:
    name = s.part("Pulley @")
    here = draw(st.sampled_from(["axle", "a"]))
    s.ports[parent].append(f"{name}.{here}")
    loose = s.node("line", s.free(), f"{name}.{'a' if here == 'axle' else 'axle'}")
    axle, end = (parent, loose) if here == "axle" else (loose, parent)
    s.node("line", combine((2.0, s.places[axle]), (-1.0, s.places[end])), f"{name}.b")
    add_mass(s, draw, loose)


TRANSMISSIONS = {"rod": rod, "gear": gear, "drum": drum, "arm": arm, "lever": lever, "pulley": pulley}


def add_mass(s: Scene, draw, node: int) -> None:
    m = draw(INERTIA)
    if s.kinds[node] == "line":
        g = draw(st.sampled_from([0.0, 9.81]))
        name = s.part(f"Mass @(m = {m}, g = {g})")
        s.ports[node].append(f"{name}.flange")
    else:
        g, name = 0.0, s.part(f"Inertia @(J = {m})")
        s.ports[node].append(f"{name}.shaft")
    s.masses.append((m, node, g, name))


def add_element(s: Scene, draw, node: int) -> None:
    """A spring, a damper or both between the node and any other of its kind."""
    line = s.kinds[node] == "line"
    other = draw(st.sampled_from([i for i, kind in enumerate(s.kinds) if kind == s.kinds[node] and i != node]))
    what = draw(st.sampled_from(["spring", "damper", "both"] if line else ["spring", "damper"]))
    k, c, offset = draw(STIFFNESS), draw(DAMPING), draw(OFFSET)
    free = f"L = 0.5, d0 = {0.5 - offset}"
    if what == "spring":
        text = f"Spring @(k = {k}, {free})" if line else f"TorsionSpring @(k = {k}, theta0 = {-offset})"
    elif what == "damper":
        text = f"Damper @(c = {c})" if line else f"TorsionDamper @(c = {c})"
    else:
        text = f"SpringDamper @(k = {k}, c = {c}, {free})"
    name = s.part(text)
    s.ports[other].append(f"{name}.a")
    s.ports[node].append(f"{name}.b")
    if what != "damper":
        s.springs.append((k, other, node, offset))
    if what != "spring":
        s.dampers.append((c, other, node))


def add_drive(s: Scene, node: int, amplitude: float) -> None:
    signal = f"{amplitude}*sin({OMEGA}*time)"
    if s.kinds[node] == "line":
        s.ports[node].append(s.part(f"Force @(f = {signal})") + ".flange")
    else:
        s.ports[node].append(s.part(f"Torque @(tau = {signal})") + ".shaft")
    s.drives.append((amplitude, node))


# ----------------------------------------------------------------------------------- oracle


def assemble(s: Scene) -> tuple[Assembly, np.ndarray, np.ndarray]:
    """The assembly, and P, p: the places of the nodes are P x + p."""
    P, p = np.zeros((len(s.kinds), s.coordinates)), np.array([constant for _, constant in s.places])
    for i, (row, _) in enumerate(s.places):
        P[i, list(row)] = list(row.values())
    a = Assembly(s.coordinates, OMEGA)
    for m, node, g, _ in s.masses:
        a.mass(m, P[node], g)
    for k, left, right, offset in s.springs:
        a.spring(k, P[right] - P[left], p[right] - p[left] + offset)
    for c, left, right in s.dampers:
        a.damper(c, P[right] - P[left])
    for amplitude, node in s.drives:
        a.drive(amplitude, P[node])
    return a, P, p


# ------------------------------------------------------------------------------------- test


def start_of(s: Scene, P: np.ndarray, p: np.ndarray, R: np.ndarray, draw) -> tuple[dict[str, float], np.ndarray]:
    """Start values for as many masses as have independent coordinates, and the velocity they give along R."""
    chosen: list[int] = []
    for i, (_, node, _, _) in enumerate(s.masses):
        rows = P[[s.masses[j][1] for j in chosen] + [node]] @ R
        if np.linalg.matrix_rank(rows, tol=1e-8) > len(chosen):
            chosen.append(i)
    initial, rates = {}, []
    for i in chosen:
        _, node, _, name = s.masses[i]
        position, rate = ("q", "v") if s.kinds[node] == "line" else ("theta", "omega")
        initial[f"{name}.{position}"] = draw(st.sampled_from([-0.2, 0.0, 0.1])) + p[node]
        rates.append(draw(st.sampled_from([-1.0, 0.0, 0.5])))
        initial[f"{name}.{rate}"] = rates[-1]
    if not chosen:
        return initial, np.zeros(s.coordinates)
    rows = P[[s.masses[i][1] for i in chosen]] @ R
    return initial, R @ np.linalg.solve(rows, rates)


@settings(max_examples=12, suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow])
@given(trees(), st.data())
def test_compiled_tree_moves_as_assembled_by_hand(scene, data):
    assembly, P, p = assemble(scene)
    bases = split(assembly)
    assume(well_posed(assembly, bases))
    initial, v0 = start_of(scene, P, p, bases.R, data.draw)

    dae = lmoc.compile_text(scene.text())
    fewest, most = state_counts(assembly)
    assert fewest <= len(dae.states) <= most

    # CVODE, since DOP853 is less accurate between its steps, where a fast decay (a damper without mass) limits them
    run = dae.simulate(times=TIMES, rtol=1e-10, atol=1e-13, solver="cvode", initial=initial)
    places = np.array([run[scene.potential(i)] for i in range(len(scene.kinds))]).T
    for name, value in initial.items():
        assert abs(run[name][0] - value) < 1e-9
    x0 = np.linalg.lstsq(P, places[0] - p, rcond=None)[0]
    expected = trajectory(assembly, TIMES, x0, v0) @ P.T + p
    assert np.allclose(places, expected, rtol=0, atol=1e-6 * max(1.0, np.abs(expected).max()))
    # the ledger is integrated as finely as what is stored asks for: more than what moves, where a spring is preloaded
    ledger = run.energy
    assert np.abs(ledger.residual).max() <= 1e-6 * max(ledger.scale, 0.1 * np.abs(ledger.stored).max())


def flat_equations(text: str) -> tuple[list[str], list[str]]:
    """Names of all variables and all equations of the flat model, as text."""
    flat = lmoc.compile_text(text).flat
    rows = [flat.row_text(group, i) for group in flat.groups for i in range(group.rows)]
    return list(flat.names()), rows + [flat.sum_text(i) for i in range(flat.sums.rows)]


@settings(max_examples=6, suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow])
@given(trees())
def test_printed_tree_flattens_to_the_same_equations(scene):
    assembly, _, _ = assemble(scene)
    assume(well_posed(assembly, split(assembly)))
    report = Report()
    printed = format(parse(Source("tree.lmo", scene.text()), report))
    assert not report.diagnostics
    assert format(parse(Source("tree.lmo", printed), report)) == printed
    assert flat_equations(printed) == flat_equations(scene.text())


@settings(max_examples=6, suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow])
@given(trees())
def test_flat_model_has_as_many_equations_as_unknowns(scene):
    assembly, _, _ = assemble(scene)
    assume(well_posed(assembly, split(assembly)))
    flat = lmoc.compile_text(scene.text()).flat
    assert flat.equation_count == np.count_nonzero(flat.kind == Kind.UNKNOWN)
