"""Balls above each other on a floor: random scenes, and their impacts from event to event in closed form."""

from __future__ import annotations

import numpy as np

from lmoc.support.records import dataclass

SIZE = 0.1  # m, of each ball
STACKED = """
model Stacked
  Mass a(m = 1, g = -9.81, q(start = 0.5, fixed = true), v(start = 0, fixed = true));
  Mass b(m = 1, g = -9.81, q(start = 1, fixed = true), v(start = 0, fixed = true));
  Stop s(L = 0.1, e = 1), t(L = 0.1, e = 0.5);
  Fixed w;
equation
  connect(w.flange, s.a); connect(s.b, a.flange); connect(a.flange, t.a); connect(t.b, b.flange);
end Stacked;
"""


@dataclass(frozen=True)
class Balls:
    """Balls above each other; a ceiling where it has a height.

    Attributes
    ----------
    masses, places, speeds : (n,) from below, places of their centres
    restitution : (n,) of the floor, and between each ball and the one below it
    gravity : m/s²
    ceiling : m, infinity without one
    hard : restitution of the ceiling
    """

    masses: np.ndarray
    places: np.ndarray
    speeds: np.ndarray
    restitution: np.ndarray
    gravity: float
    ceiling: float
    hard: float

    def text(self) -> str:
        """Return the model."""
        masses, places, speeds, e = (a.tolist() for a in (self.masses, self.places, self.speeds, self.restitution))
        n = len(masses)
        lines = [f"model Balls Fixed floor; Stop s0(L = {SIZE / 2}, e = {e[0]!r});"]
        links = ["connect(floor.flange, s0.a); connect(s0.b, m0.flange);"]
        for k in range(n):
            own = f"m = {masses[k]!r}, g = {-self.gravity!r}"
            state = f"q(start = {places[k]!r}, fixed = true), v(start = {speeds[k]!r}, fixed = true)"
            lines.append(f"Mass m{k}({own}, {state});")
            if k:
                lines.append(f"Stop s{k}(L = {SIZE}, e = {e[k]!r});")
                links.append(f"connect(m{k - 1}.flange, s{k}.a); connect(s{k}.b, m{k}.flange);")
        if np.isfinite(self.ceiling):
            lines.append(f"Fixed top(q0 = {self.ceiling!r}); Stop s{n}(L = {SIZE / 2}, e = {self.hard!r});")
            links.append(f"connect(m{n - 1}.flange, s{n}.a); connect(s{n}.b, top.flange);")
        return "\n".join([*lines, "equation", *links, "end Balls;"])

    def impacts(self, most: int, apart: float) -> list[tuple[float, int]]:
        """Return the first impacts (s, number of the stop), as long as they are farther apart than `apart` seconds.

        They end where two bodies stay together.
        """
        n, t, found = len(self.masses), 0.0, []
        q, v = self.places.astype(float).copy(), self.speeds.astype(float).copy()
        while len(found) < most:
            times = [_fall(q[0] - SIZE / 2, v[0], self.gravity)]
            for k in range(1, n):
                gap, rate = q[k] - q[k - 1] - SIZE, v[k] - v[k - 1]
                times.append(gap / -rate if rate < 0 else np.inf)
            if np.isfinite(self.ceiling):
                times.append(_rise(self.ceiling - SIZE / 2 - q[-1], v[-1], self.gravity))
            order = np.argsort(times)
            k, step = int(order[0]), times[order[0]]
            if not np.isfinite(step) or step < apart or (len(order) > 1 and times[order[1]] - step < apart):
                break
            t += step
            q, v = q + v * step - self.gravity * step**2 / 2, v - self.gravity * step
            if k == 0:
                v[0] *= -self.restitution[0]
            elif k == n:
                v[-1] *= -self.hard
            else:
                below, above = self.masses[k - 1], self.masses[k]
                impulse = (1 + self.restitution[k]) * (v[k - 1] - v[k]) * below * above / (below + above)
                v[k - 1] -= impulse / below
                v[k] += impulse / above
            found.append((t, k))
            if [*self.restitution, self.hard][k] == 0.0:  # what follows is no free flight
                break
        return found


def _fall(height: float, speed: float, gravity: float) -> float:
    if gravity == 0.0:
        return height / -speed if speed < 0 else np.inf
    return float((speed + np.sqrt(speed**2 + 2 * gravity * height)) / gravity)


def _rise(height: float, speed: float, gravity: float) -> float:
    rest = speed**2 - 2 * gravity * height
    if speed <= 0 or rest < 0:
        return np.inf
    return float(2 * height / (speed + np.sqrt(rest)))


def draw(rng: np.random.Generator) -> Balls:
    """Return a random scene; a third of the restitutions are 1, some 0."""
    n = int(rng.integers(1, 4))
    gaps = rng.uniform(0.02, 0.8, n)
    places = SIZE / 2 + np.cumsum(gaps) + SIZE * np.arange(n)

    def restitution(count: int) -> np.ndarray:
        return rng.choice([0.0, 1.0, 1.0, *rng.uniform(0.05, 0.98, 3)], count)

    gravity = float(rng.choice([0.0, 9.81, 9.81, rng.uniform(1, 20)]))
    low = gravity == 0.0 or rng.random() < 0.3
    ceiling = float(places[-1] + rng.uniform(0.1, 1.0)) if low else np.inf
    speeds = rng.uniform(-1, 1, n) * (1.0 if gravity == 0.0 else rng.choice([0.0, 1.0]))
    return Balls(rng.uniform(0.2, 3.0, n), places, speeds, restitution(n), gravity, ceiling, float(restitution(1)[0]))
