"""Random trees of parts against Lagrange's equations by sympy.physics.mechanics.

The scene is written twice: as parts and connections for the compiler, and as kinetic energy, potential energy,
dissipation and virtual work in symbols for SymPy. Equal equations are recognized at random points with 30 digits.
"""

import random
from dataclasses import dataclass, field

import pytest
import sympy as sp
from sympy.physics.mechanics import LagrangesMethod, dynamicsymbols

import lmoc
from lmoc.symbolic.system import jet_symbol

t = dynamicsymbols._t
u = sp.Symbol("u")


@dataclass
class Scene:
    """A node is a port, what kind of motion it has, and where it is in the coordinates."""

    rng: random.Random
    parts: list[str] = field(default_factory=list)
    connections: list[str] = field(default_factory=list)
    nodes: list[tuple[str, str, sp.Expr]] = field(default_factory=list)
    coordinates: dict[str, sp.Expr] = field(default_factory=dict)  # full name: dynamicsymbol
    parameters: list[str] = field(default_factory=list)
    kinetic: sp.Expr = sp.S.Zero
    potential: sp.Expr = sp.S.Zero
    dissipation: sp.Expr = sp.S.Zero
    work: sp.Expr = sp.S.Zero  # virtual work of u per u: its gradient is the generalized force

    def parameter(self, letter: str) -> sp.Symbol:
        name = f"{letter}{len(self.parameters)}"
        self.parameters.append(name)
        return sp.Symbol(name)

    def part(self, text: str) -> str:
        name = f"p{len(self.parts)}"
        self.parts.append(text.replace("@", name))
        return name

    def join(self, port: str, node: int) -> None:
        self.connections.append(f"connect({self.nodes[node][0]}, {port});")

    def some(self, *kinds: str) -> int | None:
        found = [i for i, (_, kind, _) in enumerate(self.nodes) if kind in kinds]
        return self.rng.choice(found) if found else None

    def text(self) -> str:
        values = "".join(f"  parameter Real {p} = {1 + i / 7:.4f};\n" for i, p in enumerate(self.parameters))
        parts = "".join(f"  {p};\n" for p in self.parts)
        return (
            f"model Tree\n{values}  input Real u = 0;\n{parts}equation\n  "
            + "\n  ".join(self.connections)
            + "\nend Tree;\n"
        )


def body(s: Scene, kind: str, place: sp.Expr, node: int | None = None) -> str:
    inertia = s.parameter("m")
    s.kinetic += inertia * place.diff(t) ** 2 / 2
    if kind == "line":
        g = s.parameter("g")
        s.potential -= inertia * g * place
        prefer = (
            "" if node is not None else ", q(stateSelect = StateSelect.prefer), v(stateSelect = StateSelect.prefer)"
        )
        return s.part(f"Mass @(m = {inertia}, g = {g}{prefer})")
    prefer = (
        "" if node is not None else ", theta(stateSelect = StateSelect.prefer), omega(stateSelect = StateSelect.prefer)"
    )
    return s.part(f"Inertia @(J = {inertia}{prefer})")


def free(s: Scene) -> None:
    """A body with a coordinate of its own, on a spring."""
    kind = s.rng.choice(["line", "turn"])
    x = dynamicsymbols(f"x{len(s.coordinates)}")
    name = body(s, kind, x)
    s.coordinates[f"{name}.{'q' if kind == 'line' else 'theta'}"] = x
    s.nodes.append((f"{name}.{'flange' if kind == 'line' else 'shaft'}", kind, x))
    element(s, len(s.nodes) - 1, "spring")


def element(s: Scene, node: int, what: str) -> None:
    """A spring or a damper between a node and another of its kind."""
    _, kind, place = s.nodes[node]
    others = [i for i, (_, k, _) in enumerate(s.nodes) if k == kind and i != node]
    other = s.rng.choice(others)
    stretch = place - s.nodes[other][2]
    if what == "spring":
        k, offset = s.parameter("k"), s.parameter("d")
        s.potential += k * (stretch - offset) ** 2 / 2
        name = s.part(
            f"Spring @(k = {k}, d0 = {offset})" if kind == "line" else f"TorsionSpring @(k = {k}, theta0 = {offset})"
        )
    else:
        c = s.parameter("c")
        s.dissipation += c * stretch.diff(t) ** 2 / 2
        name = s.part(f"{'Damper' if kind == 'line' else 'TorsionDamper'} @(c = {c})")
    s.join(f"{name}.a", other)
    s.join(f"{name}.b", node)


def transmission(s: Scene) -> None:
    """An ideal part on a node, with a body at its other end."""
    how = s.rng.choice(["gear", "drum", "arm", "rod", "lever"])
    node = s.some("turn") if how != "rod" else s.some("line")
    if node is None:
        return
    place = s.nodes[node][2]
    if how == "gear":
        N = s.parameter("N")
        name = s.part(f"Gear @(N = {N})")
        s.join(f"{name}.a", node)
        ends = [(f"{name}.b", "turn", place / N)]
    elif how == "drum":
        r = s.parameter("r")
        name = s.part(f"Drum @(r = {r})")
        s.join(f"{name}.shaft", node)
        ends = [(f"{name}.flange", "line", r * place)]
    elif how == "arm":
        l = s.parameter("l")
        name = s.part(f"Arm @(l = {l})")
        s.join(f"{name}.shaft", node)
        ends = [(f"{name}.flange", "line", l * sp.sin(place))]
    elif how == "rod":
        L = s.parameter("L")
        name = s.part(f"Rod @(L = {L})")
        s.join(f"{name}.a", node)
        ends = [(f"{name}.b", "line", place + L)]
    else:
        l1, l2 = s.parameter("l"), s.parameter("l")
        name = s.part(f"Lever @(l1 = {l1}, l2 = {l2})")
        s.join(f"{name}.pivot", node)
        ends = [(f"{name}.a", "line", l1 * sp.sin(place)), (f"{name}.b", "line", l2 * sp.sin(place))]
    for port, kind, where in ends:
        s.nodes.append((port, kind, where))
        if s.rng.random() < 0.6:
            added = body(s, kind, where, node)
            s.join(f"{added}.{'flange' if kind == 'line' else 'shaft'}", len(s.nodes) - 1)


def tree(seed: int) -> Scene:
    s = Scene(random.Random(seed))
    s.nodes = [
        (s.part("Fixed @") + ".flange", "line", sp.S.Zero),
        (s.part("FixedShaft @") + ".shaft", "turn", sp.S.Zero),
    ]
    for _ in range(s.rng.randint(1, 3)):
        free(s)
    for _ in range(s.rng.randint(0, 3)):
        transmission(s)
    for _ in range(s.rng.randint(0, 3)):
        element(s, s.rng.randint(2, len(s.nodes) - 1), s.rng.choice(["spring", "damper"]))
    loaded = s.rng.randint(2, len(s.nodes) - 1)
    kind, place = s.nodes[loaded][1:]
    s.work += place
    name = s.part("Force @(f = u)" if kind == "line" else "Torque @(tau = u)")
    s.join(f"{name}.{'flange' if kind == 'line' else 'shaft'}", loaded)
    return s


def lagrange(s: Scene) -> dict[str, sp.Expr]:
    """{coordinate: residual} in the names of the compiler."""
    x = list(s.coordinates.values())
    equations = LagrangesMethod(s.kinetic - s.potential, x).form_lagranges_equations()
    to_jets = {}
    for name, q in s.coordinates.items():
        to_jets |= {q.diff(t, n): jet_symbol(name, n) for n in (2, 1)} | {q: jet_symbol(name, 0)}
    residuals = {}
    for (name, q), left in zip(s.coordinates.items(), equations, strict=True):
        residual = left + s.dissipation.diff(q.diff(t)) - u * s.work.diff(q)
        residuals[name] = residual.doit().subs(to_jets)
    return residuals


@pytest.mark.parametrize("seed", range(8))
def test_same_equations_as_lagrange(seed):
    scene = tree(seed)
    dae = lmoc.compile_text(scene.text())
    expected, found = lagrange(scene), {e.coordinate.name: e for e in dae.equations().equations}
    assert set(found) == set(expected)
    symbols = set().union(
        *(r.free_symbols for r in expected.values()), *(e.residual.free_symbols for e in found.values())
    )
    assert symbols <= set().union(*(r.free_symbols for r in expected.values()))
    rng = random.Random(seed)
    for name, residual in expected.items():
        highest = jet_symbol(name, 2)
        factor = None
        for _ in range(3):
            point = {s: sp.Float(rng.uniform(0.3, 1.7), 30) for s in sorted(symbols, key=str)}
            a, b = (e.xreplace(point).evalf(30) for e in (residual, found[name].residual))
            scale = (found[name].residual.diff(highest) / residual.diff(highest)).xreplace(point).evalf(30)
            assert abs(b - scale * a) < 1e-20 * (abs(a * scale) + abs(b) + 1)
            factor = scale
        assert factor != 0


def test_trees_are_not_all_alike():
    counts = {(len(s.coordinates), len(s.parts)) for s in map(tree, range(25))}
    assert len(counts) > 12
