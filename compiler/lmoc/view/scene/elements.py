"""The graph of a scene: its parts with their ports, and the nodes that connections make of the ports."""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import replace
from math import isfinite, prod

import numpy as np

from lmoc.ir.flat import Block, FlatDAE, Kind, Part
from lmoc.ir.look import Drawn, Look
from lmoc.support.quoted import last
from lmoc.support.records import dataclass
from lmoc.symbolic.styles import unit_text

# the units of a port's potentials → what kind of port it is
_MACRO = re.compile(r"%(?:([%]|[A-Za-z_]\w*(?:\.\w+)*)|\{([^}]*)\})")  # of a text in an icon
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
        """Return the graph with the texts of drawings written out (Modelica specification, 18.6.5.5), but for names.

        Parameters
        ----------
        numbers : write parameters' values; otherwise, where they can be changed, leave such texts out
        """
        elements = []
        for e in self.elements:
            drawn = [d if "%" not in d.text else self._worded(e, d, numbers) for d in e.look.drawing]
            elements.append(replace(e, look=replace(e.look, drawing=tuple(d for d in drawn if d is not None))))
        return replace(self, elements=tuple(elements))

    def _worded(self, element: Element, drawn: Drawn, numbers: bool) -> Drawn | None:
        def word(match: re.Match[str]) -> str:
            name = match[1] or match[2]
            if name in ("%", "name", "class"):
                return {"%": "%", "name": "%name", "class": element.kind}[name]
            return self._written(f"{element.name}.{name}") or name

        asked = {match[1] or match[2] for match in _MACRO.finditer(drawn.text)}
        return replace(drawn, text=_MACRO.sub(word, drawn.text)) if numbers or asked <= {"%", "name", "class"} else None

    def _written(self, name: str) -> str:
        """Return the value of a parameter and its unit; nothing for what is no parameter, or an array."""
        found = self.flat.find(name)
        block = self.flat.block_at(int(found[0])) if found is not None and len(found) == 1 else None
        if block is None or block.kind > Kind.PARAMETER:
            return ""
        value = float(self.values[found[0]])
        if block.quantity == "Boolean":
            return "true" if value else "false"
        unit = unit_text(block.unit) if block.unit not in ("", "1") else ""
        return f"{value:.6g} {unit}".rstrip() if block.quantity in ("Real", "Integer") and isfinite(value) else ""

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
        for j in range(pairs[0][0].size // number if number else 0):
            here = [position * (p.size // number) + j for p, _ in pairs]
            potentials = tuple(p.offset + i for (p, _), i in zip(pairs, here))
            flows = tuple(f.offset + i for (_, f), i in zip(pairs, here))
            name = Block(path, 0, 0, Kind.UNKNOWN).name(j) if path else ""
            found.append(Port(name, DOMAINS.get(units, "other"), int(first[potentials[0]]), potentials, flows))
    return tuple(found)


def elements_of(flat: FlatDAE, part: Part, first: np.ndarray, positions: np.ndarray | range) -> list[Element]:
    """Return some of the elements of a part."""
    named = Block(part.path, 0, size(part), Kind.UNKNOWN)
    kind = last(part.class_name)
    return [Element(named.name(i), kind, part.look, ports_of(flat, part, first, i)) for i in map(int, positions)]
