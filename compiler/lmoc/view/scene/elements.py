"""The graph of a scene: its parts with their ports, and the nodes that connections make of the ports."""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import replace
from math import isfinite, prod

import numpy as np

from lmoc.ir.flat import Block, FlatDAE, Kind, Part
from lmoc.ir.look import Condition, Drawn, Look
from lmoc.support.quoted import last
from lmoc.support.records import dataclass
from lmoc.symbolic.styles import unit_text

# the units of a port's potentials → what kind of port it is
_MACRO = re.compile(r"%(?:([%]|[A-Za-z_]\w*(?:\.\w+)*)|\{([^}]*)\})")  # of a text in an icon
MOST_WRITTEN = 4  # members of an array in an icon
DOMAINS = {("m",): "line", ("rad",): "shaft", ("m", "m"): "point", ("m", "m", "rad"): "frame"}


@dataclass(frozen=True)
class Port:
    """A connector of an element.

    Attributes
    ----------
    domain : "line", "shaft", "point", "frame" or "other"
    node : which connection set it is in; ports that nothing is connected to have a node of their own
    potentials, flows : variable indices of the flat model
    """

    name: str
    domain: str
    node: int
    potentials: tuple[int, ...]
    flows: tuple[int, ...]


@dataclass(frozen=True)
class Element:
    """One part of the scene, or one of an array.

    Attributes
    ----------
    name : dotted name
    kind : name of its class
    hidden : how many elements it stands for, where it is an ellipsis; 0 otherwise
    """

    name: str
    kind: str
    look: Look
    ports: tuple[Port, ...]
    hidden: int = 0

    @property
    def symbol(self) -> str:
        return self.look.symbol

    def port(self, name: str) -> Port | None:
        """Return the port of that name, None where it has none (a conditional one, say)."""
        return next((p for p in self.ports if p.name == name), None)


@dataclass(frozen=True)
class Graph:
    """The parts of a scene that have ports.

    Attributes
    ----------
    values : (flat.count,) parameter values
    elements : in the order of their declaration
    """

    flat: FlatDAE
    values: np.ndarray
    elements: tuple[Element, ...]

    def value(self, element: Element, name: str, default: float = float("nan")) -> float:
        """Return the value of a parameter of an element; `default` where it has none of that name."""
        found = self.flat.find(f"{element.name}.{name}")
        return default if found is None or not len(found) else float(self.values[found[0]])

    def table(self, element: Element, name: str, rows: int, columns: int) -> list[list[float]]:
        """Return a matrix of parameters of an element."""
        indices = [[f"{name}[{k},{c}]" for c in range(1, columns + 1)] for k in range(1, rows + 1)]
        return [[self.value(element, index) for index in row] for row in indices]

    def variable(self, element: Element, name: str) -> int | None:
        """Return the index of a variable of an element."""
        found = self.flat.find(f"{element.name}.{name}")
        return None if found is None or not len(found) else int(found[0])

    def worded(self, numbers: bool) -> Graph:
        """Return the graph with what is visible of drawings, their texts written out but for names.

        See the Modelica specification, 18.6.5.5.

        Parameters
        ----------
        numbers : write parameters' values; otherwise, where they can be changed, leave such texts out
        """
        elements = []
        for e in self.elements:
            seen = [d for d in e.look.drawing if not d.visible or self._holds(e, d.visible)]
            drawn = [d if "%" not in d.text else self._worded(e, d, numbers) for d in seen]
            elements.append(replace(e, look=replace(e.look, drawing=tuple(d for d in drawn if d is not None))))
        return replace(self, elements=tuple(elements))

    def _holds(self, element: Element, condition: Condition) -> bool:
        """Return whether a condition holds; what is no parameter with a value does."""
        if not condition.sides:
            return self.value(element, condition.operator, 1.0) != 0
        held = [self._holds(element, side) for side in condition.sides]
        return {"not": not held[0], "and": all(held), "or": any(held)}[condition.operator]

    def _worded(self, element: Element, drawn: Drawn, numbers: bool) -> Drawn | None:
        def word(match: re.Match[str]) -> str:
            name = match[1] or match[2]
            if name in ("%", "name", "class"):
                return {"%": "%", "name": "%name", "class": element.kind}[name]
            return self._written(f"{element.name}.{name}") or name

        asked = {match[1] or match[2] for match in _MACRO.finditer(drawn.text)}
        return replace(drawn, text=_MACRO.sub(word, drawn.text)) if numbers or asked <= {"%", "name", "class"} else None

    def _written(self, name: str) -> str:
        """Return the value of a parameter and its unit; nothing for what is no parameter, or a long array."""
        found = self.flat.find(name)
        if found is None or not 0 < len(found) <= MOST_WRITTEN:
            return ""
        block = self.flat.block_at(int(found[0]))
        numbers = [float(self.values[v]) for v in found]
        if block.kind > Kind.PARAMETER or block.quantity not in ("Boolean", "Real", "Integer"):
            return ""
        if not all(isfinite(value) for value in numbers):
            return ""
        if block.quantity == "Boolean":
            words = ["true" if value else "false" for value in numbers]
        else:
            words = [f"{value:.6g}" for value in numbers]
        unit = unit_text(block.unit) if block.unit not in ("", "1") else ""
        return f"{words[0] if block.size == 1 else '{' + ', '.join(words) + '}'} {unit}".rstrip()

    def name(self, port: Port, axis: int = 0) -> str:
        """Return the dotted name of a potential of a port."""
        return self.flat.variable_name(port.potentials[axis])


def drawn_parts(flat: FlatDAE) -> list[Part]:
    """Return the parts that are elements of the scene: those with ports and none below, or with a look of their own."""
    inside: set[int] = set()
    found = []
    for number, part in enumerate(flat.parts):
        if number and part.parent in inside:
            inside.add(number)
        elif number and part.ports and (part.leaf or part.look.symbol or part.look.drawing):
            inside.add(number)
            if part.look.symbol != "none":
                found.append(part)
    return found


def size(part: Part) -> int:
    """Return the number of elements of a part: those of the arrays on its path."""
    return prod(n for _, dims in part.path for n in dims)


def node_of(flat: FlatDAE) -> np.ndarray:
    """Return for each variable the first one of its connection set."""
    first = np.arange(flat.count)
    for group in flat.groups:
        if group.origin == "connection":
            first[group.slots[:, 0]] = group.slots[:, 1]
    return first


def ports_of(flat: FlatDAE, part: Part, first: np.ndarray, position: int) -> tuple[Port, ...]:
    """Return the ports of one element of a part."""
    connectors: dict[tuple, list[tuple[Block, Block]]] = defaultdict(list)
    for p, f in part.ports:
        connectors[flat.blocks[p].path[len(part.path) : -1]].append((flat.blocks[p], flat.blocks[f]))
    number = size(part)
    found = []
    for path, pairs in connectors.items():
        units = tuple(p.unit for p, _ in pairs)
        members = [prod(p.path[-1][1]) for p, _ in pairs]  # a place in space is one vector, and one port
        domain = DOMAINS.get(units if set(members) == {1} else units[:1], "other")
        for j in range(pairs[0][0].size // (number * members[0]) if number else 0):
            starts = [position * (p.size // number) + j * n for (p, _), n in zip(pairs, members)]
            here = [(p, f, s + i) for (p, f), s, n in zip(pairs, starts, members) for i in range(n)]
            potentials = tuple(p.offset + i for p, _, i in here)
            flows = tuple(f.offset + i for _, f, i in here)
            name = Block(path, 0, 0, Kind.UNKNOWN).name(j) if path else ""
            found.append(Port(name, domain, int(first[potentials[0]]), potentials, flows))
    return tuple(found)


def elements_of(flat: FlatDAE, part: Part, first: np.ndarray, positions: np.ndarray | range) -> list[Element]:
    """Return some of the elements of a part."""
    named = Block(part.path, 0, size(part), Kind.UNKNOWN)
    kind = last(part.class_name)
    return [Element(named.name(i), kind, part.look, ports_of(flat, part, first, i)) for i in map(int, positions)]
