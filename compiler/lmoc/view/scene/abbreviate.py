"""Large scenes: of an array only the first elements and the last are drawn, dots stand for the rest between them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from lmoc.ir.flat import FlatDAE, Part
from lmoc.ir.look import Look
from lmoc.semantics.connections.components import components
from lmoc.support.quoted import last
from lmoc.support.records import dataclass
from lmoc.view.scene.elements import (
    DOMAINS,
    Element,
    Graph,
    Port,
    drawn_parts,
    elements_of,
    node_of,
    ports_of,
    size,
)

MOST_DRAWN = 70  # elements of lines and shafts
MOST_IN_PLANE = 300
MOST_ALIKE = 12  # elements of an array on lines or shafts that are drawn one by one
FIRST, LAST = 2, 1  # elements of an array that are shown where it is cut
MOST_ENCLOSED = 12  # elements of an array
MOST_ENDS = 6  # of dots that stand for many parts


@dataclass(frozen=True)
class Shown:
    """The parts of a scene that are drawn.

    Attributes
    ----------
    graph : the parts, some of them ellipses; None where even so they are too many
    parts : all that could be drawn
    notes : what is left out
    """

    graph: Graph | None
    parts: tuple[Part, ...]
    notes: tuple[str, ...] = ()


def shown(flat: FlatDAE, values: np.ndarray) -> Shown:
    """Return what is to be drawn of a scene."""
    parts = drawn_parts(flat)
    first = node_of(flat)
    total = sum(size(p) for p in parts)
    plane = [p for p in parts if _in_plane(flat, p)]
    few = total - sum(size(p) for p in plane) <= MOST_DRAWN and sum(size(p) for p in plane) <= MOST_IN_PLANE
    if few and (plane or all(size(p) <= MOST_ALIKE for p in parts)):
        elements = [e for p in parts for e in elements_of(flat, p, first, range(size(p)))]
        return Shown(Graph(flat, values, tuple(elements)), tuple(parts))
    kept = {id(p): _kept(size(p), MOST_ALIKE if few else FIRST + LAST + 1) for p in parts}
    number = sum(len(k) for k in kept.values())
    if number > MOST_DRAWN:
        return Shown(None, tuple(parts), (f"{total} parts are too many to be drawn one by one",))
    elements = [e for p in parts for e in elements_of(flat, p, first, kept[id(p)])]
    for p in parts:  # what stands between parts that are shown is shown as well: the masses at the ends of springs
        also = _enclosed(flat, p, kept[id(p)], elements, first)
        elements += elements_of(flat, p, first, also)
        kept[id(p)] = np.union1d(kept[id(p)], also)
    number = len(elements)
    dots = _dots(flat, parts, kept, elements, first) if not plane else []
    note = f"{number} of {total} parts are drawn; dots stand for the rest"
    if plane:
        note = f"{number} of {total} parts are drawn: the first and the last of each array"
    return Shown(Graph(flat, values, (*elements, *dots)), tuple(parts), (note,))


def whole(flat: FlatDAE, values: np.ndarray) -> Graph:
    """Return all parts of a scene, however many."""
    first = node_of(flat)
    return Graph(flat, values, tuple(e for p in drawn_parts(flat) for e in elements_of(flat, p, first, range(size(p)))))


def _in_plane(flat: FlatDAE, part: Part) -> bool:
    return DOMAINS.get(tuple(flat.blocks[p].unit for p, _ in part.ports[:3]), "") in ("frame", "") and any(
        flat.blocks[p].path[-1][0] == "y" for p, _ in part.ports
    )


def _kept(n: int, most: int) -> np.ndarray:
    """Positions of the elements that are shown of an array: all, or the first and the last."""
    return np.arange(n) if n <= most else np.r_[0:FIRST, n - LAST : n]


def _enclosed(
    flat: FlatDAE, part: Part, kept: np.ndarray, elements: Sequence[Element], first: np.ndarray
) -> np.ndarray:
    """Positions of hidden elements that stand at parts that are shown."""
    hidden = np.setdiff1d(np.arange(size(part)), kept)
    if not len(hidden):
        return hidden
    links = {port.node for e in elements for port in e.ports}
    walls = {port.node for e in elements if e.symbol in ("wall", "fixed-shaft") for port in e.ports}
    seen = np.zeros(flat.count, bool)
    seen[list(links - walls)] = True
    ports = ports_of(flat, part, first, int(hidden[0]))
    if len(ports) > 1:
        return hidden[:0]
    return hidden[seen[_nodes(flat, part, ports[0], hidden, first)]][:MOST_ENCLOSED]


def _nodes(flat: FlatDAE, part: Part, port: Port, positions: np.ndarray, first: np.ndarray) -> np.ndarray:
    """The nodes of a port of some elements, given that of the first of them."""
    block = flat.block_at(port.potentials[0])
    inner = block.size // size(part)
    own = port.potentials[0] - block.offset - int(positions[0]) * inner
    return first[block.offset + positions * inner + own]


def _dots(
    flat: FlatDAE, parts: Sequence[Part], kept: dict[int, np.ndarray], elements: Sequence[Element], first: np.ndarray
) -> list[Element]:
    """Ellipses for the parts that are left out, one for each piece that hangs together."""
    seen = np.zeros(flat.count, bool)
    seen[[port.node for e in elements for port in e.ports]] = True
    owner, node, side, kinds = [], [], [], []
    count = 0
    for part in parts:
        hidden = np.setdiff1d(np.arange(size(part)), kept[id(part)])
        if not len(hidden):
            continue
        for k, port in enumerate(ports_of(flat, part, first, int(hidden[0]))):
            owner.append(count + np.arange(len(hidden)))
            node.append(_nodes(flat, part, port, hidden, first))
            side.append(np.full(len(hidden), k))
        kinds += [last(part.class_name)] * len(hidden)
        count += len(hidden)
    if not count:
        return []
    owners, nodes, sides = np.concatenate(owner), np.concatenate(node), np.concatenate(side)
    inside = ~seen[nodes]
    loops = np.arange(count)  # so that every element occurs
    left, right = np.r_[owners[inside], loops], np.r_[nodes[inside] + count, loops]
    found, label, _, _ = components(left, right)
    piece = np.full(count, -1)
    members = found < count
    piece[found[members]] = label[members]
    ends: dict[int, dict[int, int]] = {}  # {piece: {node: side}}
    for p, n, s in zip(piece[owners[~inside]].tolist(), nodes[~inside].tolist(), sides[~inside].tolist()):
        ends.setdefault(p, {}).setdefault(n, s)
    alike: dict[tuple, Counter[str]] = {}  # pieces at the same nodes are one
    for i, p in enumerate(piece.tolist()):
        some = tuple(sorted(ends.get(p, {}).items(), key=lambda item: item[1])[:MOST_ENDS])
        alike.setdefault(some, Counter())[kinds[i]] += 1
    return [_ellipsis(flat, some, among) for some, among in list(alike.items())[: MOST_DRAWN // 4]]


def _ellipsis(flat: FlatDAE, ends: Sequence[tuple[int, int]], among: Counter[str]) -> Element:
    """Dots between some nodes, and what they stand for."""
    words = ", ".join(f"{n} × {kind}" for kind, n in among.most_common(3)) + (", …" if len(among) > 3 else "")
    ports = tuple(_port(flat, k, n) for k, (n, _) in enumerate(ends))
    return Element(f"… {words}", "", Look("ellipsis"), ports, sum(among.values()))


def _port(flat: FlatDAE, k: int, node: int) -> Port:
    unit = flat.block_at(node).unit
    return Port(str(k), DOMAINS.get((unit,), "other"), node, (node,), (node,))
