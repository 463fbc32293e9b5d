"""Names in a picture: the user's own symbols where there are any, else the names of the parts."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from lmoc.ir.flat import Kind
from lmoc.symbolic.names import short_names
from lmoc.symbolic.styles import GREEK, split_name
from lmoc.view.scene.elements import Element, Graph
from lmoc.view.scene.text import escaped

MOST_ROWS = 1000  # of a group of equations in which names are looked for
CAPITALS = dict(zip("Gamma Delta Theta Lambda Xi Pi Sigma Phi Psi Omega".split(), "ΓΔΘΛΞΠΣΦΨΩ", strict=True))
LONGEST = 28  # characters of a name that is shown in full


def symbol(name: str) -> str:
    """A name as a symbol: ``theta1`` as ``θ_{1}``, ``q_left`` as ``q_{left}``; long words as they are."""
    if "." in name or "[" in name:
        return shortened(name)
    _, word, digits, index = split_name(name)
    letter = GREEK.get(word) or CAPITALS.get(word, word)
    below = digits or GREEK.get(index, index)
    if not below:
        return letter if letter != word else shortened(name)
    if len(letter) > 3:
        return shortened(name)
    return f"{escaped(letter)}_{{{shortened(below)}}}" if "{" not in below and "}" not in below else shortened(name)


def shortened(name: str, most: int = LONGEST) -> str:
    """A name that has room in a picture, its middle left out where it is very long."""
    if len(name) > most:
        name = name[: most // 2] + "…" + name[-most // 2 + 1 :]
    return escaped(name)


class Names:
    """Names of the parameters, coordinates and parts of one scene."""

    def __init__(self, graph: Graph) -> None:
        self.graph = graph
        self.flat = graph.flat

    @cached_property
    def _source(self) -> np.ndarray:
        """For each variable the one that it is bound to, itself where it is bound to none."""
        source = np.arange(self.flat.count)
        for binding in self.flat.bindings:
            if binding.shape.op == "slot" and binding.numbers is None:
                source[binding.target] = binding.slots[:, binding.shape.value[0]]
        return source

    def parameter(self, element: Element, name: str) -> str:
        """Return the user's symbol for a parameter, "" where its value is a number or a formula."""
        variable = self.graph.variable(element, name)
        if variable is None:
            return ""
        variable = self.source(variable)
        return symbol(self.flat.variable_name(variable)) if self.is_own(variable) else ""

    def source(self, variable: int) -> int:
        """Return the variable that one is bound to, by way of others; itself where it is bound to none."""
        while self._source[variable] != variable:
            variable = int(self._source[variable])
        return variable

    def slack(self, part: str) -> dict[str, str]:
        """Return the variables of an item that shows a string: how much longer it is than the way between its ends.

        ``slack`` is that length, ``stretch`` its negative.
        """
        known = {"slack": f"{part}.gap", "stretch": f"{part}.extension"}
        return {key: name for key, name in known.items() if self.flat.find(name) is not None}

    def is_own(self, variable: int) -> bool:
        """Return whether it is a variable of the model itself, not of a part."""
        return len(self.flat.block_at(variable).path) == 1 and self.flat.block_at(variable).path[0][0] != "literal"

    def part(self, element: Element, *parameters: str) -> str:
        """Return what stands beside an element: the symbols of its parameters, else its name."""
        found = [text for text in (self.parameter(element, name) for name in parameters) if text]
        return ", ".join(found) if found else self.called(element)

    def called(self, element: Element) -> str:
        """Return the element's own name."""
        if element.hidden:
            return escaped(element.name)
        return symbol(element.name) if len(element.name) <= 4 else shortened(element.name)

    @cached_property
    def _same(self) -> dict[int, list[int]]:
        """{variable: those of the model itself that are equal to it by an equation of theirs}."""
        same: dict[int, list[int]] = {}
        for group in self.flat.groups:
            said = group.part == 0 and group.origin in ("equation", "binding") or group.origin == "binding"
            if not said or group.rows > MOST_ROWS or not group.left.op == group.right.op == "slot":
                continue
            if group.left.value[1] or group.right.value[1]:
                continue
            for a, b in group.slots[:, [group.left.value[0], group.right.value[0]]].tolist():
                for own, other in ((a, b), (b, a)):
                    if self.is_own(own) and not self.is_own(other):
                        same.setdefault(other, []).append(own)
        return same

    def own(self, *variables: int | None) -> str:
        """Return the name that the model itself has for one of some variables; "" for none."""
        for variable in variables:
            for own in self._same.get(variable, ()) if variable is not None else ():
                if self.flat.kind[own] >= Kind.INPUT:
                    return self.flat.variable_name(own)
        return ""

    def coordinates(self, wanted: dict[int, tuple[int, ...]]) -> dict[int, str]:
        """Return symbols for the coordinates of nodes.

        Parameters
        ----------
        wanted : {node: variables that are its coordinate, the preferred first}
        """
        own = {self.flat.variable_name(vs[0]): name for vs in wanted.values() if (name := self.own(*vs))}
        short = short_names([self.flat.variable_name(vs[0]) for vs in wanted.values()], own)
        return {node: symbol(short[self.flat.variable_name(vs[0])]) for node, vs in wanted.items()}

    def signal(self, element: Element, name: str) -> str:
        """Return the symbol of an input of a part: that of the model's own input, else the part's name."""
        variable = self.graph.variable(element, name)
        return symbol(own) if (own := self._driver(variable)) else self.called(element)

    def _driver(self, variable: int | None) -> str:
        """The model's own variable that a part's input is bound to."""
        if variable is None:
            return ""
        if self._source[variable] != variable and self.is_own(int(self._source[variable])):
            return self.flat.variable_name(int(self._source[variable]))
        return self.own(variable)
