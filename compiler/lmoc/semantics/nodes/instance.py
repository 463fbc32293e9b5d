"""The instance tree: one node for each declared name, an array of parts included.

A node stands for all elements of its array and of the arrays around it: `total` are the dimensions of its whole
path. A chain of 10⁵ masses has one node `m`, and one for each variable inside it.
"""

from __future__ import annotations

from dataclasses import field
from math import prod
from typing import Any

import numpy as np

from lmoc.ir.flat import Kind, StateSelect
from lmoc.ir.paths import NamePath
from lmoc.messages.source import Span
from lmoc.semantics.classes.predefined import Builtin
from lmoc.semantics.classes.scope import Scope
from lmoc.support.records import dataclass
from lmoc.syntax import tree

ATTRIBUTES = frozenset("start fixed nominal min max unit displayUnit quantity stateSelect unbounded".split())


@dataclass(frozen=True, slots=True)
class Binding:
    """A value given to an element.

    Attributes
    ----------
    expression : syntax tree, or what the caller gave
    node : the instance in whose class the expression is written; None for a caller's number
    scope : the class whose text it is
    each : the `each` marks on the way to it: its own argument's first, then that of the argument around it, ...
    alike : for each array dimension between `node` and the element, whether all along it get the same
    """

    expression: tree.Expression | np.ndarray
    node: Instance | None
    scope: Scope | None
    span: Span | None
    each: tuple[bool, ...] = ()
    alike: tuple[bool, ...] = ()


@dataclass(frozen=True, slots=True)
class Modifier:
    """The modification of one element and of its contents."""

    value: Binding | None = None
    inside: dict[str, Modifier] = field(default_factory=dict)
    final: bool = False
    redeclaration: tuple[tree.Redeclaration, Scope] | None = None
    span: Span | None = None


NOTHING = Modifier()


class InstanceNode:
    """The instance of a declared name.

    Attributes
    ----------
    dims : its own array dimensions
    total : those of all parts around it, then its own
    path : as of `flat.Block`; empty for the model itself
    scope : the class whose text declares it
    """

    # of instances alone: whoever asks for them has looked at the kind of node first
    children: Any
    owner: Any
    type: Any
    cls: Any

    def __init__(
        self,
        name: str,
        parent: Instance | None,
        dims: tuple[int, ...],
        component: tree.Component | None,
        scope: Scope,
        protected: bool = False,
    ):
        self.name = name
        self.parent = parent
        self.dims = dims
        self.total: tuple[int, ...] = parent.total + dims if parent else dims
        self.path: NamePath = (*parent.path, (name, dims)) if parent else ()
        self.component = component
        self.scope = scope
        self.protected = protected

    @property
    def size(self) -> int:
        return prod(self.total)

    @property
    def label(self) -> str:
        """Dotted name for messages."""
        return ".".join(name for name, _ in self.path)

    @property
    def span(self) -> Span | None:
        return self.component.span if self.component else None

    @property
    def description(self) -> str:
        return self.component.description if self.component else ""

    @property
    def name_span(self) -> Span | None:
        return self.component.name_span if self.component else None

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.label or '·'}{list(self.total) if self.total else ''})"


class Variable(InstanceNode):
    """A variable, or an array of them.

    Attributes
    ----------
    attributes : start, unit, fixed, ... as they were given, outermost first
    value : the binding, None where there is none
    offset : index of its first variable in the flat model, once that is laid out
    structural : its value has shaped the flat model
    shaping : it has done so other than in a condition
    from_start : a parameter that the equations of the start determine, or that follows from one; it does not change
    is_node : it belongs to a protected connector that is connected
    computed : no parameter, but of a type that changes at events only, and its value follows from parameters
    """

    def __init__(self, name, parent, dims, component, scope, protected, type_: Builtin, modifier: Modifier):
        super().__init__(name, parent, dims, component, scope, protected)
        self.type = type_
        self.modifier = modifier
        self.value: Binding | None = modifier.value
        self.attributes: dict[str, Binding] = {k: m.value for k, m in modifier.inside.items() if m.value is not None}
        self.kind = Kind.UNKNOWN
        self.causality = ""
        self.flow = False
        self.connector = False
        self.output = False
        self.offset = -1
        self.structural = self.shaping = False
        self.computed = False
        self.is_node = False
        self.from_start = False
        self.unit = ""
        self.state_select = StateSelect.default

    @property
    def known(self) -> bool:
        """A constant or a parameter."""
        return self.kind <= Kind.PARAMETER

    @property
    def final(self) -> bool:
        """A parameter that cannot be given another value."""
        return self.kind == Kind.PARAMETER and (self.computed or self.modifier.final)

    @property
    def flow_from_outside(self) -> bool:
        """A flow that connections outside its part give: that of a port, or of a protected connector, which is zero.

        A protected connector that is connected to nothing is no more than its variables.
        """
        return self.flow and self.kind == Kind.UNKNOWN and (self.is_node or not self.hidden)

    @property
    def hidden(self) -> bool:
        """Return whether it is protected within its part, and belongs to no port of it."""
        node: InstanceNode = self
        while node is not self.parent.owner:
            if node.protected:
                return True
            node = node.parent
        return False


class Instance(InstanceNode):
    """An instance of a class with elements: the model, a part, a connector, a record."""

    def __init__(self, name, parent, dims, component, scope, protected, cls: Scope, kind: str, modifier: Modifier):
        super().__init__(name, parent, dims, component, scope, protected)
        self.cls = cls
        self.kind = kind
        self.modifier = modifier
        self.children: dict[str, InstanceNode] = {}
        self.part = 0
        # the part that a connector belongs to; a part itself
        self.owner: Instance = parent.owner if parent and kind in ("connector", "record") else self

    @property
    def connector(self) -> bool:
        return self.kind == "connector"

    @property
    def expandable(self) -> bool:
        """Return whether it is a connector that gets elements from what is connected to it."""
        return self.connector and self.cls.definition.expandable

    @property
    def inside_connector(self) -> bool:
        """Return whether it is a connector, or a record in one."""
        node: Instance | None = self
        while node is not None and not node.connector:
            node = node.parent if node.kind == "record" else None
        return node is not None

    @property
    def record_variability(self) -> str:
        """The variability that a record gives to its fields: those of a parameter record are parameters."""
        node: Instance | None = self
        while node is not None and node.kind == "record":
            if node.component.variability:
                return node.component.variability
            node = node.parent
        return ""

    def around(self, scope: Scope) -> Instance | None:
        """The nearest instance, this one or one around it, whose class contains the text of `scope`."""
        node: Instance | None = self
        while node is not None and not node.cls.is_made_of(scope):
            node = node.parent
        return node

    def variables(self) -> list[Variable]:
        """All variables below, in order of declaration."""
        found: list[Variable] = []
        for child in self.children.values():
            if child.parent is not self:
                continue  # an outer element: it is listed the current point
            if isinstance(child, Variable):
                found.append(child)
            elif isinstance(child, Instance):
                found += child.variables()
        return found

    def instances(self) -> list[Instance]:
        """All instances below, in order of declaration, itself first."""
        found = [self]
        for child in self.children.values():
            if isinstance(child, Instance) and child.parent is self:
                found += child.instances()
        return found


class Absent(InstanceNode):
    """A conditional component whose condition is false."""


class Broken(InstanceNode):
    """A declaration that is wrong, as has been said; whatever uses it is left out in silence."""

    def __init__(self, name: str, parent: Instance, component: tree.Component, scope: Scope):
        super().__init__(name, parent, (), component, scope)


def root_instance(cls: Scope, modifier: Modifier = NOTHING) -> Instance:
    """The instance of the model itself."""
    return Instance(cls.name, None, (), None, cls, False, cls, cls.kind, modifier)
