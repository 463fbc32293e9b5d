"""Ropes over pulleys and drums: columns that hang side by side, from one end of the rope to the other."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace

from lmoc.support.records import dataclass
from lmoc.view.scene import symbols
from lmoc.view.scene.block import Block
from lmoc.view.scene.elements import Element
from lmoc.view.scene.picture import Anchor, Item, Move, Path, Point
from lmoc.view.scene.strip import DOWN, GROUP, RIGHT, UP, Direction, DrawnStrip, Strip, Style
from lmoc.view.scene.strips import draw_strip
from lmoc.view.scene.symbols import arc
from lmoc.view.scene.wheels import Turning, decorated, wheel

LEAST_RADIUS = 24.0
FALL = 74.0  # from a joint to what hangs there
DEEP = 130.0  # from the upper pulleys to the lower ones
GAP = 16.0


@dataclass
class Joint:
    """A pulley, or a wheel with the drums on its shaft.

    Attributes
    ----------
    ends : nodes of the line that its ropes lead to, one or two
    axle : node of a pulley's axle; None for a wheel
    shaft : of a wheel
    below : a lower pulley, whose axle moves; its ropes go upwards
    hung : its axle hangs from the rope of another one
    """

    elements: tuple[Element, ...]
    ends: tuple[int, ...]
    axle: int | None = None
    shaft: Turning | None = None
    below: bool = False
    hung: bool = False


@dataclass
class Rope:
    """Joints from one end to the other, and the nodes before, between and after them.

    A node is None where the rope ends at a drum.
    """

    joints: list[Joint]
    nodes: list[int | None]


def rope_of(joints: Sequence[Joint]) -> Rope | None:
    """Return joints in the order of their rope; None where they are no single line."""
    at: dict[int, list[Joint]] = {}
    for joint in joints:
        for node in joint.ends:
            at.setdefault(node, []).append(joint)
    if any(len(found) > 2 for found in at.values()) or any(len(j.ends) > 2 for j in joints):
        return None

    def is_end(j: Joint) -> bool:
        return len(j.ends) == 1 or any(len(at[n]) == 1 for n in j.ends)

    start = next((j for j in joints if is_end(j)), None)
    if start is None:
        return None
    first = next((n for n in start.ends if len(at[n]) == 1), None) if len(start.ends) == 2 else None
    rope = Rope([], [first])
    joint, came = start, first
    while True:
        rope.joints.append(joint)
        onward = next((n for n in joint.ends if n != came), None)
        rope.nodes.append(onward)
        following = next((j for j in at.get(onward, ()) if j is not joint and j not in rope.joints), None)
        if following is None:
            break
        joint, came = following, onward
    return rope if len(rope.joints) == len(joints) else None


@dataclass
class Hanging:
    """The surroundings of ropes that their drawing depends on.

    Attributes
    ----------
    strips : {node: the strip it is in}
    walls : {node: the wall there}
    hung : {node: block that hangs there, its top in the middle at (0, 0)}, as of pulleys at a rope's end
    drawn : names of strips already drawn
    """

    strips: Mapping[int, Strip]
    walls: Mapping[int, Element]
    style: Style
    weights: Callable[[Strip], float]  # sign of gravity along +q; 0 where there is none
    hung: dict[int, Block] = field(default_factory=dict)
    used: set[int] = field(default_factory=set)  # identities of strips that are in the picture

    def hang(self, node: int) -> Block:
        """Return what hangs at a node, its top in the middle at (0, 0)."""
        if node in self.hung:
            return self.hung.pop(node)
        strip = self.strips.get(node)
        if strip is None or id(strip) in self.used or not self.shown(strip):
            return Block((), {node: (0.0, 0.0)})
        self.used.add(id(strip))
        drawn = self._hanging(strip, node)
        x, y = drawn.block.anchors[node]
        return drawn.block.at(-x, -y + drawn.reach[node])

    def shown(self, strip: Strip) -> bool:
        """Return whether there is anything to draw."""
        return bool(strip.links or any(strip.on[n] for n in strip.nodes))

    def _hanging(self, strip: Strip, node: int) -> DrawnStrip:
        flat, direction = draw_strip(strip, self.style, RIGHT), self.direction(node)
        ends = flat.is_first(node), flat.is_last(node)
        above, below = ends if direction == DOWN else ends[::-1]
        return draw_strip(strip, self.style, direction, below and not above)

    def beside(self, node: int, gap: float) -> Block | None:
        """Return a strip that lies on the left of a point and ends in it; None where it should hang."""
        strip = self.strips.get(node)
        if strip is None or id(strip) in self.used or self.weights(strip) or not strip.links:
            return None
        flat = draw_strip(strip, self.style, RIGHT)
        if not flat.is_last(node):
            return None
        self.used.add(id(strip))
        x, y = flat.block.anchors[node]
        return flat.block.at(-x - flat.reach[node] - gap, -y)

    def string(
        self,
        part: str,
        node: int | None,
        a: Point,
        b: Point,
        moved: int,
        direction: Direction | None = None,
        axle: int | None = None,
    ) -> Item:
        """A piece of rope; the end `moved` (0, 1, or -1 for none) moves with the node, along its line by default.

        Where it meets a pulley that moves, it does so with the node of the axle.
        """
        ends = [Anchor(*a), Anchor(*b)]
        mover = node if axle is None else axle
        variable = self.style.variables.get(mover)
        if variable and moved >= 0:
            dx, dy = direction or self.direction(mover)
            ends[moved] = Anchor(ends[moved].x, ends[moved].y, (Move(variable, dx, dy, None, GROUP),))
        made = symbols.line("string", part, ends[0], ends[1], 1.4, "string")
        met = () if node is None else (node, node)
        return replace(made, variables=self.style.names.slack(part), nodes=met)

    def direction(self, node: int) -> tuple[float, float]:
        strip = self.strips.get(node)
        gravity = self.weights(strip) if strip is not None else 0.0
        return DOWN if gravity > 0 else UP


def draw_rope(rope: Rope, hanging: Hanging) -> Block:
    """Return a rope with everything on it."""
    if len(rope.joints) == 1 and len(rope.joints[0].ends) == 2 and rope.joints[0].axle is not None:
        joint = rope.joints[0]
        for first, second in ((0, 1), (1, 0)):
            free = not joint.below and not joint.hung
            left = hanging.beside(joint.ends[first], LEAST_RADIUS + 40) if free else None
            if left is not None:
                return _around_a_corner(joint, joint.ends[first], joint.ends[second], left, hanging)
    return _side_by_side(rope, hanging)


def _around_a_corner(joint: Joint, level: int, hung: int, left: Block, hanging: Hanging) -> Block:
    """A rope that comes along a line and goes down over a pulley."""
    part, r = joint.elements[0].name, LEAST_RADIUS
    content = hanging.hang(hung)
    wide = -min(content.corners[0], 0.0) if content.items else 0.0
    r = max(r, min(60.0, wide - 8.0))
    met = (*joint.ends, joint.axle)
    items = [
        hanging.string(part, level, (-LEAST_RADIUS - 40, -r), (0, -r), 0, RIGHT),
        Item("string", part, (Anchor(0, 0),), (Path(arc(r, 1.5708, 0), colour="string", width=1.4),), nodes=met),
        hanging.string(part, hung, (r, 0), (r, FALL), 1),
        Item("bearing", part, (Anchor(0, 0),), (symbols.path((0, 0), (-r * 0.6, r + 14), width=2.0),)),
        symbols.wall("", Anchor(-r * 0.6, r + 14), (0, 1), -16, 16, "bearing"),
        replace(symbols.pulley(part, Anchor(0, 0), r), nodes=(joint.axle,)),
    ]
    block = Block(tuple(items)).beside(left.at(0, -r), content.at(r, FALL))
    return block


def _side_by_side(rope: Rope, hanging: Hanging) -> Block:
    joints, nodes = rope.joints, rope.nodes
    contents = [_content(n, k, rope, hanging) for k, n in enumerate(nodes)]
    loads: dict[int, Block] = {}
    for joint in joints:
        if joint.below and joint.axle not in loads:
            loads[joint.axle] = hanging.hang(joint.axle)
    x = _columns(joints, contents, loads)
    radius = [(x[k + 1] - x[k]) / 2 for k in range(len(joints))]
    ceiling = -max([r for r, j in zip(radius, joints) if not j.below] or [LEAST_RADIUS]) - 20
    depth = DEEP if any(j.below for j in joints) else 0.0
    block = Block(())
    for k, (joint, r) in enumerate(zip(joints, radius)):
        level = depth if joint.below else 0.0
        counted = _counted(joint, nodes[k], nodes[k + 1], hanging)
        block = block.beside(_joint(counted, r, ceiling, hanging, nodes[k + 1] is None).at(x[k] + r, level))
    items: list[Item] = []
    for k, node in enumerate(nodes):
        if node is None:
            continue
        before, after = joints[k - 1] if k else None, joints[k] if k < len(joints) else None
        part = _over(before or after, node).name
        tops = [0.0 for j in (before, after) if j is not None and not j.below]
        bottoms = [depth for j in (before, after) if j is not None and j.below]
        axle = next((j.axle for j in (before, after) if j is not None and j.below), None)
        if len(tops) == 1 and bottoms:
            items.append(hanging.string(part, node, (x[k], 0.0), (x[k], depth), 1, axle=axle))
        elif bottoms:
            top = ceiling if node in hanging.walls else 0.0
            items.append(hanging.string(part, node, (x[k], top), (x[k], depth), 1, axle=axle))
            block = block.beside(contents[k].at(x[k], top))
        else:
            items.append(hanging.string(part, node, (x[k], 0.0), (x[k], FALL), 1))
            block = block.beside(contents[k].at(x[k], FALL))
    for axle, load in loads.items():
        own = [(x[k] + radius[k], radius[k]) for k, j in enumerate(joints) if j.below and j.axle == axle]
        low = depth + max(r for _, r in own) + 12
        middle = sum(c for c, _ in own) / len(own)
        move = hanging.style.variables.get(axle)
        moves = (Move(move, *hanging.direction(axle), None, GROUP),) if move else ()
        for centre, _ in own:
            items.append(rod(axle, Anchor(centre, depth, moves), Anchor(centre, low, moves)))
        if len(own) > 1:
            items.append(rod(axle, Anchor(own[0][0], low, moves), Anchor(own[-1][0], low, moves), 3.0))
        items.append(rod(axle, Anchor(middle, low, moves), Anchor(middle, low + 14, moves)))
        block = block.beside(load.at(middle, low + 14))
    return Block(tuple(items)).beside(block)


def rod(node: int, a: Anchor, b: Anchor, thick: float = 2.0) -> Item:
    """A rod from an axle to what hangs there."""
    return replace(symbols.line("rod", "", a, b, thick), nodes=(node, node))


def _over(joint: Joint, node: int) -> Element:
    """The pulley or drum of a joint over which the rope at a node goes."""
    return next((e for e in joint.elements if any(p.node == node for p in e.ports)), joint.elements[0])


def _counted(joint: Joint, left: int | None, right: int | None, hanging: Hanging) -> Joint:
    """A wheel whose angle counts the way in which the ropes move: clockwise where the right one goes down with it."""
    if joint.shaft is None:
        return joint
    graph = hanging.style.names.graph
    for node, side in ((right, 1), (left, -1)):
        drum = next((e for e in joint.elements if node is not None and e.port("flange").node == node), None)
        if drum is not None:
            down = side * hanging.direction(node)[1] * graph.value(drum, "r", 1.0)  # y points downwards
            return replace(joint, shaft=replace(joint.shaft, sense=-1 if down > 0 else 1))
    return joint


def _content(node: int | None, k: int, rope: Rope, hanging: Hanging) -> Block:
    """Return the element that hangs at the end of a column, or holds it at its upper end."""
    if node is None:
        return Block(())
    around = [j for j in (rope.joints[k - 1] if k else None, rope.joints[k] if k < len(rope.joints) else None) if j]
    if all(j.below for j in around):
        strip = hanging.strips.get(node)
        if node in hanging.walls:
            return Block((symbols.wall(hanging.walls[node].name, Anchor(0, 0), (0, -1), -18, 18),), {node: (0, 0)})
        if strip is not None and id(strip) not in hanging.used and hanging.shown(strip):
            hanging.used.add(id(strip))
            flat = draw_strip(strip, hanging.style, RIGHT)
            drawn = draw_strip(strip, hanging.style, UP if flat.is_first(node) else DOWN)
            ax, ay = drawn.block.anchors[node]
            return drawn.block.at(-ax, -ay - drawn.reach[node])
        return Block((), {node: (0.0, 0.0)})
    if len(around) == 2:
        return Block((), {node: (0.0, 0.0)}) if any(j.below for j in around) else hanging.hang(node)
    return hanging.hang(node)


def _columns(joints: Sequence[Joint], contents: Sequence[Block], loads: Mapping[int, Block]) -> list[float]:
    """Places of the columns, such that nothing that hangs there overlaps."""

    def sides(block: Block) -> tuple[float, float]:
        if not block.items:
            return 0.0, 0.0
        left, _, right, _ = block.corners
        return max(0.0, -left), max(0.0, right)

    # what hangs from a lower pulley only, is above
    low = [c if any(not j.below for j in joints[max(0, i - 1) : i + 1]) else Block(()) for i, c in enumerate(contents)]
    x = [0.0]
    for k, joint in enumerate(joints):
        right_of, left_of = sides(low[k])[1], sides(low[k + 1])[0]
        need = max(2 * LEAST_RADIUS, right_of + GAP + left_of)
        if joint.below and joint.axle in loads:
            l, r = sides(loads[joint.axle])
            need = max(need, 2 * (l + right_of + GAP) if right_of else 0.0, 2 * (r + left_of + GAP) if left_of else 0.0)
        x.append(x[-1] + need)
    return x


def _joint(joint: Joint, radius: float, ceiling: float, hanging: Hanging, ends: bool) -> Block:
    """A wheel or a pulley at (0, 0), with its support; where the rope `ends` on it, it has come up on the left."""
    part = joint.elements[0].name
    over = (3.14159, 6.28318) if joint.below else (3.14159, 0.0)
    if len(joint.ends) == 1:
        over = (1.94159, 3.14159) if ends else (1.2, 0.0)
    rope = Path(arc(radius, *over), colour="string", width=1.4)
    met = joint.ends if joint.axle is None else (*joint.ends, joint.axle)
    string = Item("string", part, (Anchor(0, 0),), (rope,), nodes=met)
    if joint.shaft is not None:
        strings = [replace(string, part=e.name, nodes=tuple(p.node for p in e.ports)) for e in joint.elements]
        items, legs = decorated(joint.shaft, hanging.style, radius, False, held=True)
        return Block((*legs, *wheel(joint.shaft, hanging.style, [radius], False), *strings, *items))
    if joint.below:
        variable = hanging.style.variables.get(joint.axle)
        moves = (Move(variable, *hanging.direction(joint.axle), None, GROUP),) if variable else ()
        made = replace(symbols.pulley(part, Anchor(0, 0, moves), radius), nodes=(joint.axle,))
        return Block((made, replace(string, ends=(Anchor(0, 0, moves),))))
    stem = Item("bearing", part, (Anchor(0, 0),), (symbols.path((0, 0), (0, ceiling), width=2.0),), nodes=(joint.axle,))
    if joint.hung:
        return Block((symbols.pulley(part, Anchor(0, 0), radius), stem, string), {joint.axle: (0.0, ceiling)})
    hatch = symbols.wall("", Anchor(0, ceiling), (0, -1), -16, 16, "bearing")
    return Block((hatch, symbols.pulley(part, Anchor(0, 0), radius), stem, string))
