"""Forces written as one writes them at a body: by the body's own coordinate, and by the parameters given to the part.

`Inertia gear2` behind a gear has ``θ₂ = θ₁/N``; its spring pulls with ``k·θ₂``, though the scene is solved for θ₁. A
pair of gears with ``r2 = r2``, bound to ``-N*r1`` in the model, acts with ``F·r₂``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmoc.ir.flat import Kind
from lmoc.support.records import dataclass
from lmoc.symbolic.kinematics import Kinematics
from lmoc.symbolic.names import base_of
from lmoc.symbolic.system import jet_symbol
from lmoc.view.scene.elements import Element, Graph, Port
from lmoc.view.scene.names import Names
from lmoc.view.scene.strip import BODIES

if TYPE_CHECKING:
    import sympy

DERIVATIVES = 3  # of the coordinate that may occur in a force


@dataclass(frozen=True)
class LocalForms:
    """The rewriting of forces of one scene."""

    graph: Graph
    names: Names
    kinematics: Kinematics

    def written(self, value: sympy.Expr, element: Element, port: Port) -> sympy.Expr:
        """Return the force of a part on the body whose port is given, by what belongs to both where that is shorter."""
        value = self._by_coordinate(value, port)
        for symbol, meaning in self._parameters(element):
            other = value / meaning
            if not other.free_symbols & meaning.free_symbols:
                value = other * symbol
        return value

    def _by_coordinate(self, value: sympy.Expr, port: Port) -> sympy.Expr:
        """Replace the coordinate of the scene by the body's own, where one is a multiple of the other."""
        import sympy as sp

        own = self.kinematics.value(port.potentials[0])
        given = self.kinematics.interpreter.input_symbols
        moving = [x for x in own.free_symbols if x in self.kinematics.coordinates or x in given]
        if len(moving) != 1 or own == moving[0]:
            return value
        (x,) = moving
        factor = own / x
        if factor.has(x) or any(base_of(s.name)[1] or s.name == "time" for s in factor.free_symbols):
            return value
        name = self._name(port)
        jets = {jet_symbol(x.name, k): jet_symbol(name, k) / factor for k in range(DERIVATIVES)}
        local = sp.powsimp(value.xreplace(jets))
        return local if sp.count_ops(local) < sp.count_ops(value) else value

    def _name(self, port: Port) -> str:
        """The variable that the picture names the coordinate of a body after."""
        graph = self.graph
        here = [(e, p) for e in graph.elements for p in e.ports if p.node == port.node]
        states = [graph.variable(e, name) for e, _ in here for name in ("q", "theta")]
        variables = [*(v for v in states if v is not None), *(p.potentials[0] for _, p in here)]
        bodies = [graph.variable(e, name) for e, _ in here if e.symbol in BODIES for name in ("q", "theta")]
        named = next((v for v in bodies if v is not None), port.potentials[0])
        return graph.flat.variable_name(next((v for v in variables if self.names.own(v)), named))

    def _parameters(self, element: Element) -> list[tuple[sympy.Symbol, sympy.Expr]]:
        """The model's own parameters that a part is given, where the model binds them to a formula of others."""
        import sympy as sp

        flat = self.graph.flat
        words = {b.path[-1][0] for b in flat.blocks if b.kind == Kind.PARAMETER and len(b.path) > 1}
        found: dict[str, sympy.Expr] = {}
        for variable in (self.graph.variable(element, word) for word in sorted(words)):
            source = None if variable is None else self.names.source(variable)
            if source is not None and source != variable and self.names.is_own(source):
                meaning = self.kinematics.interpreter.variable(source)
                if not meaning.is_Symbol and meaning.free_symbols:
                    found[flat.variable_name(source)] = meaning
        return [(sp.Symbol(name), meaning) for name, meaning in found.items()]
