"""Random mechanisms with loops, and Lagrange's equations of the first kind for them, by numbers.

Every port of every part has a coordinate of its own; connections and ideal transmissions are rows of a constraint
matrix. Singular values tell the degrees of freedom and which forces are not unique, one linear solve with multipliers
tells the accelerations. Nothing here knows of the compiler, which sees components and connections only.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

RANK = 1e-9


@dataclass(frozen=True)
class Row:
    """A constraint: ``Σ coefficient·port = constant``, and of an arm ``flange - l·sin(shaft) = 0``."""

    part: str  # "" for a connection
    terms: tuple[tuple[int, float], ...]
    arm: tuple[int, float] | None = None  # the shaft's port and l

    def gradient(self, q: np.ndarray) -> np.ndarray:
        row = np.zeros(len(q))
        for port, c in self.terms:
            row[port] += c
        if self.arm is not None:
            shaft, l = self.arm
            row[shaft] -= l * np.cos(q[shaft])
        return row

    def pull(self, q: np.ndarray, v: np.ndarray) -> float:
        """What gradient·acceleration must be: minus the change of the gradient, times the velocity."""
        return 0.0 if self.arm is None else -self.arm[1] * np.sin(q[self.arm[0]]) * v[self.arm[0]] ** 2


@dataclass
class Mechanism:
    """Parts as text, and the same as numbers.

    Attributes
    ----------
    ports : names of potentials, "p3.a.q"
    nodes : ports that meet, each with the place of the node as a function of the free coordinates
    """

    seed: int
    lines: list[str] = field(default_factory=list)
    ports: list[str] = field(default_factory=list)
    rows: list[Row] = field(default_factory=list)
    nodes: list[tuple[list[int], Callable]] = field(default_factory=list)
    masses: list[tuple[str, int, float, float]] = field(default_factory=list)  # part, port, m, weight
    springs: list[tuple[str, int, int, float, float]] = field(default_factory=list)  # part, a, b, k, offset
    dampers: list[tuple[int, int, float]] = field(default_factory=list)
    free: int = 0

    def __post_init__(self):
        self.random = random.Random(self.seed)
        grow(self)

    # ------------------------------------------------------------------- building

    def part(self, text: str, **ports: str) -> dict[str, int]:
        """A part with its ports, {port: "q" or "theta"}; returns their numbers."""
        name = f"p{len(self.lines)}"
        kind, _, modification = text.partition(" ")
        self.lines.append(f"{kind} {name}{modification};")
        first = len(self.ports)
        self.ports += [f"{name}.{port}.{potential}" for port, potential in ports.items()]
        return {port: first + i for i, port in enumerate(ports)} | {"": name}

    def tie(self, part: str, *terms: tuple[int, float], arm=None) -> None:
        self.rows.append(Row(part, terms, arm))

    def node(self, port: int, place: Callable) -> int:
        self.nodes.append(([port], place))
        return len(self.nodes) - 1

    def join(self, node: int, port: int) -> None:
        self.nodes[node][0].append(port)
        self.rows.append(Row("", ((self.nodes[node][0][0], 1.0), (port, -1.0))))

    def kind(self, node: int) -> str:
        return self.ports[self.nodes[node][0][0]].rpartition(".")[2]

    def of_kind(self, kind: str) -> list[int]:
        return [n for n in range(len(self.nodes)) if self.kind(n) == kind]

    @property
    def text(self) -> str:
        """The model, with parts and connections in any order."""
        names = [p.rpartition(".")[0] for p in self.ports]
        joined = [f"connect({names[ports[0]]}, {names[p]});" for ports, _ in self.nodes for p in ports[1:]]
        lines = list(self.lines)
        self.random.shuffle(lines)
        self.random.shuffle(joined)
        return "\n".join(["model Loops", *lines, "equation", *joined, "end Loops;"])

    # ------------------------------------------------------------------- mechanics

    def state(self, y: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions and velocities of all ports, by a complex step along the free coordinates."""
        q, v = np.zeros((2, len(self.ports)))
        for ports, place in self.nodes:
            value = complex(place(y + 1e-30j * rate))
            q[ports], v[ports] = value.real, value.imag * 1e30
        return q, v

    def constraints(self, q: np.ndarray) -> np.ndarray:
        return np.array([row.gradient(q) for row in self.rows])

    def accelerations(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Of the ports of masses; NaN for the others, which may have none of their own."""
        n, a = len(q), self.constraints(q)
        matrix = np.zeros((n + len(a), n + len(a)))
        right = np.zeros(n + len(a))
        for _, port, m, weight in self.masses:
            matrix[port, port] += m
            right[port] += weight
        for _, left, other, k, offset in self.springs:
            tension = k * (q[other] - q[left] + offset)
            right[left] += tension
            right[other] -= tension
        for left, other, c in self.dampers:
            tension = c * (v[other] - v[left])
            right[left] += tension
            right[other] -= tension
        matrix[:n, n:], matrix[n:, :n] = a.T, a
        right[n:] = [row.pull(q, v) for row in self.rows]
        return np.linalg.lstsq(matrix, right, rcond=1e-12)[0][:n]

    def undetermined(self, q: np.ndarray) -> set[str]:
        """Forces at the ports of transmissions that change along the null space of the multipliers."""
        a = self.constraints(q)
        left, size, _ = np.linalg.svd(a)
        null = left[:, np.count_nonzero(size > RANK * size[0]) :]
        found = set()
        for part in {row.part for row in self.rows} - {""}:
            own = [i for i, row in enumerate(self.rows) if row.part == part]
            change = np.abs(a[own].T @ null[own]).max(axis=1, initial=0.0)
            for port in np.flatnonzero(change > 1e-7):
                name, _, potential = self.ports[port].rpartition(".")
                found.add(f"{name}.{'f' if potential == 'q' else 'tau'}")
        return found


# -------------------------------------------------------------------------- growing


def grow(s: Mechanism) -> None:
    for potential, name, port in (("q", "Fixed", "flange"), ("theta", "FixedShaft", "shaft")):
        wall = s.part(f"{name} ", **{port: potential})
        s.tie(wall[""], (wall[port], 1.0))
        s.node(wall[port], lambda y: 0.0 * y[0])
    for _ in range(s.random.randint(1, 3)):
        coordinate(s, s.random.choice(["q", "theta"]))
    for _ in range(s.random.randint(1, 5)):
        hang(s, any_transmission(s.random))
    for _ in range(s.random.randint(0, 5)):
        close(s)
    for node in range(2, len(s.nodes)):
        if s.random.random() < 0.4:
            body(s, node)
        if s.random.random() < 0.6:
            element(s, node)


def coordinate(s: Mechanism, kind: str) -> None:
    """A node that moves by itself: a body."""
    i = s.free
    s.free += 1
    body(s, s.node(-1, lambda y: y[i]), kind)


def body(s: Mechanism, node: int, kind: str = "") -> None:
    m = s.random.choice([0.5, 1.0, 2.0])
    if (kind or s.kind(node)) == "q":
        g = s.random.choice([0.0, 9.81])
        p, port, weight = s.part(f"Mass (m = {m}, g = {g})", flange="q"), "flange", m * g
    else:
        p, port, weight = s.part(f"Inertia (J = {m})", shaft="theta"), "shaft", 0.0
    s.masses.append((p[""], p[port], m, weight))
    if kind:
        s.nodes[node] = ([p[port]], s.nodes[node][1])
    else:
        s.join(node, p[port])


def element(s: Mechanism, node: int) -> None:
    kind = s.kind(node)
    other = s.random.choice([n for n in s.of_kind(kind) if n != node])
    x, offset = s.random.choice([0.5, 1.0, 4.0]), s.random.choice([0.0, 0.3])
    if s.random.random() < 0.5:
        free = f"L = 0, d0 = {-offset}" if kind == "q" else f"theta0 = {-offset}"
        p = s.part(f"{'Spring' if kind == 'q' else 'TorsionSpring'} (k = {x}, {free})", a=kind, b=kind)
        s.springs.append((p[""], p["a"], p["b"], x, offset))
    else:
        p = s.part(f"{'Damper' if kind == 'q' else 'TorsionDamper'} (c = {x})", a=kind, b=kind)
        s.dampers.append((p["a"], p["b"], x))
    s.join(node, p["a"])
    s.join(other, p["b"])


# ------------------------------------------------------------------- transmissions


@dataclass(frozen=True)
class Transmission:
    """A part without mass: from the places of the ports `given` follow the others."""

    text: str
    given: tuple[str, ...]
    law: Callable[[dict], dict]
    rows: tuple[tuple[dict[str, float], tuple[str, float] | None], ...]  # coefficients, and (shaft, l) of an arm

    @property
    def ports(self) -> dict[str, str]:
        names = dict.fromkeys(name for terms, arm in self.rows for name in (*terms, *(arm[:1] if arm else ())))
        turning = self.text.startswith(("Gear", "Planet"))
        return {name: "theta" if turning or name in ("shaft", "pivot") else "q" for name in names}


def rod(L: float) -> Transmission:
    return Transmission(f"Rod (L = {L!r})", ("a",), lambda at: {"b": at["a"] + L}, (({"b": 1.0, "a": -1.0}, None),))


def gear(N: float) -> Transmission:
    return Transmission(f"Gear (N = {N!r})", ("a",), lambda at: {"b": at["a"] / N}, (({"a": 1.0, "b": -N}, None),))


def drum(r: float) -> Transmission:
    rows = (({"flange": 1.0, "shaft": -r}, None),)
    return Transmission(f"Drum (r = {r!r})", ("shaft",), lambda at: {"flange": r * at["shaft"]}, rows)


def arm(l: float) -> Transmission:
    rows = (({"flange": 1.0}, ("shaft", l)),)
    return Transmission(f"Arm (l = {l!r})", ("shaft",), lambda at: {"flange": l * np.sin(at["shaft"])}, rows)


def lever(l1: float, l2: float) -> Transmission:
    rows = (({"a": 1.0}, ("pivot", l1)), ({"b": 1.0}, ("pivot", l2)))
    law = lambda at: {"a": l1 * np.sin(at["pivot"]), "b": l2 * np.sin(at["pivot"])}  # noqa: E731
    return Transmission(f"Lever (l1 = {l1!r}, l2 = {l2!r})", ("pivot",), law, rows)


def pulley() -> Transmission:
    rows = (({"a": 1.0, "b": 1.0, "axle": -2.0}, None),)
    return Transmission("Pulley ", ("a", "axle"), lambda at: {"b": 2 * at["axle"] - at["a"]}, rows)


def planetary(k: float) -> Transmission:
    rows = (({"carrier": 1 + k, "sun": -1.0, "ring": -k}, None),)
    law = lambda at: {"carrier": (at["sun"] + k * at["ring"]) / (1 + k)}  # noqa: E731
    return Transmission(f"PlanetaryGear (ratio = {k})", ("sun", "ring"), law, rows)


def any_transmission(chance: random.Random) -> Transmission:
    ratio = lambda: chance.choice([-2.0, -1.0, 0.5, 1.25, 2.0])  # noqa: E731
    make = chance.choice([rod, gear, drum, arm, lever, pulley, planetary])
    if make is rod:
        return rod(chance.choice([-0.3, 0.0, 0.25]))
    if make is planetary:
        return planetary(chance.choice([1.5, 3.0]))
    return make(*[ratio() for _ in range({pulley: 0, lever: 2}.get(make, 1))])


def put(s: Mechanism, t: Transmission, nodes: dict[str, int]) -> None:
    """Join a transmission to nodes; its ports without one become nodes that follow."""
    p = s.part(t.text, **t.ports)
    for terms, turning in t.rows:
        s.tie(p[""], *((p[port], c) for port, c in terms.items()), arm=turning and (p[turning[0]], turning[1]))
    for port, node in nodes.items():
        s.join(node, p[port])
    places = {port: s.nodes[nodes[port]][1] for port in t.given}
    for port in [port for port in t.ports if port not in nodes]:
        s.node(p[port], lambda y, port=port: t.law({given: place(y) for given, place in places.items()})[port])


def hang(s: Mechanism, t: Transmission) -> None:
    """Put a transmission on nodes of which one at least can move."""
    nodes = s.of_kind(t.ports[t.given[0]])
    if len(nodes) >= len(t.given):
        chosen = s.random.sample(nodes, len(t.given))
        y = np.linspace(0.3, 0.7, s.free)
        if any(s.nodes[n][1](y) != s.nodes[n][1](2 * y) for n in chosen):
            put(s, t, dict(zip(t.given, chosen, strict=True)))


def close(s: Mechanism) -> None:
    """A transmission between nodes that move as it demands: it repeats what others say."""
    y = np.array([[0.3, 0.7, -0.4], [0.9, -0.6, 0.5], [-0.7, 0.2, 0.8]])[:, : s.free]
    at = np.array([[place(row) for _, place in s.nodes] for row in y])  # (samples, nodes)
    found = []
    for i in range(len(s.nodes)):
        for j in range(len(s.nodes)):
            a, b = at[:, i], at[:, j]
            if i == j:
                continue
            if s.kind(i) == s.kind(j) == "q" and np.ptp(b - a) < 1e-12:
                found.append((rod(round(float(b[0] - a[0]), 12)), {"a": i, "b": j}))
            with np.errstate(all="ignore"):
                for make, ratio, ends in (
                    (gear, a / b, ("a", "b")),
                    (drum, b / a, ("shaft", "flange")),
                    (arm, b / np.sin(a), ("shaft", "flange")),
                ):
                    kinds = ("theta", "theta" if make is gear else "q")
                    if (s.kind(i), s.kind(j)) == kinds and np.abs(a).min() > 1e-6 < np.abs(b).min():
                        if np.ptp(ratio) < 1e-12 * np.abs(ratio[0]):
                            found.append((make(float(ratio[0])), dict(zip(ends, (i, j), strict=True))))
    if found:
        put(s, *s.random.choice(found))
