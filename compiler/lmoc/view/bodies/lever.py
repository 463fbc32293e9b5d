"""The free body of a lever: its bar with the forces at its points, the torques on its shaft, and the pivot's reaction.

The bar lies as in the picture of the scene: upright, with forces to the sides, or level, with forces up and down. Where
the sine of its angle is not taken as the angle it is inclined, and forces keep the directions of their lines.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import cos, degrees, hypot, isfinite, pi, radians, sin

from lmoc.support.records import dataclass
from lmoc.view.bodies.balance import Balance, Force, Loaded
from lmoc.view.scene import symbols
from lmoc.view.scene.names import shortened
from lmoc.view.scene.picture import Anchor, Circle, Item, Path, Point
from lmoc.view.scene.placing import Wish, placed_labels
from lmoc.view.scene.strip import RIGHT, UP, Direction

LONGEST = 170.0  # px, the longer arm
NEAREST = 40.0  # px, from the pivot to a point, and from one to the next
INCLINED = 0.45  # rad, of a bar whose angle is not given
REACTION = 46.0  # px, of an arrow without a value
BESIDE = 14.0  # px, between arrows on one side of a point
ANGLE = 30.0  # px, radius of the arc that shows the angle
SHAFT = 46.0  # px, radius of the arrows of torques


@dataclass(frozen=True)
class Writing:
    """The texts of a diagram, and the lengths of its arrows.

    Attributes
    ----------
    force, torque : from a force to its text
    length : from a force to the length of its arrow, px; negative where it points against its sense
    turning : from a torque to the angle that its arrow spans, rad; negative where it points against its sense
    name : of the body
    coordinate : symbol of the angle
    """

    force: Callable[[Force], str]
    torque: Callable[[Force], str]
    length: Callable[[Force], float]
    turning: Callable[[Force], float]
    name: str
    coordinate: str


def draw_bar(
    balance: Balance, directions: Mapping[int, Direction], writing: Writing, angle: float | None = None
) -> list[Item]:
    """Return the bar of a body that turns with levers, with everything that acts on it; the pivot is at (0, 0).

    Parameters
    ----------
    directions : {node: direction of its coordinate in the picture}
    angle : of the body at the instant that is shown, rad; None: not known
    """
    points = balance.points
    ways = [directions.get(p.node, RIGHT) for p in points]
    level = any(way != RIGHT for way in ways)
    small = all(p.small for p in points)
    turned = 0.0 if small else angle if angle is not None and isfinite(angle) else INCLINED
    # as in the picture of the scene: positive arms point downwards, or to where the point rises with the angle
    base = 0.0 if level else -pi / 2
    signs = [-1.0 if level and way not in (UP, RIGHT) else 1.0 for way in ways]
    ways = [UP if level and way == RIGHT else way for way in ways]
    along = cos(base + turned), -sin(base + turned)
    reaches = _reaches([s * p.arm for s, p in zip(signs, points)])
    places = [(r * along[0], r * along[1]) for r in reaches]
    part = balance.body.name
    low, high = min(0.0, *reaches), max(0.0, *reaches)
    ends = [(low * along[0], low * along[1]), (high * along[0], high * along[1])]
    items = [Item("lever", part, (Anchor(0, 0),), (symbols.path(*ends, width=5.0),))]
    items += [Item("joint", part, (Anchor(*p),), (Circle((0, 0, 0), 3.0, "paper"),)) for p in (*places, (0.0, 0.0))]
    wishes = [Wish(writing.name, Anchor(*_middle(reaches, along)), part, 16.0)]
    for point, way, place in zip(points, ways, places):
        _pulls(point, way, place, along, writing, items, wishes)
    _reaction(points, UP if level else RIGHT, items, wishes)
    _angle(base, turned, writing.coordinate, items, wishes)
    levers = {p.lever for p in points}
    _torques([f for f in balance.forces if f.part not in levers], base, writing, items, wishes)
    return [*items, *placed_labels(items, wishes)]


def _reaches(arms: list[float]) -> list[float]:
    """Pixels from the pivot to each point along the bar: to scale, unless points would lie too close together."""
    scale = LONGEST / max(map(abs, arms))
    found = [0.0] * len(arms)
    for side in (1.0, -1.0):
        last, at = 0.0, 0.0
        for length, k in sorted((side * arm, k) for k, arm in enumerate(arms) if side * arm > 0):
            at = at if length == last else max(length * scale, at + NEAREST)
            found[k], last = side * at, length
    return found


def _middle(reaches: list[float], along: Point) -> Point:
    """The middle of the longest piece of the bar without a point, where its name has room."""
    stops = sorted((0.0, *reaches))
    a, b = max(zip(stops, stops[1:]), key=lambda piece: piece[1] - piece[0])
    return (a + b) / 2 * along[0], (a + b) / 2 * along[1]


def _pulls(
    point: Loaded, way: Direction, at: Point, along: Point, writing: Writing, items: list[Item], wishes: list[Wish]
) -> None:
    """Add the forces at one point, those on one side beside each other."""
    for side in (1, -1):
        own = [f for f in point.forces if f.sense == side]
        for k, force in enumerate(own):
            beside = (k - (len(own) - 1) / 2) * BESIDE
            x, y = at[0] + beside * along[0], at[1] + beside * along[1]
            _arrow(force.part, (x, y), (side * way[0], side * way[1]), writing.length(force), items)
            room = abs(writing.length(force))
            tip = Anchor(x + side * way[0] * room, y + side * way[1] * room)
            wishes.append(Wish(writing.force(force), tip, force.part, 9.0, "force"))


def _arrow(part: str, at: Point, way: Direction, length: float, items: list[Item]) -> None:
    """Add an arrow that leaves the bar; where its length is negative it points to the bar."""
    tip = abs(length) * way[0], abs(length) * way[1]
    if hypot(*tip) > 0:
        ends = ((0.0, 0.0), tip) if length > 0 else (tip, (0.0, 0.0))
        items.append(symbols.arrow("force", part, Anchor(*at), *ends, "force", 2.0))


def _reaction(points: tuple[Loaded, ...], way: Direction, items: list[Item], wishes: list[Wish]) -> None:
    """Add the force of the pivot: its size would need the centre of mass, which no model of a line has."""
    lever = points[0].lever
    tip = REACTION * way[0], REACTION * way[1]
    items.append(symbols.arrow("reaction", lever, Anchor(0, 0), (0.0, 0.0), tip, "force", 2.0))
    name = f"R_{{{shortened(lever)}}}" if "{" not in lever and "}" not in lever else "R"
    wishes.append(Wish(name, Anchor(*tip), lever, 9.0, "force"))


def _angle(base: float, turned: float, text: str, items: list[Item], wishes: list[Wish]) -> None:
    """Add the coordinate: the angle from the line of reference, or its sense where the bar lies there."""
    if abs(turned) > radians(2):
        tip = 90.0 * cos(base), -90.0 * sin(base)
        line = Path(((0.0, 0.0, 0.0), (0.0, *tip)), False, "", "muted", 1.0, (4.0, 4.0))
        items.append(Item("reference", "", (Anchor(0, 0),), (line,)))
        start, stop, radius = base, base + turned, 2 * ANGLE
    else:
        start, stop, radius = base + pi - 0.6, base + pi + 0.6, ANGLE
    items.append(symbols.turning_arrow("coordinate", "", Anchor(0, 0), radius, start, stop, "muted"))
    middle = (start + stop) / 2
    wishes.append(Wish(text, Anchor(radius * cos(middle), -radius * sin(middle)), "", 8.0, "muted"))


def _torques(forces: list[Force], base: float, writing: Writing, items: list[Item], wishes: list[Wish]) -> None:
    """Add what acts on the shaft itself, beginning on the side of the pivot that the reaction leaves free."""
    free = degrees(base) - 90 if base else -90.0
    for k, force in enumerate(forces):
        middle = radians(free + (0, 60, -60, 120)[k % 4])
        radius = SHAFT + 16.0 * (k // 4)
        span = force.sense * writing.turning(force)
        if span:
            ends = middle - span / 2, middle + span / 2
            items.append(symbols.turning_arrow("torque", force.part, Anchor(0, 0), radius, *ends, "force"))
        at = Anchor(radius * cos(middle), -radius * sin(middle))
        wishes.append(Wish(writing.torque(force), at, force.part, 9.0, "force"))
