"""Loads on a rope around a drum that a torque accelerates, from event to event in closed form."""

from __future__ import annotations

import numpy as np

from lmoc.support.records import dataclass

REST = 1e-13  # m, the height of a bounce that ends


@dataclass(frozen=True)
class Winch:
    """A load above a floor, on a rope around a drum; q points downwards, and the rope holds the load at r·theta.

    Attributes
    ----------
    inertia, radius : of the drum, kg·m², m
    mass, gravity, floor, bounce : of the load, and of what it stands on
    until, torque : (n,) s, N·m: the torque on the drum is constant up to each of these times; positive pays out
    out, speed : m, m/s: how far the rope reaches at the start, and the rate of that
    """

    inertia: float
    radius: float
    mass: float
    gravity: float
    floor: float
    bounce: float
    until: tuple[float, ...]
    torque: tuple[float, ...]
    out: float
    speed: float

    def text(self) -> str:
        """Return the scene; the load begins at rest on the floor, the rope is slack."""
        tau = repr(self.torque[-1])
        for end, value in zip(self.until[-2::-1], self.torque[-2::-1]):
            tau = f"if time < {end!r} then {value!r} else {tau}"
        theta, omega = self.out / self.radius, self.speed / self.radius
        start = f"theta(start = {theta!r}, fixed = true), omega(start = {omega!r}, fixed = true)"
        return f"""model Winch Torque motor(tau = {tau}); Inertia wheel(J = {self.inertia!r}, {start});
          StringDrum rope(r = {self.radius!r});
          Fixed bottom(q0 = {self.floor!r}); Stop ground(L = 0, e = {self.bounce!r});
          Mass load(m = {self.mass!r}, g = {self.gravity!r}, q(start = {self.floor!r}, fixed = true),
            v(start = 0, fixed = true));
        equation connect(motor.shaft, wheel.shaft); connect(wheel.shaft, rope.shaft);
          connect(rope.flange, load.flange); connect(load.flange, ground.a); connect(ground.b, bottom.flange);
        end Winch;"""

    def events(self, apart: float = 1e-3) -> tuple[list[tuple[float, str]], float, float]:
        """Return (s, "taut" | "slack") of the rope, until when these are told apart, and where the load is then.

        Parameters
        ----------
        apart : s, events nearer to each other than that are not followed
        """
        state = _State(self, 0.0, self.out, self.speed, self.floor, 0.0)
        found: list[tuple[float, str]] = []
        latest = -np.inf
        for end, torque in zip(self.until, self.torque):
            state.torque = torque
            if state.mode == "taut" and state.tension <= 0.0:
                found.append((state.t, "slack"))
                state.mode = "fall"
            while state.t < end:
                step, what = state.ahead()
                if state.t + step >= end:
                    state.move(end - state.t)
                    state.t = end
                    break
                if what != "floor" or state.mode == "taut":
                    if state.t + step - latest < apart:
                        return found, state.t, state.q
                    latest = state.t + step
                state.move(step)
                if not state.meet(what, found):
                    return found, state.t, state.q
        return found, state.t, state.q


class _State:
    """Where the rope's end (h, u) and the load (q, v) are, and whether it rests, falls, or hangs ("taut")."""

    def __init__(self, winch: Winch, t: float, h: float, u: float, q: float, v: float) -> None:
        self.winch, self.t, self.h, self.u, self.q, self.v = winch, t, h, u, q, v
        self.mode, self.torque = "rest", 0.0

    @property
    def accelerations(self) -> tuple[float, float]:
        """Of the rope's end and of the load."""
        w = self.winch
        if self.mode == "taut":
            both = (self.torque / w.radius + w.mass * w.gravity) / (w.inertia / w.radius**2 + w.mass)
            return both, both
        return self.torque * w.radius / w.inertia, 0.0 if self.mode == "rest" else w.gravity

    @property
    def tension(self) -> float:
        """Of a taut rope, N."""
        return self.winch.mass * (self.winch.gravity - self.accelerations[1])

    def ahead(self) -> tuple[float, str]:
        """Return when something happens, in seconds from now, and what."""
        a, b = self.accelerations
        found = []
        if self.mode != "taut":
            found.append((_first(self.h - self.q, self.u - self.v, a - b), "taut"))
        if self.mode != "rest":
            found.append((_first(self.winch.floor - self.q, -self.v, -b), "floor"))
        return min(found)

    def move(self, step: float) -> None:
        a, b = self.accelerations
        self.h, self.u = self.h + self.u * step + a * step**2 / 2, self.u + a * step
        self.q, self.v = self.q + self.v * step + b * step**2 / 2, self.v + b * step
        self.t += step

    def meet(self, what: str, found: list[tuple[float, str]]) -> bool:
        """Take what happens; False where nobody can say how it goes on without a closer look."""
        w = self.winch
        if what == "floor":
            if self.mode == "taut":
                found.append((self.t, "slack"))
            self.q, self.v = w.floor, -w.bounce * self.v
            self.mode = "fall"
            if self.v**2 / (2 * w.gravity) < REST:
                self.mode, self.v = "rest", 0.0
            return True
        drum = w.inertia / w.radius**2
        self.u = self.v = (drum * self.u + w.mass * self.v) / (drum + w.mass)
        self.h = self.q
        self.mode = "taut"
        found.append((self.t, "taut"))
        return self.tension > 0.0 and (self.q < w.floor or self.v < 0.0)


def _first(gap: float, rate: float, acceleration: float) -> float:
    """Return when ``gap + rate·s + acceleration·s²/2`` passes below zero, after now; infinity where it does not."""
    gap = max(gap, 0.0)
    if abs(acceleration) < 1e-14:
        return gap / -rate if rate < 0 else np.inf
    under = rate**2 - 2 * acceleration * gap
    if under < 0:
        return np.inf
    root = np.sqrt(under)
    times = [(-rate - root) / acceleration, (-rate + root) / acceleration]
    falling = [s for s in times if s > 1e-12 and rate + acceleration * s < 0]
    return float(min(falling, default=0.0 if gap == 0.0 and rate < 0 else np.inf))


def draw(rng: np.random.Generator) -> Winch:
    """Return a random winch: its torque changes up to twice."""
    ends = np.sort(rng.uniform(0.3, 3.5, rng.integers(0, 3))).tolist()
    radius, mass, gravity = float(rng.uniform(0.1, 0.4)), float(rng.uniform(0.5, 5)), float(rng.uniform(4, 12))
    weight = radius * mass * gravity
    floor = float(rng.uniform(0.2, 1.0))
    bounce = float(rng.choice([0.0, rng.uniform(0.05, 0.8)]))
    torque = tuple(float(weight * rng.uniform(-2, 0.7)) for _ in range(len(ends) + 1))
    inertia = float(mass * radius**2 * rng.uniform(0.2, 5))
    out, speed = floor + float(rng.uniform(0.02, 0.5)), float(rng.uniform(-1, 1))
    return Winch(inertia, radius, mass, gravity, floor, bounce, (*ends, 4.0), torque, out, speed)
