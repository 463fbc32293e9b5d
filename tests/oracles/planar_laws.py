"""Random mechanisms of the plane with strings, contacts, stops and friction, and time stepping for them by numbers.

The scheme is that of `oracles.moreau`, in the coordinates of all bodies: what joints and laws do in a step is
linearized in its middle.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from oracles.jets import Jet
from oracles.moreau import sweep
from oracles.planar import Mechanism, any_spot, body, guide, point, where

UNILATERAL, ONE_WAY, DRY, CONTACT = "unilateral", "one-way", "dry friction", "contact friction"
COMPLEMENTARY = (UNILATERAL, ONE_WAY)
REGULAR = 1e-9  # share of the largest one below which a singular value of the joints' equations is zero


@dataclass(frozen=True)
class Tied:
    """A law of a scene.

    Attributes
    ----------
    part : its name
    kind : UNILATERAL, ONE_WAY, DRY or CONTACT
    motion : function of the coordinates as jets; the gap, or what has the law's velocity as its rate
    force, sign : a variable that is the law's force up to its sign
    restitution, slip, stick : its numbers; of contact friction `slip` is a share of the normal force
    normal : index of the law of that force, -1 for others
    """

    part: str
    kind: str
    motion: Callable[[list[Jet]], Jet]
    force: str
    sign: float = 1.0
    restitution: float = 0.0
    slip: float = 0.0
    stick: float = 0.0
    normal: int = -1


@dataclass
class LawfulMechanism(Mechanism):
    """A mechanism with laws; `plastic` without restitution."""

    plastic: bool = False
    laws: list[Tied] = field(default_factory=list)
    acting: np.ndarray = field(default_factory=lambda: np.zeros(0))  # forces of the laws

    def __post_init__(self):
        self.loops = False
        super().__post_init__()
        if not self.count:
            body(self, (self.number(-1, 1), self.number(-1, 1), self.number(-3, 3)))
        if self.random.random() < 0.3:
            guide(self)
        for _ in range(self.random.randint(1, 4)):
            kept = len(self.parts), len(self.connections), len(self.laws)
            self.random.choice([cable, contact, contact, at_port, at_port, clutch])(self)
            if not all(self.can_move(law) for law in self.laws[kept[2] :]):
                for items, length in zip((self.parts, self.connections, self.laws), kept, strict=True):
                    del items[length:]
        self.forces.append(self.of_laws)
        wish = np.array([self.number(-2, 2) for _ in range(self.count)])
        self.wish = wish if self.random.random() < 0.7 else np.zeros(self.count)

    def restitution(self) -> float:
        return 0.0 if self.plastic else self.random.choice((0.0, 0.0, 0.5, 0.8, 1.0))

    def can_move(self, law: Tied) -> bool:
        """Return whether the joints leave the motion of a law free, which they fix once and for all elsewhere."""
        rows = self.constraints(self.start())
        free = np.eye(self.count) - np.linalg.pinv(rows) @ rows
        return bool(np.abs(free @ law.motion(Jet.coordinates(self.start())).slope).max() > 1e-6)

    def of_laws(self, q: list[Jet], v: np.ndarray) -> np.ndarray:
        """The generalized force of the laws."""
        return sum((f * law.motion(q).slope for f, law in zip(self.acting, self.laws, strict=True)), np.zeros(len(q)))

    def begin(self) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates and velocities of a start."""
        q = self.start()
        return q, self.admissible(q, self.wish)


def spare(s: LawfulMechanism) -> float:
    """A gap at the start, of which one in three is closed."""
    return s.random.choice((0.0, s.number(0, 0.3), s.number(0, 0.8)))


def now(s: LawfulMechanism, motion: Callable[[list[Jet]], Jet]) -> float:
    return float(motion(Jet.coordinates(s.start())).value)


def cable(s: LawfulMechanism) -> None:
    a, b = any_spot(s), any_spot(s)
    distance = float(np.hypot(*np.subtract(where(s, a), where(s, b))))
    if a.solid is b.solid or distance < 0.2:
        return
    length, e = distance + spare(s), s.restitution()
    name = s.part("Cable", "c", f"L = {length!r}, e = {e}")
    for port, end in zip("ab", (a, b), strict=True):
        s.connect(point(s, end), f"{name}.{port}")

    def reserve(q):
        (ax, ay), (bx, by) = s.spot(q, a), s.spot(q, b)
        dx, dy = bx - ax, by - ay
        return (-0.5 / length) * (dx * dx + dy * dy) + length / 2

    s.laws.append(Tied(name, UNILATERAL, reserve, f"{name}.f", restitution=e))


def contact(s: LawfulMechanism) -> None:
    at, angle, e = any_spot(s), s.random.choice((np.pi / 2, np.pi / 2, s.number(0, 3))), s.restitution()
    if at.solid.first < 0:
        return
    nx, ny, mu = float(np.cos(angle)), float(np.sin(angle)), s.random.choice((0.0, 0.2, 0.4))
    x, y = where(s, at)
    d = nx * x + ny * y - spare(s)
    name = s.part("Contact", "n", f"nx = {nx!r}, ny = {ny!r}, d = {d!r}, e = {e}, mu = {mu}")
    s.connect(point(s, at), f"{name}.point")
    size = float(np.hypot(nx, ny))

    def gap(q):
        x, y = s.spot(q, at)
        return (nx / size) * x + (ny / size) * y + (-d)

    def along(q):
        x, y = s.spot(q, at)
        return (ny / size) * x - (nx / size) * y

    s.laws.append(Tied(name, UNILATERAL, gap, f"{name}.fn", restitution=e))
    if mu:
        s.laws.append(Tied(name, CONTACT, along, f"{name}.ft", slip=mu, stick=mu, normal=len(s.laws) - 1))


def limits(s: LawfulMechanism) -> tuple[float, float]:
    slip = s.number(0.2, 6)
    return slip, slip if s.plastic or s.random.random() < 0.7 else 1.5 * slip


def friction(s: LawfulMechanism, kind: str, a: str, b: str, motion: Callable[[list[Jet]], Jet]) -> None:
    slip, stick = limits(s)
    if kind == "DryFriction":
        name, force = s.part(kind, "v", f"F = {slip!r}, Fstick = {stick!r}"), "f"
    else:
        name, force = s.part(kind, "v", f"tau = {slip!r}, tauStick = {stick!r}"), "torque"
    s.connect(a, f"{name}.a")
    s.connect(b, f"{name}.b")
    s.laws.append(Tied(name, DRY, motion, f"{name}.{force}", -1.0, slip=slip, stick=stick))


def at_port(s: LawfulMechanism) -> None:
    """A one-dimensional law between the ground and the coordinate of a joint."""
    if not s.ports:
        return
    port, motion = s.random.choice(s.ports)
    turning, value, e = port.endswith("shaft"), now(s, motion), s.restitution()
    wall = s.part("FixedShaft" if turning else "Fixed", "e")
    ground = f"{wall}.shaft" if turning else f"{wall}.flange"
    kind = s.random.choice(["friction", *(("backlash", "ratchet") if turning else ("stop", "cable"))])
    if kind == "friction":
        return friction(s, "BearingFriction" if turning else "DryFriction", ground, port, motion)
    if kind == "backlash":
        room = 2 * (abs(value) + spare(s))
        name = s.part("Backlash", "v", f"clearance = {room!r}, e = {e}")
        ends = port, ground
        for sign, force in ((-1.0, "front"), (1.0, "back")):
            one = lambda q, sign=sign: sign * motion(q) + room / 2  # noqa: E731
            s.laws.append(Tied(name, UNILATERAL, one, f"{name}.{force}", restitution=e))
    elif kind == "ratchet":
        name, ends = s.part("Ratchet", "v"), (ground, port)
        s.laws.append(Tied(name, ONE_WAY, motion, f"{name}.tau", -1.0))
    else:
        sign = 1.0 if kind == "stop" else -1.0
        ends = ground, port
        if kind == "cable" and value < 0.0:
            ends, sign, kind = (port, ground), 1.0, "cable"
        length = (value if ends[1] == port else -value) + (spare(s) if kind == "cable" else -spare(s))
        name = s.part(".Cable" if kind == "cable" else ".Stop", "v", f"L = {length!r}, e = {e}")
        offset = length if kind == "cable" else -length
        gap = lambda q: sign * motion(q) + offset  # noqa: E731
        s.laws.append(Tied(name, UNILATERAL, gap, f"{name}.f", 1.0 if kind == "cable" else -1.0, restitution=e))
    for place, end in zip(ends, "ab", strict=True):
        s.connect(place, f"{name}.{end}")


def clutch(s: LawfulMechanism) -> None:
    """Friction between two joints."""
    shafts = [port for port in s.ports if port[0].endswith("shaft")]
    if len(shafts) < 2:
        return
    (a, first), (b, second) = s.random.sample(shafts, 2)
    friction(s, "Clutch", a, b, lambda q: second(q) - first(q))


# ------------------------------------------------------------------------ time stepping


def march(s: LawfulMechanism, stop: float, steps: int) -> np.ndarray:
    """Return the coordinates (steps + 1, n) at equal steps up to a time."""
    h, laws = stop / steps, s.laws
    q, v = s.begin()
    path, impulse, stuck = [q], np.zeros(len(laws)), np.zeros(len(laws), bool)
    unilateral = np.array([law.kind == UNILATERAL for law in laws])
    dry, rough = (np.array([law.kind == kind for law in laws]) for kind in (DRY, CONTACT))
    s.acting = np.zeros(len(laws))
    for _ in range(steps):
        jets = Jet.coordinates(q + 0.5 * h * v)
        inverse, moved = free_motion(s, jets, v, h)
        motions = [law.motion(jets) for law in laws]
        rows = np.array([m.slope for m in motions]).reshape(-1, s.count)
        delassus = rows @ inverse @ rows.T
        rate = rows @ v
        open_ = unilateral & (np.array([m.value for m in motions]) > 0.0)
        limit = h * np.array([law.stick if held else law.slip for law, held in zip(laws, stuck, strict=True)])
        wanted = np.array([law.restitution for law in laws]) * np.minimum(rate, 0.0)
        lower, upper = np.where(dry, -limit, 0.0), np.where(dry, limit, np.where(open_ | rough, 0.0, np.inf))
        impulse = with_cones(s, delassus, rows @ moved + wanted, lower, upper, impulse)
        after = moved + inverse @ (rows.T @ impulse)
        stuck = dry & (np.abs(impulse) < limit)
        q, v = q + 0.5 * h * (v + after), after
        path.append(q)
    return np.array(path)


def free_motion(s: LawfulMechanism, jets: list[Jet], v: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the inverse mass of the jointed bodies, (n, n), and the velocities after a step without laws."""
    matrix, right, rows = s.equations(jets, v)
    n = s.count
    inverse = np.linalg.inv(matrix)
    a = np.array([row.slope for row in rows]).reshape(len(rows), n)
    if not len(a):
        return inverse, v + h * inverse @ right
    compliance = np.linalg.pinv(a @ inverse @ a.T, rcond=REGULAR)
    inverse, back = inverse - inverse @ a.T @ compliance @ a @ inverse, inverse @ a.T @ compliance
    free = v - back @ (a @ v)  # velocities that the joints allow in the middle of the step
    return inverse, free + h * inverse @ right


def with_cones(
    s: LawfulMechanism, delassus: np.ndarray, q: np.ndarray, lower: np.ndarray, upper: np.ndarray, x: np.ndarray
) -> np.ndarray:
    """Solve for the impulses; the limits of contact friction follow from those of the contacts."""
    rough = [(k, law.normal, law.slip) for k, law in enumerate(s.laws) if law.kind == CONTACT]
    for _ in range(200):
        for k, normal, mu in rough:
            upper[k], lower[k] = mu * x[normal], -mu * x[normal]
        found = sweep(delassus, q, lower, upper, x)
        change = np.abs(found - x).max(initial=0.0)
        x = found
        if not rough or change <= 1e-12 * np.abs(x).max(initial=0.0):
            break
    return x
