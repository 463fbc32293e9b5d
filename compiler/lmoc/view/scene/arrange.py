"""The arrangement of a scene: its parts sorted into strips and joints, and these put together."""

from __future__ import annotations

from collections.abc import Iterable

from lmoc.view.scene.elements import Element
from lmoc.view.scene.strip import Strip

JOINTS = (
    "pulley", "drum", "wheel", "arm", "lever", "beam", "guide", "slider", "pin", "rack", "screw", "cam", "unbalance",
    "differential",
)  # fmt: skip


def strips_of(elements: Iterable[Element], domain: str) -> list[Strip]:
    """Return the strips of one domain, "line" or "shaft".

    A wall holds what is connected to it, but joins nothing: each strip has its own piece of it, and a piece on each
    side where it is connected on both.
    """
    elements = list(elements)
    walls: dict[int, Element] = {}
    for e in elements:
        if e.symbol in ("wall", "fixed-shaft"):
            walls[e.ports[0].node] = e
    copies = _Copies(walls)
    links: list[tuple[Element, int, int]] = []
    alone: list[tuple[Element, int]] = []
    frames: list[tuple[Element, int, int]] = []
    hubs: dict[int, Element] = {}
    number = 0
    for e in elements:
        ports = [p for p in e.ports if p.domain == domain]
        if e.symbol in JOINTS or not ports or e.symbol in ("wall", "fixed-shaft"):
            continue
        if e.symbol == "moving-frame":
            frames.append((e, ports[0].node, ports[1].node))
        elif len(ports) == 1:
            alone.append((e, ports[0].node))
        elif len(ports) == 2:
            links.append((e, copies.of(number, ports[0].node, 0), copies.of(number, ports[1].node, 1)))
            number += 1
        else:
            hub = -(10**9) - len(hubs)
            hubs[hub] = e
            links.append((e, copies.of(number, ports[0].node, 0), hub))
            links += [(e, hub, copies.of(number, p.node, 1)) for p in ports[1:]]
            number += 1
    return _sorted(links, alone, frames, hubs, walls, copies)


class _Copies:
    """Pieces of walls: one for each side of each group of elements that reaches it."""

    def __init__(self, walls: dict[int, Element]) -> None:
        self.walls = walls
        self.made: dict[int, int] = {}  # piece -> wall

    def of(self, link: int, node: int, side: int) -> int:
        if node not in self.walls:
            return node
        piece = -2 * link - side - 10
        self.made[piece] = node
        return piece


def _sorted(links, alone, frames, hubs, walls, copies: _Copies) -> list[Strip]:
    parent: dict[int, int] = {}

    def find(n: int) -> int:
        parent.setdefault(n, n)
        while parent[n] != n:
            parent[n] = parent[parent[n]]
            n = parent[n]
        return n

    for _, a, b in (*links, *frames):
        parent[find(a)] = find(b)
    # pieces of one wall on the same side of a strip are one
    one: dict[tuple[int, int, int], int] = {}
    same: dict[int, int] = {}
    for piece, wall in copies.made.items():
        key = find(piece), wall, piece % 2
        same[piece] = one.setdefault(key, piece)
    strips: dict[int, Strip] = {}

    def strip(n: int) -> Strip:
        return strips.setdefault(find(n), Strip(False))

    def node(s: Strip, n: int) -> int:
        n = same.get(n, n)
        if n not in s.nodes:
            s.nodes.append(n)
            if n in copies.made:
                s.on[n].append(walls[copies.made[n]])
        return n

    for e, a, b in links:
        s = strip(a)
        s.links.append((e, node(s, a), node(s, b)))
    for e, n in alone:
        s = strip(n)
        s.on[node(s, n)].append(e)
        if n in walls and walls[n] not in s.on[n]:
            s.on[n].append(walls[n])
    for e, a, b in frames:
        s = strip(a)
        s.frames.append((e, node(s, a), node(s, b)))
    for hub, e in hubs.items():
        strip(hub).hubs[hub] = e
    return list(strips.values())
