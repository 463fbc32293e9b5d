"""Random planar linkages of two-bar groups, with all the ways in which they close by the geometry of circles.

A crank of fixed angle, or one that only has a guess, carries groups of two bars (dyads) one after the other: a bar
from the end of some bar before, and one from the ground, or a slider on a line of the ground, joined by a pin. Each
group closes in two ways, and each of its bars may stand any number of whole turns further.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

TURN = 2 * np.pi


@dataclass
class Group:
    """Two bars, or a bar and a slider, on the end of an earlier bar."""

    on: int  # number of the bar that carries it
    rod: float
    m: float  # length of the second bar; 0 for a slider
    x: float
    y: float
    direction: float = 0.0  # of a slider's line

    @property
    def slides(self) -> bool:
        return self.m == 0.0

    def ways(self, p: np.ndarray) -> list[tuple[float, float, np.ndarray]]:
        """Return (angle of the first bar, of the second or place on the line, end of the second) for each way."""
        ground = np.array([self.x, self.y])
        if self.slides:
            along = np.array([np.cos(self.direction), np.sin(self.direction)])
            foot, d = float((p - ground) @ along), p - ground
            aside = float(d[1] * along[0] - d[0] * along[1])
            half = np.sqrt(self.rod**2 - aside**2)
            ends = [(foot + k * half, ground + (foot + k * half) * along) for k in (1, -1)]
        else:
            d = p - ground
            distance, towards = float(np.hypot(*d)), float(np.arctan2(d[1], d[0]))
            at = np.arccos((distance**2 + self.m**2 - self.rod**2) / (2 * distance * self.m))
            ends = [(a, ground + self.m * np.array([np.cos(a), np.sin(a)])) for a in (towards + at, towards - at)]
        return [(float(np.arctan2(*(end - p)[::-1])), float(second), end) for second, end in ends]

    def gap(self, p: np.ndarray) -> float:
        """How far it is from the places at which its two ways become one; negative where it does not close."""
        ground = np.array([self.x, self.y])
        if self.slides:
            d, a = p - ground, self.direction
            return self.rod - abs(float(d[1] * np.cos(a) - d[0] * np.sin(a)))
        distance = float(np.hypot(*(p - ground)))
        return min(distance - abs(self.rod - self.m), self.rod + self.m - distance)


@dataclass
class Linkage:
    """A crank with groups.

    Attributes
    ----------
    guesses : {pin: angle}
    free : whether the crank is not fixed; its pin is "A"
    """

    crank: float
    angle: float
    groups: list[Group]
    guesses: dict[str, float] = field(default_factory=dict)
    free: bool = False

    @staticmethod
    def random(seed: int, free: bool = False) -> Linkage:
        rng = np.random.default_rng(seed)
        while True:
            count = int(rng.integers(1, 3 if free else 4))
            linkage = Linkage(round(rng.uniform(0.3, 1.2), 2), round(rng.uniform(-3, 3), 2), [], free=free)
            for k in range(count):
                rod, m, x, y = (round(float(v), 2) for v in (*rng.uniform(0.5, 1.6, 2), *rng.uniform(-1.2, 1.2, 2)))
                slides, on = rng.random() < 0.25, int(rng.integers(0, 2 * k + 1))
                on = 0 if on and on % 2 == 0 and linkage.groups[(on - 1) // 2].slides else on  # nothing on a slider
                direction = round(float(rng.uniform(-3, 3)), 2)
                linkage.groups.append(Group(on, rod, 0.0 if slides else m, x, y, direction))
            ways = linkage.ways()
            if len(ways) == 2**count:
                break
        meant = linkage.pins(ways[int(rng.integers(len(ways)))])
        for name, value in meant.items():
            if rng.random() < (0.8 if free else 0.4):
                near = (value + np.pi) % TURN - np.pi + (1.5 if free else 0.5) * rng.normal()
                linkage.guesses[name] = round(float(near + TURN * rng.integers(-1, 2) * (rng.random() < 0.2)), 3)
        return linkage

    def ways(self) -> list[list[tuple[float, float]]]:
        """All ways in which all groups close with some room to spare."""
        found = []
        for choice in product((0, 1), repeat=len(self.groups)):
            angles, ends = [self.angle], [self.crank * np.array([np.cos(self.angle), np.sin(self.angle)])]
            way = []
            for group, k in zip(self.groups, choice, strict=True):
                p = ends[group.on]
                if group.gap(p) < 0.05:
                    break
                first, second, end = group.ways(p)[k]
                way.append((first, second))
                ends += [end, end]
                angles += [first, second]
            else:
                found.append(way)
        return found

    def pins(self, way: list[tuple[float, float]], turned: np.ndarray | None = None) -> dict[str, float]:
        """Angles of the free pins; `turned` (2·groups, …): whole turns of each bar, of a free crank last."""
        turns = np.zeros(2 * len(self.groups) + 1) if turned is None else turned
        bars, angles = [np.float64(self.angle)], {}
        if self.free:
            bars = [self.angle + TURN * turns[-1]]
            angles["A"] = bars[0]
        for k, (group, (first, second)) in enumerate(zip(self.groups, way, strict=True)):
            a = first + TURN * turns[2 * k]
            b = 0.0 if group.slides else second + TURN * turns[2 * k + 1]
            angles[f"B{k}"], angles[f"C{k}"] = a - bars[group.on], b - a
            if not group.slides:
                angles[f"D{k}"] = b
            bars += [a, b]
        return angles

    def open(self, pins: dict[str, float]) -> float:
        """How far the ends of bars that are pinned together are apart."""
        angle = pins.get("A", self.angle)
        bars, ends = [angle], [self.crank * np.array([np.cos(angle), np.sin(angle)])]
        apart = [0.0]
        for k, group in enumerate(self.groups):
            a = pins[f"B{k}"] + bars[group.on]
            b = pins[f"C{k}"] + a
            end = ends[group.on] + group.rod * np.array([np.cos(a), np.sin(a)])
            away = end - np.array([group.x, group.y])
            if group.slides:
                apart += [abs(away[1] * np.cos(group.direction) - away[0] * np.sin(group.direction)), abs(b)]
            else:
                apart += [*abs(away - group.m * np.array([np.cos(b), np.sin(b)])), abs(b - pins[f"D{k}"])]
            bars += [a, b]
            ends += [end, end]
        return float(max(apart))

    def cost(self, pins: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
        """Squares of what the guesses are missed by, and of the angles nobody has guessed."""
        given = sum(((pins[k] - v) ** 2 for k, v in self.guesses.items()), np.float64(0.0))
        return given, sum((v**2 for k, v in pins.items() if k not in self.guesses), np.float64(0.0))

    def nearest_of_all(self) -> float:
        """The least cost of the guesses over all angles of the crank but those next to a dead centre."""
        angles, width = np.linspace(-np.pi, np.pi, 241), TURN / 240
        costs = [self.at(angle).nearest()[0] for angle in angles.tolist()]
        best, least = float(angles[int(np.argmin(costs))]), min(costs)
        while width > 1e-4:
            for angle in (best - width / 2, best + width / 2):
                cost = self.at(angle).nearest()[0]
                if cost < least:
                    best, least = angle, cost
            width /= 2
        return least

    def at(self, angle: float) -> Linkage:
        return replace(self, angle=angle)

    def nearest(self) -> tuple[float, float]:
        """The least costs over all ways and whole turns: of the guesses first."""
        best = (np.inf, np.inf)
        wide = range(-3, 4) if len(self.groups) < 3 and not self.free else range(-2, 3)
        free = [wide if j == 0 or not g.slides else (0,) for g in self.groups for j in (0, 1)]
        free += [wide] if self.free else []
        turned = np.array(list(product(*free))).T
        for way in self.ways():
            given, rest = self.cost(self.pins(way, turned))
            given, rest = np.broadcast_to(given, turned.shape[1:]), np.broadcast_to(rest, turned.shape[1:])
            own = np.flatnonzero(given <= given.min() + 1e-9)
            k = own[np.argmin(rest[own])]
            if given[k] < best[0] - 1e-9 or (given[k] <= best[0] + 1e-9 and rest[k] < best[1]):
                best = float(given[k]), float(rest[k])
        return best

    def text(self) -> str:
        """The model."""
        crank = f"phi(start = {self.angle}, fixed = true), omega(start = 1, fixed = true)"
        if self.free:
            crank = f"phi(start = {self.guesses['A']})" if "A" in self.guesses else ""
        parts = [f"Ground g; Revolute A({crank});"]
        parts.append(f"Bar bar0(l = {self.crank}, m = 1);")
        lines = ["connect(g.frame, A.a); connect(A.b, bar0.a);"]

        def pin(name: str) -> str:
            guess = f"(phi(start = {self.guesses[name]}))" if name in self.guesses else ""
            return f"Revolute {name}{guess};"

        for k, group in enumerate(self.groups):
            one, two = 2 * k + 1, 2 * k + 2
            parts.append(f"{pin(f'B{k}')} {pin(f'C{k}')} Bar bar{one}(l = {group.rod}, m = 1);")
            parts.append(f"Ground g{k}(x = {group.x}, y = {group.y});")
            end = "bar0.b" if not group.on else f"bar{group.on}.b"
            lines.append(f"connect({end}, B{k}.a); connect(B{k}.b, bar{one}.a); connect(bar{one}.b, C{k}.a);")
            if group.slides:
                parts.append(f"Prismatic P{k}(nx = {np.cos(group.direction)}, ny = {np.sin(group.direction)});")
                parts.append(f"Body slider{k}(m = 1, J = 1);")
                lines.append(f"connect(g{k}.frame, P{k}.a); connect(P{k}.b, C{k}.b); connect(P{k}.b, slider{k}.frame);")
            else:
                parts.append(f"{pin(f'D{k}')} Bar bar{two}(l = {group.m}, m = 1);")
                lines.append(f"connect(g{k}.frame, D{k}.a); connect(D{k}.b, bar{two}.a); connect(C{k}.b, bar{two}.b);")
        inside, equations = "\n  ".join(parts), "\n  ".join(lines)
        head = "model Linkage\n  import Planar.*;\n  inner World world(g = 0);\n  "
        return f"{head}{inside}\nequation\n  {equations}\nend Linkage;"


def check(seed: int, free: bool = False) -> None:
    """Assert that a random linkage starts with all its pins where it closes nearest to their guesses.

    Parameters
    ----------
    free : whether nothing is fixed, so that the crank may move to where the guesses are met best
    """
    import lmoc

    linkage = Linkage.random(seed, free)
    run = lmoc.compile_text(linkage.text()).simulate(times=[0.0])
    pins = {name: float(run[f"{name}.phi"][0]) for name in linkage.pins(linkage.ways()[0])}
    given, rest = linkage.cost(pins)
    least, least_rest = (linkage.nearest_of_all(), np.inf) if free else linkage.nearest()
    assert linkage.open(pins) < 1e-8, f"seed {seed}: no closure"
    assert given < least + 1e-4, f"seed {seed}: {pins} is {given:.5f} from {linkage.guesses}, not {least:.5f}"
    near = abs(given - least) > 1e-9 or rest < least_rest + 1e-3
    assert near, f"seed {seed}: {pins}, square sum {rest:.5f}, not {least_rest:.5f}"
    assert "W0533" not in {note.code for note in run.notes}
