"""Loads that ropes lift from a floor and set down again, and what they do, from event to event by hand."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lmoc.support.records import dataclass

WINDLASS = """
model Windlass "A windlass lowers a load onto the floor; the rope goes slack, then it is lifted again"
  Inertia drumInertia(J = 0.5);
  Rotation crankAngle(theta = 6*sin(0.8*time));
  StringDrum drum(r = 0.1);
  Mass load(m = 20, g = 9.81, q(start = 0, fixed = true), v(start = 0, fixed = true));
  Fixed bottom(q0 = 0.4);
  Stop ground(L = 0, e = 0.2);
equation
  connect(crankAngle.shaft, drumInertia.shaft);
  connect(drumInertia.shaft, drum.shaft);
  connect(drum.flange, load.flange);
  connect(load.flange, ground.a);
  connect(ground.b, bottom.flange);
  annotation(experiment(StopTime = 10));
end Windlass;
"""

Motion = Callable[[np.ndarray], np.ndarray]
_GRID = 4001  # places at which a motion is looked at


@dataclass(frozen=True)
class Lift:
    """A load below a hand on a rope, above a floor; q points downwards.

    Attributes
    ----------
    hand, speed, acceleration : of the rope's upper end, less its length: where a taut rope holds the load
    floor : m, where the load rests
    gravity : m/s²
    bounce : restitution of the floor; the rope has none
    """

    hand: Motion
    speed: Motion
    acceleration: Motion
    floor: float
    gravity: float
    bounce: float


def lifted(lift: Lift, q: float, v: float, stop: float) -> list[tuple[float, str]]:
    """Return what happens until a time, (s, "taut" | "slack" | "impact" | "rest" | "release"), from event to event.

    The load falls freely, rests on the floor, or follows the rope. A bounce lower than 1e-13 m ends at rest.
    """
    t, found, state = 0.0, [], "rest" if q == lift.floor and v == 0.0 else "fall"
    while True:
        if state == "taut":  # until the rope would have to push, or the load is on the floor
            ahead = np.linspace(t, stop, _GRID)
            push = _first(lambda s: lift.gravity - lift.acceleration(s), ahead)
            down = _first(lambda s: lift.floor - lift.hand(s), ahead, leaves=True)
            t, then = (down, "floor") if down <= push else (push, "fall")
            found.append((t, "slack"))
            q, v = (float(lift.hand(t)), float(lift.speed(t))) if t < stop else (q, v)
        elif state == "rest":
            t, then = _first(lambda s: lift.hand(s) - lift.floor, np.linspace(t, stop, _GRID), leaves=True), "taut"
            found += [(t, "taut"), (t, "release")]
        else:
            t, then, q, v = _fallen(lift, t, q, v, stop)
            found += [(t, "taut")] if then == "taut" else []
        if not t < stop:
            return [event for event in found if event[0] < stop]
        if then == "floor":
            v, q = -lift.bounce * v, lift.floor
            then = "rest" if v**2 / (2 * lift.gravity) < 1e-13 else "fall"
            found.append((t, "rest" if then == "rest" else "impact"))
        if then == "taut" and lift.acceleration(t) > lift.gravity:  # the hand comes down faster than the load can
            found[-2 if state == "rest" else -1] = (t, "impact")
            then, q, v = "fall", float(lift.hand(t)), float(lift.speed(t))
        state = then


def _fallen(lift: Lift, t: float, q: float, v: float, stop: float) -> tuple[float, str, float, float]:
    """Return when a free flight ends, at what ("floor" or "taut"), and where and how fast the load is there."""
    down = t + (np.sqrt(v**2 + 2 * lift.gravity * (lift.floor - q)) - v) / lift.gravity

    def place(s):
        return q + v * (s - t) + lift.gravity * (s - t) ** 2 / 2

    reach = _first(lambda s: lift.hand(s) - place(s), np.linspace(t, min(down, stop), _GRID), leaves=True)
    end = min(down, reach)
    return float(end), "taut" if reach < down else "floor", float(place(end)), v + lift.gravity * (end - t)


def _first(curve: Motion, times: np.ndarray, leaves: bool = False) -> float:
    """Return the first time at which a curve passes below zero; infinity where it does not.

    Parameters
    ----------
    leaves : what is below zero at once, before it has risen, is its rounding
    """
    values = curve(times) + 0.0 * times
    below = np.flatnonzero(values[1:] < 0.0) + 1
    if leaves:
        risen = np.flatnonzero(values > 1e-12)
        below = below[below > risen[0]] if len(risen) else below[:0]
    if not len(below):
        return np.inf
    low, high = times[below[0] - 1], times[below[0]]
    for _ in range(80):
        middle = (low + high) / 2
        low, high = (low, middle) if float(curve(middle)) < 0.0 else (middle, high)
    return float(high)


@dataclass(frozen=True)
class Scene:
    """A model, what it is for `lifted`, where its load begins at rest, and how it is run and read.

    Attributes
    ----------
    inputs : of the run
    place, sense : variable of the load's place, and 1 where it points downwards, as `Lift` counts
    """

    text: str
    lift: Lift
    first: float
    stop: float
    inputs: dict[str, object]
    place: str = "load.q"
    sense: int = 1


def draw(rng: np.random.Generator) -> Scene:
    """Return a random scene."""
    kind = rng.choice(["cosine", "two cosines", "polynomial", "table"])
    stop, floor, gravity = float(rng.uniform(3, 8)), float(rng.uniform(0.2, 1.0)), float(rng.uniform(4, 12))
    bounce = float(rng.choice([0.0, rng.uniform(0.05, 0.8)]))
    inputs: dict[str, object] = {}
    if kind == "polynomial":  # down and up again, or only one of both
        text, line = _parabola(rng, floor, stop)
    elif kind == "table":
        text, line, inputs["u"] = _table(rng, floor, stop)
    else:
        text, line = _cosines(rng, floor, 2 if kind == "two cosines" else 1)
    lift = Lift(line(0), line(1), line(2), floor, gravity, bounce)
    first = min(floor, float(lift.hand(0.0)) - 0.05)  # on the floor, or falling into the rope
    way = rng.choice(["hand", "length", "drum", "pulley", "reversed", "plane"])
    declared = "input Real u; " if inputs else ""
    if way == "plane":
        return Scene(_in_the_plane(declared, text, lift, first), lift, first, stop, inputs, "load.y", -1)
    return Scene(_text(way, declared, text, lift, first), lift, first, stop, inputs)


def _table(rng: np.random.Generator, floor: float, stop: float) -> tuple[str, Callable[[int], Motion], np.ndarray]:
    """Return the same of points, which are joined by a curve with two continuous derivatives; and the points."""
    from lmoc.numerics.signals.curves import fit

    count = int(rng.integers(4, 12))
    times = np.linspace(0.0, stop + 0.5, count) + np.concatenate([[0.0], rng.uniform(-0.1, 0.1, count - 1)])
    values = floor + rng.uniform(-0.5, 0.4, count)
    curve = fit(times, values, 2)

    return "u", lambda k: lambda s: curve(s, k), np.stack([times, values], axis=1)


def _parabola(rng: np.random.Generator, floor: float, stop: float) -> tuple[str, Callable[[int], Motion]]:
    """Return a formula of time, and its derivatives by their order."""
    top, turn, bend = float(rng.uniform(-0.5, 0.1)), float(rng.uniform(1, stop)), float(rng.uniform(0.02, 0.4))
    lines = (
        lambda s: floor + top + bend * (s - turn) ** 2,
        lambda s: 2 * bend * (s - turn),
        lambda s: 2 * bend + 0 * s,
    )
    return f"{floor + top!r} + {bend!r}*(time - {turn!r})^2", lambda k: lines[k]


def _cosines(rng: np.random.Generator, floor: float, count: int) -> tuple[str, Callable[[int], Motion]]:
    """Return the same of a sum of cosines."""
    limits = (0.1, 0.5), (0.5, 3.0), (0.0, 6.0)
    terms = [tuple(float(rng.uniform(*limit)) for limit in limits) for _ in range(count)]

    def line(k: int) -> Motion:
        middle = floor if k == 0 else 0.0
        return lambda s: middle + sum(A * w**k * np.cos(w * s + p + k * np.pi / 2) for A, w, p in terms)

    return " + ".join([repr(floor), *(f"{A!r}*cos({w!r}*time + {p!r})" for A, w, p in terms)]), line


def _text(way: str, inputs: str, hand: str, lift: Lift, first: float) -> str:
    """Return a scene whose rope, in one of several arrangements, ends at a given place where it is taut."""
    parts = {
        "hand": f"Motion hand(q = {hand}); Cable rope(L = 0);",
        "length": f"Motion hand(q = {hand} - 0.75); Cable rope(L = 0.75);",
        "drum": f"Rotation crank(theta = ({hand})/0.2); Inertia wheel(J = 0.3); StringDrum rope(r = 0.2);",
        "pulley": f"Motion hand(q = 2*({hand})); Fixed far; StringPulley rope(sense = -1);",
        "reversed": f"Motion hand(q = {hand}); Cable rope(L = 0);",
    }[way]
    links = {
        "drum": "connect(crank.shaft, wheel.shaft); connect(wheel.shaft, rope.shaft);"
        "connect(rope.flange, load.flange);",
        "pulley": "connect(hand.flange, rope.a); connect(far.flange, rope.b); connect(rope.axle, load.flange);",
    }.get(way, "connect(hand.flange, rope.a); connect(rope.b, load.flange);")
    load = f"Mass load(m = 3, g = {lift.gravity!r}, q(start = {first!r}, fixed = true), v(start = 0, fixed = true));"
    ground = f"Fixed bottom(q0 = {lift.floor!r}); Stop ground(L = 0, e = {lift.bounce!r});"
    held = "connect(load.flange, ground.a); connect(ground.b, bottom.flange);"
    declared = [load, ground, parts] if way == "reversed" else [parts, load, ground]
    return f"model Lifted {inputs}{' '.join(declared)}\nequation {links} {held} end Lifted;"


def _in_the_plane(inputs: str, hand: str, lift: Lift, first: float) -> str:
    """Return a scene in the plane: a particle on a cable below its other end, above a line that it meets."""
    return f"""model Lifted {inputs} import Planar.*; inner World world(g = {lift.gravity!r});
      Motion hand(x = 0.3, y = 20 - ({hand})); Cable rope(L = 20);
      Contact ground(d = {-lift.floor!r}, e = {lift.bounce!r});
      PointMass load(m = 3, x(start = 0.3, fixed = true), y(start = {-first!r}, fixed = true),
        vx(start = 0, fixed = true), vy(start = 0, fixed = true));
    equation connect(hand.point, rope.a); connect(rope.b, load.point); connect(load.point, ground.point); end Lifted;"""
