"""The schematic picture of what moves along lines and turns on shafts: strips, and the joints between them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import isfinite

from lmoc.view.scene import symbols
from lmoc.view.scene.arrange import strips_of
from lmoc.view.scene.belts import belts_of, draw_belt
from lmoc.view.scene.block import Block, packed, tangled
from lmoc.view.scene.differentials import WAYS, draw_differential, shaft_beside
from lmoc.view.scene.elements import Element, Graph, Port
from lmoc.view.scene.levers import draw_lever, draw_pendulum
from lmoc.view.scene.mounted import MOUNTED, draw_mounted, draw_unbalances
from lmoc.view.scene.names import Names
from lmoc.view.scene.picture import Anchor
from lmoc.view.scene.road import draw_road
from lmoc.view.scene.ropes import Hanging, Joint, Rope, draw_rope, rope_of
from lmoc.view.scene.strip import BODIES, DOWN, RIGHT, UP, Strip, Style
from lmoc.view.scene.strips import draw_strip
from lmoc.view.scene.wheels import Drum, Turning, decorated, gear_row, gears_of, turning, wheel
from lmoc.view.scene.wrap import draw_wrapped

WIDTH = 640.0  # px that a picture may take before its pieces go below each other
GAP = 34.0
ROPES, LEVERS = ("pulley", "drum"), ("lever", "arm", "beam")


def style_of(graph: Graph, names: Names) -> Style:
    """Return the names of the nodes: those of their coordinates, and of what moves them."""
    of_bodies: dict[int, list[int]] = {}  # the bodies' own coordinates, those of the first declared first …
    wanted: dict[int, list[int]] = {}  # … which are preferred to these
    variables: dict[int, str] = {}
    for element in graph.elements:
        for port in element.ports:
            if port.domain in ("line", "shaft"):
                wanted.setdefault(port.node, []).append(port.potentials[0])
                if element.symbol in BODIES:
                    own = [graph.variable(element, n) for n in ("q", "theta", "s", "phi")]
                    of_bodies.setdefault(port.node, []).extend([v for v in own if v is not None][:1])
                    variables[port.node] = graph.name(port)
                variables.setdefault(port.node, graph.name(port))
    bodies = {e.ports[0].node for e in graph.elements if e.symbol in BODIES}
    driven = {e.ports[0].node: e for e in graph.elements if e.symbol in ("motion", "rotation")}
    wanted = {n: [*of_bodies.get(n, ()), *vs] for n, vs in wanted.items()}
    shown = {n: tuple(vs) for n, vs in wanted.items() if n in bodies or n in driven or names.own(*vs)}
    for element in graph.elements:
        if element.symbol == "moving-frame":
            shown[-element.port("flange").node - 1] = (graph.variable(element, "q"),)
            variables[-element.port("flange").node - 1] = f"{element.name}.q"
    coordinates = names.coordinates(shown)
    for node, element in driven.items():
        coordinates[node] = names.signal(element, "q" if element.symbol == "motion" else "theta")
    return Style(names, coordinates, variables)


def gravity_of(strip: Strip, graph: Graph) -> float:
    """Return the sign of gravity along +q: that of the first body on which it acts."""
    if not strip.shaft:
        for node in strip.nodes:
            for element in strip.bodies(node):
                value = graph.value(element, "g", 0.0)
                if value:
                    return 1.0 if not isfinite(value) or value > 0 else -1.0
    return 0.0


class Schematic:
    """Puts the strips and joints of a scene together."""

    def __init__(self, graph: Graph, elements: Sequence[Element], style: Style) -> None:
        self.graph, self.elements, self.style = graph, elements, style
        self.lines = strips_of(elements, "line")
        self.shafts = strips_of(elements, "shaft")
        for strip in self.shafts:
            strip.shaft = True
        by_node = {n: s for s in self.lines for n in s.nodes}
        walls = {e.ports[0].node: e for e in elements if e.symbol == "wall"}
        self.hanging = Hanging(by_node, walls, style, lambda strip: gravity_of(strip, graph))
        self.wheel_shafts: set[int] = set()  # identities of shaft strips drawn along their axis
        self.belted: set[str] = set()  # names of drums that a belt joins
        self.drums: dict[int, list[Drum]] = {}  # {shaft among gears: ropes on it}

    def block(self) -> Block:
        """Return everything, joints first, then what no joint has taken along."""
        blocks = [*self._levers(), *self._belts(), *self._roads(), *self._mounted()]
        blocks += [*self._differentials(), *self._ropes()]
        blocks += [b for s in self.lines if id(s) not in self.hanging.used and (b := self._line(s)) is not None]
        blocks += [b for s in self.shafts if id(s) not in self.wheel_shafts and (b := self._shaft(s)) is not None]
        blocks = [b for b in blocks if b.items]
        return packed(blocks, WIDTH, GAP)

    # ------------------------------------------------------------------ strips alone

    def _line(self, strip: Strip) -> Block | None:
        if not self.hanging.shown(strip):
            return None
        gravity = gravity_of(strip, self.graph)
        direction = RIGHT if not gravity else DOWN if gravity > 0 else UP
        return draw_wrapped(strip, self.style, direction)

    def _shaft(self, strip: Strip) -> Block | None:
        if not strip.links and not any(strip.on[n] for n in strip.nodes):
            return None
        gears = gears_of(strip)
        if gears:
            return gear_row(strip, gears, self.style, self.drums)
        free = [n for n in strip.nodes if (held := strip.held(n)) is None or held.symbol == "rotation"]
        if gears is not None and any(e.symbol == "pendulum" for e in strip.on[free[0]]):
            return draw_pendulum(turning(strip, free[0]), self.style)
        if gears is not None and not strip.links:
            shaft = turning(strip, strip.nodes[0])
            if any(e.symbol in BODIES for e in shaft.on):
                items, legs = decorated(shaft, self.style, 40.0, True)
                return Block((*legs, *wheel(shaft, self.style, [40.0], False), *items))
        return draw_wrapped(strip, self.style, RIGHT)

    # ------------------------------------------------------------------ joints

    def _joints(self, kinds: Sequence[str]) -> list[Element]:
        return [e for e in self.elements if e.symbol in kinds]

    def _turning(self, port: Port | None) -> Turning | None:
        """The shaft of a joint where it can be seen along its axis."""
        if port is None or port.domain != "shaft":
            return None
        strip = next((s for s in self.shafts if port.node in s.nodes), None)
        if strip is None:
            return Turning(port.node, (), ())
        single = [n for n in strip.nodes if (held := strip.held(n)) is None or held.symbol == "rotation"]
        if len(single) == 1 and id(strip) not in self.wheel_shafts:
            self.wheel_shafts.add(id(strip))
            return turning(strip, port.node)
        return Turning(port.node, (), ())

    def _levers(self) -> list[Block]:
        blocks = []
        for element in self._joints(LEVERS):
            shaft = self._turning(element.port("pivot") or element.port("shaft"))
            used = set(self.hanging.used)
            block = draw_lever(element, shaft, self.hanging)
            if tangled(block):  # what is at its ends needs the room of others: drawn apart
                self.hanging.used.clear()
                self.hanging.used |= used
                block = draw_lever(element, shaft, replace(self.hanging, strips={}))
            blocks.append(block)
        return blocks

    def _belts(self) -> list[Block]:
        drums = self._joints(("drum",))
        others = [e for e in self._joints((*ROPES, *LEVERS, *MOUNTED)) if e not in drums]
        blocks = []
        for belt in belts_of(drums, others, self.hanging.strips):
            strands = [s for found in belt.strands for s in found]
            self.belted |= {d.name for s in strands for d in s.drums}
            self.hanging.used.update(id(s.strip) for s in strands if s.strip is not None)
            ports = {d.port("shaft").node: d.port("shaft") for s in strands for d in s.drums}
            shafts = {node: self._turning(port) for node, port in ports.items()}
            blocks.append(draw_belt(belt, shafts, self.graph, self.hanging))
        return blocks

    def _roads(self) -> list[Block]:
        groups: dict[int, list[Element]] = {}
        for element in self._joints(("wheel",)):
            node = element.port("flange").node
            strip = self.hanging.strips.get(node)
            groups.setdefault(node if strip is None else id(strip), []).append(element)
        return [self._road(wheels) for wheels in groups.values()]

    def _road(self, wheels: Sequence[Element]) -> Block:
        """The wheels of one line; where that is in use, or too long, it is drawn apart."""
        shafts = {w.name: self._rolling(w.port("shaft")) for w in wheels}
        strip = self._free(wheels[0].port("flange").node)
        return self._with_line(strip, lambda line: draw_road(wheels, line, shafts, self.hanging))

    def _rolling(self, port: Port) -> Turning:
        """The shaft of a wheel; one that the ground holds does not go along with the wheel and is drawn apart."""
        before = set(self.wheel_shafts)
        shaft = self._turning(port)
        if shaft is None or shaft.legs:
            self.wheel_shafts = before
            return Turning(port.node, (), ())
        return shaft

    def _mounted(self) -> list[Block]:
        blocks = []
        housings: dict[int, list[Element]] = {}
        for element in self._joints(MOUNTED):
            strip = self._free(element.port("flange").node)
            if element.symbol == "unbalance":
                housings.setdefault(element.port("flange").node if strip is None else id(strip), []).append(element)
                continue
            driver = self._driver(element.port("shaft").node) if element.symbol == "screw" else None
            shaft = self._turning(element.port("shaft")) if element.symbol != "screw" else None

            def drawn(
                line: Strip | None, element: Element = element, shaft: Turning | None = shaft, driver=driver
            ) -> Block:
                return draw_mounted(element, shaft, line, driver, self.hanging)

            blocks.append(self._with_line(strip, drawn))
        for elements in housings.values():
            shafts = [self._rolling(e.port("shaft")) for e in elements]

            def mounted(line: Strip | None, elements=elements, shafts=shafts) -> Block:
                return draw_unbalances(elements, shafts, line, self.hanging)

            blocks.append(self._with_line(self._free(elements[0].port("flange").node), mounted))
        return blocks

    def _free(self, node: int) -> Strip | None:
        """Return the strip of a line's node, None where it is drawn already or has nothing to show."""
        strip = self.hanging.strips.get(node)
        return strip if strip is not None and id(strip) not in self.hanging.used and self.hanging.shown(strip) else None

    def _driver(self, node: int) -> Strip | None:
        """Return what turns a screw, where it can be drawn as a shaft from the side that ends at the screw."""
        strip = self._sideways(node)
        if strip is None:
            return None
        drawn = draw_strip(strip, self.style, RIGHT)
        left, _, right, _ = drawn.block.corners
        if drawn.conflicts or right - left > WIDTH / 2 or not drawn.is_last(node):
            return None
        self.wheel_shafts.add(id(strip))
        return strip

    def _sideways(self, node: int) -> Strip | None:
        """Return the shaft of a node, None where it is drawn already, or along its axis."""
        strip = next((s for s in self.shafts if node in s.nodes), None)
        if strip is None or id(strip) in self.wheel_shafts or strip.links and gears_of(strip):
            return None
        return strip

    def _differentials(self) -> list[Block]:
        held = {e.ports[0].node: e for e in self.elements if e.symbol == "fixed-shaft"}
        blocks = []
        for element in self._joints(("differential",)):
            shafts = {}
            for port in WAYS:
                node = element.port(port).node
                strip = self._sideways(node)
                drawn = None if strip is None else shaft_beside(strip, node, port, self.style)
                if drawn is not None:
                    self.wheel_shafts.add(id(strip))
                    shafts[port] = drawn
            blocks.append(draw_differential(element, shafts, held, self.style))
        return blocks

    def _with_line(self, strip: Strip | None, drawn: Callable[[Strip | None], Block]) -> Block:
        """Return what is drawn with a line; without it where that is too long, or what is on it needs its room."""
        block = drawn(strip)
        left, _, right, _ = block.corners
        if strip is not None and (right - left > WIDTH or tangled(block)):
            self.hanging.used.discard(id(strip))
            block = drawn(None)
        return block

    def _ropes(self) -> list[Block]:
        joints = self._rope_joints()
        ends = {n for j in joints for n in j.ends}
        blocks = []
        groups = _connected(joints)
        for joint in joints:
            joint.hung = joint.axle in ends and joint.axle not in self.hanging.walls
            joint.below = joint.below and not joint.hung
        groups.sort(key=lambda group: not any(j.hung for j in group))  # what hangs from another rope comes first
        for group in groups:
            whole = rope_of(group)
            ropes = [whole] if whole is not None else [_alone(j) for j in group]
            for rope in ropes:
                block = draw_rope(rope, self.hanging)
                hung = next((j.axle for j in rope.joints if j.hung), None)
                if hung is None:
                    blocks.append(block)
                else:
                    x, y = block.anchors[hung]
                    self.hanging.hung[hung] = block.at(-x, -y)
        return [*blocks, *self.hanging.hung.values()]  # those that are left hang from each other

    def _rope_joints(self) -> list[Joint]:
        found: list[Joint] = []
        wheels: dict[int, list[Element]] = {}
        for element in (e for e in self._joints(ROPES) if e.name not in self.belted):
            if element.symbol == "drum":
                wheels.setdefault(element.port("shaft").node, []).append(element)
            else:
                axle = element.port("axle").node
                strip = self.hanging.strips.get(axle)
                fixed = strip is None or axle in self.hanging.walls
                ends = element.port("a").node, element.port("b").node
                found.append(Joint((element,), ends, axle, None, not fixed))
        for node, drums in wheels.items():
            strip = next((s for s in self.shafts if node in s.nodes), None)
            if strip is not None and gears_of(strip) and len(drums) <= 2:
                self.drums[node] = [self._hung(drum) for drum in drums]
                continue
            shaft = self._turning(drums[0].port("shaft"))
            for k in range(0, len(drums), 2):
                pair = drums[k : k + 2]
                found.append(Joint(tuple(pair), tuple(d.port("flange").node for d in pair), None, shaft))
        return found

    def _hung(self, drum: Element) -> Drum:
        """Return the rope of a drum on a shaft among gears, with what hangs on it."""
        node, radius = drum.port("flange").node, self.graph.value(drum, "r", 1.0)
        content = self.hanging.hang(node)
        return Drum(drum.name, node, content, self.hanging.direction(node), radius)


def _connected(joints: Sequence[Joint]) -> list[list[Joint]]:
    """Joints that share a node of a rope."""
    groups: list[list[Joint]] = []
    for joint in joints:
        touching = [g for g in groups if any(set(j.ends) & set(joint.ends) for j in g)]
        merged = [joint] if not touching else [*sum(touching, []), joint]
        groups = [g for g in groups if g not in touching] + [merged]
    return groups


def _alone(joint: Joint) -> Rope:
    """A joint by itself."""
    return Rope([joint], [joint.ends[0], joint.ends[1]] if len(joint.ends) == 2 else [None, joint.ends[0]])


def gravity_arrow(block: Block, name: str) -> Block:
    """Return a block with an arrow for gravity at its right."""
    _, top, right, _ = block.corners
    at = Anchor(right + 26, top + 6)
    made = symbols.arrow("gravity", "", at, (0, 0), (0, 40), "muted", 1.5)
    return block.beside(Block((made, symbols.label(name, at, 8, 20, "start", colour="muted"))))
