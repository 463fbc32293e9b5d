"""Random one-dimensional scenes with laws: the text of a model, and its matrices assembled by hand."""

from __future__ import annotations

import random
from dataclasses import dataclass, field

import numpy as np
from oracles.moreau import Scene

STOP = 2.0  # s, length of a run


@dataclass
class Drawn:
    """A scene that was drawn.

    Attributes
    ----------
    text : of the model
    scene : its matrices
    bodies : names of the bodies' variables: coordinate, velocity, acceleration
    unilateral, one_way, friction : names of the laws' forces in the order of the scene's rows, with the sign that makes
        them conjugate to the row
    parts : name of the part of each unilateral and one-way law
    """

    text: str
    scene: Scene
    bodies: list[tuple[str, str, str]]
    unilateral: list[tuple[str, float]]
    one_way: list[tuple[str, float]]
    friction: list[tuple[str, float]]
    parts: list[str] = field(default_factory=list)


class _Draw:
    """A scene under construction."""

    def __init__(self, seed: int, plastic: bool) -> None:
        self.dice, self.plastic = random.Random(seed), plastic
        dice = self.dice
        self.turns = [dice.random() < 0.35 for _ in range(dice.randint(1, 5))]
        n = self.n = len(self.turns)
        self.lines: list[str] = []
        self.joins: list[str] = []
        self.count = 0
        self.mass = np.array([self.number(0.2, 3) for _ in range(n)])
        self.q, self.v = np.zeros(n), np.zeros(n)
        self.stiffness, self.damping, self.rest = np.zeros((n, n)), np.zeros((n, n)), np.zeros(n)
        self.constant, self.swing, self.speed = np.zeros(n), np.zeros(n), np.ones(n)
        self.bilateral: list[np.ndarray] = []
        self.gaps: list[tuple[np.ndarray, float, float]] = []
        self.ways: list[np.ndarray] = []
        self.frictions: list[tuple[np.ndarray, float, float]] = []
        self.unilateral: list[tuple[str, float]] = []
        self.one_way: list[tuple[str, float]] = []
        self.friction: list[tuple[str, float]] = []
        self.parts: list[str] = []
        self.way_parts: list[str] = []

    def number(self, low: float, high: float) -> float:
        return round(self.dice.uniform(low, high), self.dice.choice((0, 1, 2, 2))) or low

    def part(self, kind: str, modifiers: str, *ends: tuple[str, str]) -> str:
        """Add a part with its connections (port, place)."""
        self.count += 1
        name = f"e{self.count}"
        self.lines.append(f"  {kind} {name}({modifiers});")
        self.joins += [f"  connect({name}.{port}, {place});" for port, place in ends]
        return name

    def port(self, body: int, turning: bool) -> str:
        """Return a body's port; −1 is the ground."""
        if body < 0:
            return "pole.shaft" if turning else "wall.flange"
        return f"b{body}.shaft" if turning else f"b{body}.flange"

    def row(self, a: int, b: int, factor_a: float = -1.0, factor_b: float = 1.0) -> np.ndarray:
        row = np.zeros(self.n)
        if a >= 0:
            row[a] += factor_a
        if b >= 0:
            row[b] += factor_b
        return row

    # ------------------------------------------------------------------------ parts

    def body(self, k: int, dependent: bool) -> None:
        """Write a body, with its start where that does not follow from others, and perhaps a force on it."""
        turning = self.turns[k]
        place, rate = ("theta", "omega") if turning else ("q", "v")
        start = ""
        if not dependent:
            values = ((place, self.q[k]), (rate, self.v[k]))
            start = "".join(f", {name}(start = {float(value)!r}, fixed = true)" for name, value in values)
        size = float(self.mass[k])
        self.lines.append(f"  Inertia b{k}(J = {size!r}{start});" if turning else f"  Mass b{k}(m = {size!r}{start});")
        if self.dice.random() < 0.7:
            parts = self.number(-8, 8), self.dice.choice((0.0, self.number(0, 10))), self.number(1, 9)
            self.constant[k], self.swing[k], self.speed[k] = parts
            load = "{!r} + {!r}*sin({!r}*time)".format(*parts)
            if turning:
                self.part("Torque", f"tau = {load}", ("shaft", self.port(k, True)))
            else:
                self.part("Force", f"f = {load}", ("flange", self.port(k, False)))

    def coupled(self, a: int, b: int) -> int:
        """Join two bodies by a gear, a drum or a rod; return the body whose start then follows from the other's."""
        ratio = self.dice.choice((-1, 1)) * self.number(0.5, 2)
        if not (self.turns[a] or self.turns[b]):  # b.q = a.q + L
            row = self.row(a, b)
            self.part("Rod", f"L = {float(row @ self.q)!r}", ("a", self.port(a, False)), ("b", self.port(b, False)))
            self.v[a] = self.v[b]
            self.bilateral.append(row)
            return a
        if self.turns[a] and self.turns[b]:  # a.theta = N·b.theta
            self.part("Gear", f"N = {ratio!r}", ("a", self.port(a, True)), ("b", self.port(b, True)))
        else:  # flange.q = r·shaft.theta
            a, b = (a, b) if self.turns[b] else (b, a)
            self.part("Drum", f"r = {ratio!r}", ("shaft", self.port(b, True)), ("flange", self.port(a, False)))
        self.q[a], self.v[a] = ratio * self.q[b], ratio * self.v[b]
        self.bilateral.append(self.row(a, b, 1.0, -ratio))
        return a

    def element(self, a: int, b: int, turning: bool) -> None:
        dice, row = self.dice, self.row(a, b)
        ends = ("a", self.port(a, turning)), ("b", self.port(b, turning))
        extent = float(row @ self.q)
        kinds = "spring damper friction friction".split()
        kinds += "clutch backlash ratchet".split() if turning else "cable stop cable stop".split()
        kind = dice.choice(kinds)
        if kind == "spring":
            k, length = self.number(5, 100), self.number(-1, 1)
            if turning:
                self.part("TorsionSpring", f"k = {k!r}, theta0 = {length!r}", *ends)
            else:
                self.part("Spring", f"k = {k!r}, L = 0, d0 = {length!r}", *ends)
            self.stiffness += k * np.outer(row, row)
            self.rest += k * length * row
        elif kind == "damper":
            c = self.number(0.1, 4)
            self.part("TorsionDamper" if turning else "Damper", f"c = {c!r}", *ends)
            self.damping += c * np.outer(row, row)
        elif kind in ("friction", "clutch"):
            slip = self.number(0.2, 6)
            stick = slip if dice.random() < 0.7 else slip * 1.5
            limits = f"tau = {slip!r}, tauStick = {stick!r}" if turning else f"F = {slip!r}, Fstick = {stick!r}"
            name = {"clutch": "Clutch", "friction": "BearingFriction" if turning else "DryFriction"}[kind]
            part = self.part(name, limits, *ends)
            self.frictions.append((row, slip, stick))
            self.friction.append((f"{part}.torque" if turning else f"{part}.f", -1.0))
        elif kind in ("cable", "stop"):
            sign = -1.0 if kind == "cable" else 1.0
            spare = dice.choice((self.number(0, 0.5), self.number(0, 0.5), 0.0))
            if kind == "cable" and extent + spare < 0.0:
                a, b, row, extent, ends = b, a, -row, -extent, (("a", ends[1][1]), ("b", ends[0][1]))
            length = extent - sign * spare
            e = 0.0 if self.plastic else dice.choice((0.0, 0.5, 0.8, 1.0))
            part = self.part(kind.capitalize(), f"L = {length!r}, e = {e!r}", *ends)
            self.gaps.append((sign * row, -sign * length, e))
            self.unilateral.append((f"{part}.f", -sign))
            self.parts.append(part)
        elif kind == "backlash":
            ratio = self.dice.choice((-1, 1)) * self.number(0.5, 2)
            delta = self.row(a, b, 1.0, -ratio)
            room = 2 * abs(float(delta @ self.q)) + self.number(0, 1)
            e = 0.0 if self.plastic else dice.choice((0.0, 0.5))
            part = self.part("Backlash", f"N = {ratio!r}, clearance = {room!r}, e = {e!r}", *ends)
            for sign, name in ((-1.0, "front"), (1.0, "back")):
                self.gaps.append((sign * delta, room / 2, e))
                self.unilateral.append((f"{part}.{name}", 1.0))
                self.parts.append(part)
        else:  # ratchet
            part = self.part("Ratchet", "", *ends)
            self.ways.append(row)
            self.one_way.append((f"{part}.tau", -1.0))
            self.way_parts.append(part)

    # ------------------------------------------------------------------------ the whole

    def scene(self) -> Drawn:
        dice, n = self.dice, self.n
        for k in range(n):
            self.q[k], self.v[k] = self.number(-1, 1), dice.choice((0.0, self.number(-3, 3)))
        order = dice.sample(range(n), n)
        pairs = zip(order[::2], order[1::2])
        dependent = {self.coupled(a, b) for a, b in list(pairs)[: dice.choice((0, 0, 1, 1, 2))]}
        for k in range(n):
            self.body(k, k in dependent)
        for _ in range(dice.randint(n, 2 * n + 1)):
            turning = dice.choice(self.turns)
            a, b = dice.sample([-1, *(k for k in range(n) if self.turns[k] == turning)], 2)
            if not any(row[a] and row[b] for row in self.bilateral if min(a, b) >= 0):
                self.element(a, b, turning)
        lines = ["model Random", "  Fixed wall;", "  FixedShaft pole;", *self.lines, "equation", *self.joins]
        kinds = (("q", "v", "a"), ("theta", "omega", "alpha"))
        names = [tuple(f"b{k}.{name}" for name in kinds[turning]) for k, turning in enumerate(self.turns)]
        parts = self.parts + self.way_parts
        text = "\n".join([*lines, "end Random;"])
        return Drawn(text, self.matrices(), names, self.unilateral, self.one_way, self.friction, parts)

    def matrices(self) -> Scene:
        n = self.n

        def rows(found: list[np.ndarray]) -> np.ndarray:
            return np.array(found, float).reshape(-1, n)

        def column(table: list, k: int) -> np.ndarray:
            return np.array([entry[k] for entry in table], float)

        constant, swing, speed = self.constant, self.swing, self.speed
        return Scene(
            self.mass, self.stiffness, self.damping, self.rest, lambda t: constant + swing * np.sin(speed * t),
            rows(self.bilateral), rows([g[0] for g in self.gaps]), column(self.gaps, 1), column(self.gaps, 2),
            rows(self.ways), rows([f[0] for f in self.frictions]), column(self.frictions, 1), column(self.frictions, 2),
            self.q, self.v,
        )  # fmt: skip


def draw(seed: int, plastic: bool = False) -> Drawn:
    """Return a random scene; `plastic` without restitution."""
    return _Draw(seed, plastic).scene()
