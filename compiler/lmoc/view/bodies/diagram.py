"""Free-body diagrams drawn: each body cut out, its forces as arrows with their formulas, and the balance below.

Forces between two points pull at the body: their arrows point towards the part that exerts them, and the formula is the
tension. Other forces point along the coordinate where their formula adds, against it where it is subtracted.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from math import cos, hypot, isfinite, radians, sin
from typing import TYPE_CHECKING

from lmoc.support.records import dataclass
from lmoc.symbolic.notation import Formula, Notation, join_terms
from lmoc.view.bodies.balance import Balance, Force, FreeBodies
from lmoc.view.bodies.lever import Writing, draw_bar
from lmoc.view.bodies.writing import MARKED
from lmoc.view.scene import symbols
from lmoc.view.scene.block import Block, packed
from lmoc.view.scene.picture import Anchor, Circle, Item, Label
from lmoc.view.scene.strip import DOWN, RIGHT, UP, Direction, Style
from lmoc.view.scene.text import width

if TYPE_CHECKING:
    import sympy

LONG = 46.0  # px, of an arrow that is not to scale
LONGEST = 70.0  # px, of the largest force, where they are
ROW = 28.0
RADIUS = 34.0
WIDTH = 760.0


@dataclass(frozen=True)
class Numbers:
    """Forces as numbers at some instant.

    Attributes
    ----------
    of : from a force to its value along the arrow, N or N·m
    largest, largest_torque : of all of them
    angle : of a body that turns, rad
    """

    of: Callable[[Balance, Force], float]
    largest: float
    largest_torque: float
    angle: Callable[[Balance], float]


def draw_bodies(
    bodies: FreeBodies, style: Style, directions: Mapping[int, Direction], numbers: Numbers | None = None
) -> Block:
    """Return the diagrams side by side.

    Parameters
    ----------
    directions : {node: direction of its coordinate in the picture}
    """
    notation = bodies.notation()
    blocks = []
    for balance in bodies.balances:
        drawing = _Diagram(balance, notation, style, directions, numbers)
        blocks.append(drawing.block())
    return packed(blocks, WIDTH, 40.0)


def balance_text(balance: Balance, notation: Notation, coordinate: str) -> str:
    """Return ``m·q̈ = f − k·q − c·q̇``."""
    formula = Formula(notation, MARKED)
    left = f"{formula.product(balance.mass)}·{dotted(coordinate)}" if balance.mass != 0 else "0"
    terms = []
    for force in balance.forces:
        negative = bool(force.term.as_coeff_Mul()[0] < 0)
        terms.append((negative, term_text(balance, force, -force.term if negative else force.term, formula)))
    return f"{left} = {join_terms(sorted(terms, key=lambda t: t[0]), MARKED)}"


def term_text(balance: Balance, force: Force, value: sympy.Expr, formula: Formula) -> str:
    """A term of a balance; a weight begins with the mass, as people write it."""
    if force.part in {e.name for e in (balance.body, *balance.others)}:
        masses = (m for m in balance.mass.as_ordered_terms() if m.is_Symbol and value.has(m))
        for mass in masses:
            if not (value / mass).has(mass):
                return f"{formula.product(mass)}·{formula.product(value / mass)}"
    return formula.product(value)


def dotted(symbol: str) -> str:
    """The second derivative of a coordinate that is shown as `symbol`."""
    head, mark, tail = symbol.partition("_{")
    return f"{head}\u0308{mark}{tail}" if len(head) == 1 else f"{symbol}''"


class _Diagram:
    def __init__(
        self,
        balance: Balance,
        notation: Notation,
        style: Style,
        directions: Mapping[int, Direction],
        numbers: Numbers | None,
    ) -> None:
        self.balance, self.notation, self.style, self.numbers = balance, notation, style, numbers
        self.formula = Formula(notation, MARKED)
        self.directions, self.direction = directions, directions.get(balance.port.node, RIGHT)
        self.items: list[Item] = []
        inertia = "J" if balance.turns else "m"
        self.name = " + ".join(style.names.part(e, inertia) for e in (balance.body, *balance.others))
        self.radius = max(RADIUS, width(self.name, 13) / 2 + 8)
        self.coordinate = style.coordinates.get(balance.port.node, "q")

    def block(self) -> Block:
        if self.balance.points:
            self.items += draw_bar(self.balance, self.directions, self._writing(), self._angle_now())
        elif self.balance.turns:
            self._turning()
        elif self.direction == RIGHT:
            self._level()
        else:
            self._upright()
        block = Block(tuple(self.items))
        left, _, right, bottom = block.corners
        text = balance_text(self.balance, self.notation, self.coordinate)
        below = symbols.label(text, Anchor((left + right) / 2, bottom + 22), part=self.balance.body.name)
        return block.beside(Block((replace(below, symbol="balance"),)))

    # ------------------------------------------------------------------ arrows

    def _text(self, force: Force, unit: str = "") -> str:
        negative = bool(force.label.as_coeff_Mul()[0] < 0)
        text = term_text(self.balance, force, -force.label if negative else force.label, self.formula)
        text = MARKED.sign + text if negative else text
        if self.numbers is None:
            return text
        value = self.numbers.of(self.balance, force)
        unit = unit or ("N·m" if self.balance.turns else "N")
        return f"{text} = {value:.4g} {unit}".replace("= -", "= −") if isfinite(value) else f"{text} = ?"

    def _length(self, force: Force) -> float:
        """Length of an arrow, negative where it points the other way."""
        if self.numbers is None:
            return LONG
        value = self.numbers.of(self.balance, force)
        largest = self.numbers.largest
        return LONGEST * value / largest if isfinite(value) and largest > 0 else 0.0

    def _arrow(self, force: Force, at: tuple[float, float], way: Direction) -> None:
        """An arrow that leaves the body at a point; where its value is negative it points to the body."""
        length = self._length(force)
        tip = abs(length) * way[0], abs(length) * way[1]
        start, stop = ((0.0, 0.0), tip) if length >= 0 else (tip, (0.0, 0.0))
        if hypot(*tip) > 0:
            made = symbols.arrow("force", force.part, Anchor(*at), start, stop, "force", 2.0)
            self.items.append(made)
        room = max(abs(length), 4.0) + 6
        text = self._text(force)
        if way[1] == 0:
            anchor = "start" if way[0] > 0 else "end"
            made = symbols.label(text, Anchor(*at), room * way[0], 0, anchor, force.part, "force")
        else:
            made = symbols.label(text, Anchor(*at), 0, (room + 6) * way[1], "middle", force.part, "force")
        self.items.append(made)

    def _sides(self) -> tuple[list[Force], list[Force]]:
        """Forces against the coordinate, and along it."""
        forces = self.balance.forces
        return [f for f in forces if f.sense < 0], [f for f in forces if f.sense > 0]

    def _level(self) -> None:
        back, on = self._sides()
        half = max(24.0, width(self.name, 13) / 2 + 9)
        tall = max(22.0, ROW * max(len(back), len(on)) / 2 + 4)
        self.items.append(self._box(half, tall))
        for forces, side in ((back, -1.0), (on, 1.0)):
            for k, force in enumerate(forces):
                y = (k - (len(forces) - 1) / 2) * ROW
                self._arrow(force, (side * half, y), (side, 0.0))
        self._coordinate((0.0, -tall), RIGHT)

    def _upright(self) -> None:
        back, on = self._sides()
        up, down = (on, back) if self.direction == UP else (back, on)
        half = max(30.0, width(self.name, 13) / 2 + 9)
        rows = []
        for forces in (up, down):
            wide = [max(26.0, width(self._text(f), 13) + 14) for f in forces]
            places = [sum(wide[:k]) + w / 2 - sum(wide) / 2 for k, w in enumerate(wide)]
            rows.append((forces, places))
            half = max([half, *(abs(x) + 12.0 for x in places)])
        self.items.append(self._box(half, 22.0))
        for (forces, places), way in zip(rows, (UP, DOWN)):
            for force, x in zip(forces, places):
                self._arrow(force, (x, 22.0 * way[1]), way)
        self._coordinate((-half, 0.0), self.direction)

    def _box(self, half: float, tall: float) -> Item:
        return symbols.box("mass", self.balance.body.name, Anchor(0, 0), (-half, -tall, half, tall), self.name)

    def _coordinate(self, at: tuple[float, float], way: Direction) -> None:
        if way == RIGHT:
            label = Label(self.coordinate, (0, 40, -14), "start", colour="muted")
            made = symbols.arrow("coordinate", "", Anchor(*at), (0, -14), (34, -14), "muted", 1.2, (label,))
        else:
            label = Label(self.coordinate, (0, -14, way[1] * 24), "end", colour="muted")
            tail, tip = (-8.0, -way[1] * 16), (-8.0, way[1] * 18)
            made = symbols.arrow("coordinate", "", Anchor(*at), tail, tip, "muted", 1.2, (label,))
        self.items.append(made)

    # ------------------------------------------------------------------ torques

    def _turning(self) -> None:
        forces = self.balance.forces
        disk = (Circle((0.0, 0.0, 0.0), self.radius, "body"), Label(self.name, (0.0, 0.0, 4.0)))
        self.items.append(Item("disk", self.balance.body.name, (Anchor(0, 0),), disk))
        own = symbols.turning_arrow("coordinate", "", Anchor(0, 0), self.radius - 9, radians(55), radians(125), "muted")
        label = Label(self.coordinate, (0.0, 0.0, -self.radius + 19.0), size=11.0, colour="muted")
        self.items.append(replace(own, shapes=(*own.shapes, label)))
        for k, force in enumerate(forces):
            middle = self._angle(k, len(forces))
            self._torque(force, middle)

    def _angle(self, k: int, n: int) -> float:
        """Degrees: torques are spread around, the first at the upper left."""
        spread: Sequence[float] = {1: (90,), 2: (180, 0), 3: (150, 30, 270), 4: (150, 30, 210, 330)}.get(n, ())
        return spread[k] if spread else 90 + 360 * k / n

    def _span(self, force: Force) -> float:
        """Half of what the arrow of a torque spans, degrees; negative where it points the other way."""
        if self.numbers is None:
            return 26.0
        value, largest = self.numbers.of(self.balance, force), self.numbers.largest_torque
        return 40.0 * value / largest if isfinite(value) and largest > 0 else 0.0

    def _torque(self, force: Force, middle: float) -> None:
        span, r = force.sense * self._span(force), self.radius + 11
        if span:
            a, b = radians(middle - span), radians(middle + span)
            self.items.append(symbols.turning_arrow("torque", force.part, Anchor(0, 0), r, a, b, "force"))
        t = radians(middle)
        anchor = "start" if cos(t) > 0.3 else "end" if cos(t) < -0.3 else "middle"
        x, y = (r + 9) * cos(t), -(r + 13) * sin(t)
        self.items.append(symbols.label(self._text(force), Anchor(0, 0), x, y, anchor, force.part, "force"))

    # ------------------------------------------------------------------ levers

    def _writing(self) -> Writing:
        def torque(force: Force) -> str:
            return self._text(force, "N·m")

        def force(force: Force) -> str:
            return self._text(force, "N")

        def turning(force: Force) -> float:
            return radians(2 * self._span(force))

        return Writing(force, torque, self._length, turning, self.name, self.coordinate)

    def _angle_now(self) -> float | None:
        return None if self.numbers is None else self.numbers.angle(self.balance)
