"""Random mechanisms of the plane, and Lagrange's equations of the first kind for them, by numbers.

Every body has its own place and direction; joints, rods and guides are rows of a constraint matrix whose multipliers
are their reactions. What the compiler sees are parts and connections in any order; nothing here knows of the compiler.
"""

from __future__ import annotations

import random
from dataclasses import dataclass, field

import numpy as np
from oracles.jets import Jet

GRAVITY = 9.81
# singular values of the constraint matrix below this are a singular place, which is not what is tried here
REGULAR = 0.03


@dataclass(frozen=True)
class Solid:
    """A body, a bar or a particle with its first coordinate; the ground has none (-1)."""

    name: str
    first: int
    m: float = 0.0
    J: float = 0.0
    c: tuple[float, float] = (0.0, 0.0)
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)  # of the ground, and where the others start

    @property
    def frame(self) -> str:
        return {"b": "frame", "r": "a", "g": "frame"}[self.name[0]]


@dataclass(frozen=True)
class Spot:
    """A point of a solid, seen from its frame."""

    solid: Solid
    x: float = 0.0
    y: float = 0.0


@dataclass(frozen=True)
class Tie:
    """A joint: `residuals` gives its rows from all coordinates; `reactions` are names with the row and the sign."""

    name: str
    residuals: object
    reactions: tuple[tuple[str, int, float], ...] = ()


@dataclass
class Mechanism:
    """Parts as text, and the same as numbers."""

    seed: int
    loops: bool = True
    parts: list[str] = field(default_factory=list)
    connections: list[str] = field(default_factory=list)
    solids: list[Solid] = field(default_factory=list)
    ties: list[Tie] = field(default_factory=list)
    forces: list = field(default_factory=list)  # functions (jets of the coordinates, velocities) -> generalized force
    relative: list[tuple[str, str, object]] = field(default_factory=list)  # a joint's coordinate, its rate; a function
    inertias: list[tuple[float, object]] = field(default_factory=list)  # of 1-D parts, each of a function
    ports: list[tuple[str, object]] = field(default_factory=list)  # flanges and shafts for 1-D parts; a function
    count: int = 0  # coordinates

    def __post_init__(self):
        self.random = random.Random(self.seed)
        grow(self)

    # -------------------------------------------------------------------- building

    def number(self, low: float, high: float) -> float:
        return round(self.random.uniform(low, high), 3)

    def part(self, kind: str, letter: str, modification: str = "") -> str:
        name = f"{letter}{len(self.parts)}"
        self.parts.append(f"{kind} {name}({modification});")
        return name

    def connect(self, a: str, b: str) -> None:
        self.connections.append(f"connect({a}, {b});" if self.random.random() < 0.5 else f"connect({b}, {a});")

    @property
    def text(self) -> str:
        parts, joined = list(self.parts), list(self.connections)
        self.random.shuffle(parts)
        self.random.shuffle(joined)
        head = ["model Mechanism", "import Planar.*;", f"inner World world(g = {GRAVITY});"]
        return "\n".join([*head, *parts, "equation", *joined, "end Mechanism;"])

    # ------------------------------------------------------------------- mechanics

    def frame(self, q: list[Jet], solid: Solid) -> tuple[Jet, Jet, Jet]:
        """Place and direction."""
        if solid.first < 0:
            zero = 0.0 * q[0]
            return tuple(zero + value for value in solid.place)
        if solid.name[0] == "p":
            return q[solid.first], q[solid.first + 1], 0.0 * q[0]
        return q[solid.first], q[solid.first + 1], q[solid.first + 2]

    def spot(self, q: list[Jet], at: Spot) -> tuple[Jet, Jet]:
        x, y, theta = self.frame(q, at.solid)
        return x + at.x * theta.cos() - at.y * theta.sin(), y + at.x * theta.sin() + at.y * theta.cos()

    def start(self) -> np.ndarray:
        """(count,) the coordinates that the mechanism was drawn at."""
        q = np.zeros(self.count)
        for s in self.solids:
            if s.first >= 0:
                width = 2 if s.name[0] == "p" else 3
                q[s.first : s.first + width] = s.place[:width]
        return q

    def named(self, q: np.ndarray, v: np.ndarray) -> dict[str, float]:
        """Places and velocities by the compiler's names, and the coordinates of joints."""
        jets = Jet.coordinates(q)
        known: dict[str, float] = {}
        for solid in self.solids:
            if solid.first < 0:
                continue
            width = 2 if solid.name[0] == "p" else 3
            for i, (place, rate) in enumerate((("x", "vx"), ("y", "vy"), ("theta", "omega"))[:width]):
                known[f"{solid.name}.{place}"] = q[solid.first + i]
                known[f"{solid.name}.{rate}"] = v[solid.first + i]
        for place, rate, function in self.relative:
            jet = function(jets)
            known[place], known[rate] = jet.value, float(jet.slope @ v)
        return known

    def rows(self, q: np.ndarray) -> list[Jet]:
        jets = Jet.coordinates(q)
        return [row for tie in self.ties for row in tie.residuals(jets)]

    def constraints(self, q: np.ndarray) -> np.ndarray:
        rows = self.rows(q)
        return np.array([row.slope for row in rows]).reshape(len(rows), self.count)

    def admissible(self, q: np.ndarray, wish: np.ndarray) -> np.ndarray:
        """The velocities nearest to a wish that the constraints allow."""
        a = self.constraints(q)
        return wish - np.linalg.pinv(a) @ (a @ wish) if len(a) else wish

    def equations(self, jets: list[Jet], v: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[Jet]]:
        """Mass matrix, forces less those of inertia, and the rows of the ties."""
        n = self.count
        mass, right = np.zeros((n, n)), np.zeros(n)
        for s in self.solids:
            if s.first < 0:
                continue
            for axis, centre in enumerate(self.spot(jets, Spot(s, *s.c))):
                mass += s.m * np.outer(centre.slope, centre.slope)
                weight = GRAVITY if axis == 1 else 0.0
                right -= s.m * (weight + v @ centre.bend @ v) * centre.slope
            if s.J:
                mass[s.first + 2, s.first + 2] += s.J
        for inertia, function in self.inertias:
            jet = function(jets)
            mass += inertia * np.outer(jet.slope, jet.slope)
            right -= inertia * (v @ jet.bend @ v) * jet.slope
        for force in self.forces:
            right += force(jets, v)
        return mass, right, [row for tie in self.ties for row in tie.residuals(jets)]

    def motion(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Accelerations, multipliers, and the condition of the equations they follow from."""
        mass, forces, rows = self.equations(Jet.coordinates(q), v)
        n, r = self.count, len(rows)
        matrix, right = np.zeros((n + r, n + r)), np.zeros(n + r)
        matrix[:n, :n], right[:n] = mass, forces
        for i, row in enumerate(rows):
            matrix[n + i, :n] = row.slope
            matrix[:n, n + i] = -row.slope
            right[n + i] = -v @ row.bend @ v
        found = np.linalg.solve(matrix, right)
        scale = np.abs(matrix).max(axis=1)
        return found[:n], found[n:], float(np.linalg.cond(matrix / scale[:, None]))


# -------------------------------------------------------------------------- growing


def grow(s: Mechanism) -> None:
    x, y, theta = s.number(-1, 1), s.number(-1, 1), s.random.choice([0.0, 0.0, s.number(-3, 3)])
    ground = s.part("Ground", "g", f"x = {x}, y = {y}, theta = {theta}")
    s.solids.append(Solid(ground, -1, place=(x, y, theta)))
    for _ in range(s.random.randint(1, 4)):
        s.random.choice([hinge, hinge, slide, weld, fly, particle])(s)
    if s.loops:
        for _ in range(s.random.randint(0, 2)):
            s.random.choice([strut, guide])(s)
        if s.random.random() < 0.3:
            gearing(s)
    for port in list(s.ports):
        if s.random.random() < 0.5:
            s.random.choice([flywheel, flywheel, retainer])(s, port)
    for _ in range(s.random.randint(0, 3)):
        s.random.choice([spring, damper, twist, push])(s)


def body(s: Mechanism, place: tuple[float, float, float]) -> Solid:
    """A body or a bar that starts at a place."""
    x, y, theta = place
    start = f"x(start = {x!r}), y(start = {y!r}), theta(start = {theta!r})"
    m, first = s.number(0.3, 2), s.count
    s.count += 3
    if s.random.random() < 0.5:
        l = s.number(0.4, 1.2)
        name = s.part("Bar", "r", f"l = {l}, m = {m}, {start}")
        solid = Solid(name, first, m, m * l**2 / 12, (l / 2, 0.0), place)
    else:
        J = s.number(0.05, 0.5)
        c = s.random.choice([(0.0, 0.0), (s.number(-0.5, 0.5), s.number(-0.5, 0.5))])
        name = s.part("Body", "b", f"m = {m}, J = {J}, cx = {c[0]}, cy = {c[1]}, {start}")
        solid = Solid(name, first, m, J, c, place)
    s.solids.append(solid)
    return solid


def rigid(s: Mechanism) -> Solid:
    return s.random.choice([solid for solid in s.solids if solid.name[0] != "p"])


def where(s: Mechanism, at: Spot) -> tuple[float, float]:
    x, y, theta = at.solid.place
    c, si = np.cos(theta), np.sin(theta)
    return float(x + at.x * c - at.y * si), float(y + at.x * si + at.y * c)


def mount(s: Mechanism) -> tuple[Spot, str]:
    """A place on a solid to hang something on, and the frame there."""
    at = Spot(rigid(s), s.random.choice([0.0, s.number(-0.6, 0.6)]), s.random.choice([0.0, s.number(-0.6, 0.6)]))
    if at.x == at.y == 0.0:
        return at, f"{at.solid.name}.{at.solid.frame}"
    link = s.part("Link", "l", f"rx = {at.x}, ry = {at.y}")
    s.connect(f"{at.solid.name}.{at.solid.frame}", f"{link}.a")
    return at, f"{link}.b"


def point(s: Mechanism, at: Spot) -> str:
    """The port of a point."""
    if at.solid.name[0] == "p":
        return f"{at.solid.name}.point"
    name = s.part("PointOf", "o", f"rx = {at.x}, ry = {at.y}")
    s.connect(f"{at.solid.name}.{at.solid.frame}", f"{name}.frame")
    return f"{name}.point"


def hinge(s: Mechanism) -> None:
    at, port = mount(s)
    solid = body(s, (*where(s, at), s.number(-3, 3)))
    name = s.part("Revolute", "h", "useShaft = true")
    s.connect(port, f"{name}.a")
    s.connect(f"{name}.b", f"{solid.name}.{solid.frame}")

    def rows(q):
        x, y = s.spot(q, at)
        bx, by, _ = s.frame(q, solid)
        return [bx - x, by - y]

    s.ties.append(Tie(name, rows, ((f"{name}.b.fx", 0, -1.0), (f"{name}.b.fy", 1, -1.0))))
    turn = lambda q: s.frame(q, solid)[2] - s.frame(q, at.solid)[2]  # noqa: E731
    s.relative.append((f"{name}.phi", f"{name}.omega", turn))
    s.ports.append((f"{name}.shaft", turn))


def slide(s: Mechanism) -> None:
    at, port = mount(s)
    nx, ny = s.random.choice([(1.0, 0.0), (0.0, 1.0), (s.number(-1, 1), s.number(0.2, 1))])
    size = np.hypot(nx, ny)
    distance, theta = s.number(-1, 1), at.solid.place[2]
    ex, ey = (nx * np.cos(theta) - ny * np.sin(theta)) / size, (nx * np.sin(theta) + ny * np.cos(theta)) / size
    x, y = where(s, at)
    solid = body(s, (float(x + distance * ex), float(y + distance * ey), theta))
    name = s.part("Prismatic", "s", f"nx = {nx}, ny = {ny}, s(start = {distance}), useFlange = true")
    s.connect(port, f"{name}.a")
    s.connect(f"{name}.b", f"{solid.name}.{solid.frame}")

    def parts(q):
        x, y = s.spot(q, at)
        bx, by, theta = s.frame(q, solid)
        a = s.frame(q, at.solid)[2]
        c, si = a.cos(), a.sin()
        ex, ey = (nx / size) * c - (ny / size) * si, (nx / size) * si + (ny / size) * c
        return bx - x, by - y, ex, ey, theta - a

    def rows(q):
        dx, dy, ex, ey, turn = parts(q)
        return [ex * dy - ey * dx, turn]

    def along(q):
        dx, dy, ex, ey, _ = parts(q)
        return ex * dx + ey * dy

    s.ties.append(Tie(name, rows))
    s.relative.append((f"{name}.s", f"{name}.v", along))
    s.ports.append((f"{name}.flange", along))


def weld(s: Mechanism) -> None:
    at, port = mount(s)
    solid = body(s, (*where(s, at), at.solid.place[2]))
    name = s.part("Weld", "w")
    s.connect(port, f"{name}.a")
    s.connect(f"{name}.b", f"{solid.name}.{solid.frame}")

    def rows(q):
        x, y = s.spot(q, at)
        bx, by, theta = s.frame(q, solid)
        return [bx - x, by - y, theta - s.frame(q, at.solid)[2]]

    reactions = tuple((f"{name}.b.{flow}", i, -1.0) for i, flow in enumerate(("fx", "fy", "tau")))
    s.ties.append(Tie(name, rows, reactions))


def fly(s: Mechanism) -> None:
    body(s, (s.number(-1, 1), s.number(-1, 1), s.number(-3, 3)))


def any_spot(s: Mechanism) -> Spot:
    solid = s.random.choice(s.solids)
    return Spot(solid) if solid.name[0] == "p" else Spot(solid, s.number(-0.6, 0.6), s.number(-0.6, 0.6))


def particle(s: Mechanism) -> None:
    """A particle on a rod."""
    at, angle, length = any_spot(s), s.number(-3, 3), s.number(0.4, 1.2)
    x, y = where(s, at)
    place = (float(x + length * np.cos(angle)), float(y + length * np.sin(angle)), 0.0)
    m = s.number(0.2, 1.5)
    name = s.part("PointMass", "p", f"m = {m}, x(start = {place[0]!r}), y(start = {place[1]!r})")
    solid = Solid(name, s.count, m, place=place)
    s.solids.append(solid)
    s.count += 2
    rod(s, at, Spot(solid))


def rod(s: Mechanism, at: Spot, other: Spot) -> None:
    (ax, ay), (bx, by) = where(s, at), where(s, other)
    length, direction = float(np.hypot(bx - ax, by - ay)), float(np.arctan2(by - ay, bx - ax))
    name = s.part("Rod", "k", f"L = {length!r}, phi(start = {direction!r})")
    s.connect(point(s, at), f"{name}.a")
    s.connect(f"{name}.b", point(s, other))

    def rows(q):
        (ax, ay), (bx, by) = s.spot(q, at), s.spot(q, other)
        dx, dy = bx - ax, by - ay
        return [0.5 / length * (dx * dx + dy * dy) + (-length / 2)]

    def direction_of(q):
        (ax, ay), (bx, by) = s.spot(q, at), s.spot(q, other)
        dx, dy = bx - ax, by - ay
        slope = (dx.value * dy.slope - dy.value * dx.slope) / length**2
        return Jet(float(np.arctan2(dy.value, dx.value)), slope, np.zeros_like(dx.bend))  # nobody asks for its bend

    s.ties.append(Tie(name, rows, ((f"{name}.f", 0, -1.0),)))
    s.relative.append((f"{name}.phi", f"{name}.omega", direction_of))


def closing(s: Mechanism, tie) -> None:
    """Close a loop; take it back where it nearly repeats the others, or locks something that could move."""
    before = mobile(s)
    lists = s.parts, s.connections, s.ties, s.relative, s.ports
    kept = [len(items) for items in lists]
    tie()
    a = s.constraints(s.start())
    if len(a) >= s.count or np.linalg.svd(a, compute_uv=False)[-1] < REGULAR or (before & ~mobile(s)).any():
        for items, length in zip(lists, kept, strict=True):
            del items[length:]


def mobile(s: Mechanism) -> np.ndarray:
    """(count,) whether a coordinate can move at the start."""
    a = s.constraints(s.start())
    free = np.eye(s.count) - np.linalg.pinv(a) @ a
    return np.abs(free).max(axis=1) > 1e-6


def strut(s: Mechanism) -> None:
    """A rod between two solids that are there."""
    a, b = any_spot(s), any_spot(s)
    if a.solid is b.solid or np.hypot(*np.subtract(where(s, a), where(s, b))) < 0.2:
        return
    closing(s, lambda: rod(s, a, b))


def guide(s: Mechanism) -> None:
    """A point that stays on a line of the ground."""
    at = any_spot(s)
    if at.solid.first < 0:
        return
    x, y = where(s, at)
    nx, ny = s.random.choice([(1.0, 0.0), (0.0, 2.0), (s.number(-1, 1), s.number(0.2, 1))])
    size = float(np.hypot(nx, ny))

    def tie():
        name = s.part("Guide", "u", f"x0 = {x!r}, y0 = {y!r}, nx = {nx}, ny = {ny}")
        s.connect(point(s, at), f"{name}.point")

        def rows(q):
            px, py = s.spot(q, at)
            return [(nx / size) * (py + (-y)) - (ny / size) * (px + (-x))]

        def along(q):
            px, py = s.spot(q, at)
            return (nx / size) * (px + (-x)) + (ny / size) * (py + (-y))

        s.ties.append(Tie(name, rows, ((f"{name}.fn", 0, 1.0),)))
        s.relative.append((f"{name}.flange.q", f"der({name}.flange.q)", along))
        s.ports.append((f"{name}.flange", along))

    closing(s, tie)


# ----------------------------------------------------------------------- 1-D parts


def gearing(s: Mechanism) -> None:
    """Two joints that turn or slide in a fixed ratio."""
    if len(s.ports) < 2:
        return
    (a, first), (b, second) = s.random.sample(s.ports, 2)
    jets = Jet.coordinates(s.start())
    one, other = float(first(jets).value), float(second(jets).value)
    if not 0.2 < abs(one) < 5 or not 0.2 < abs(other) < 5:
        return
    turning = [port.endswith("shaft") for port in (a, b)]
    ratio = one / other

    def tie():
        if turning[0] != turning[1]:
            name = s.part("Drum", "d", f"r = {ratio if turning[1] else 1 / ratio!r}")
            ends = ("flange", "shaft") if turning[1] else ("shaft", "flange")
        else:
            kind = f"Gear N = {ratio!r}" if turning[0] else f"Beam l1 = {ratio!r}, l2 = 1"
            name = s.part(kind.partition(" ")[0], "d", kind.partition(" ")[2])
            ends = ("a", "b")
            if not turning[0]:
                fixed = s.part("Fixed", "e")
                s.connect(f"{fixed}.flange", f"{name}.pivot")
        for port, end in zip((a, b), ends, strict=True):
            s.connect(port, f"{name}.{end}")
        s.ties.append(Tie(name, lambda q: [first(q) - ratio * second(q)]))

    closing(s, tie)


def flywheel(s: Mechanism, port: tuple[str, object]) -> None:
    """An inertia on the coordinate of a joint."""
    name, function = port
    inertia = s.number(0.1, 1)
    kind, end = ("Inertia J", "shaft") if name.endswith("shaft") else ("Mass m", "flange")
    part = s.part(kind[:-2], "i", f"{kind[-1]} = {inertia}")
    s.connect(name, f"{part}.{end}")
    s.inertias.append((inertia, function))
    place, rate = ("theta", "omega") if end == "shaft" else ("q", "v")
    s.relative.append((f"{part}.{place}", f"{part}.{rate}", function))


def retainer(s: Mechanism, port: tuple[str, object]) -> None:
    """A spring from the ground to the coordinate of a joint."""
    name, function = port
    k, rest = s.number(1, 20), s.number(-1, 1)
    turning = name.endswith("shaft")
    wall = s.part("FixedShaft" if turning else "Fixed", "e")
    part = s.part(*((".TorsionSpring", "j", f"k = {k}, theta0 = {rest}") if turning
                    else (".Spring", "j", f"k = {k}, L = 0, d0 = {rest}")))  # fmt: skip
    s.connect(f"{wall}.{'shaft' if turning else 'flange'}", f"{part}.a")
    s.connect(f"{part}.b", name)

    def force(q, v):
        jet = function(q)
        return -k * (jet.value - rest) * jet.slope

    s.forces.append(force)


# --------------------------------------------------------------------------- forces


def between(s: Mechanism) -> tuple[Spot, Spot] | None:
    a, b = any_spot(s), any_spot(s)
    apart = a.solid is not b.solid and np.hypot(*np.subtract(where(s, a), where(s, b))) > 0.2
    return (a, b) if apart else None


def line_force(s: Mechanism, text: str, ends: tuple[Spot, Spot], tension) -> None:
    kind, _, modification = text.partition(" ")
    name = s.part(kind, "f", modification)
    for port, end in zip("ab", ends, strict=True):
        s.connect(point(s, end), f"{name}.{port}")

    def force(q, v):
        (ax, ay), (bx, by) = (s.spot(q, end) for end in ends)
        d = np.array([bx.value - ax.value, by.value - ay.value])
        slopes = np.array([bx.slope - ax.slope, by.slope - ay.slope])
        length = float(np.hypot(*d))
        return -tension(length, float(d @ (slopes @ v)) / length) * (d / length) @ slopes

    s.forces.append(force)


def spring(s: Mechanism) -> None:
    ends, k, d0 = between(s), s.number(1, 30), s.random.choice([0.0, s.number(0.1, 1)])
    if ends:
        line_force(s, f"Spring k = {k}, d0 = {d0}", ends, lambda length, rate: k * (length - d0))


def damper(s: Mechanism) -> None:
    ends, k, c, d0 = between(s), s.number(1, 30), s.number(0.1, 2), s.number(0.1, 1)
    if not ends:
        return
    if s.random.random() < 0.5:
        line_force(s, f"Damper c = {c}", ends, lambda length, rate: c * rate)
    else:
        law = lambda length, rate: k * (length - d0) + c * rate  # noqa: E731
        line_force(s, f"SpringDamper k = {k}, c = {c}, d0 = {d0}", ends, law)


def twist(s: Mechanism) -> None:
    a, b, k, c, phi0 = rigid(s), rigid(s), s.number(1, 10), s.number(0.1, 1), s.number(-1, 1)
    if a is b:
        return
    stiff = s.random.random() < 0.5
    name = s.part(*(("TorsionSpring", "t", f"k = {k}, phi0 = {phi0}") if stiff else ("TorsionDamper", "t", f"c = {c}")))
    s.connect(f"{a.name}.{a.frame}", f"{name}.a")
    s.connect(f"{b.name}.{b.frame}", f"{name}.b")

    def force(q, v):
        turn = s.frame(q, b)[2] - s.frame(q, a)[2]
        return -(k * (turn.value - phi0) if stiff else c * float(turn.slope @ v)) * turn.slope

    s.forces.append(force)


def push(s: Mechanism) -> None:
    at, fx, fy = any_spot(s), s.number(-5, 5), s.number(-5, 5)
    if at.solid.first < 0:
        return
    name = s.part("Force", "q", f"fx = {fx}, fy = {fy}")
    s.connect(point(s, at), f"{name}.point")

    def force(q, v):
        x, y = s.spot(q, at)
        return fx * x.slope + fy * y.slope

    s.forces.append(force)
