"""Variables that the compiler adds where an expression needs one of its own: an argument of a law, a relation."""

from __future__ import annotations

from math import prod

from lmoc.expression.dag import Expr
from lmoc.ir.flat import Kind
from lmoc.semantics.classes.predefined import BUILTINS
from lmoc.semantics.nodes.instance import Instance, Variable
from lmoc.semantics.nodes.modification import NOTHING
from lmoc.semantics.values.rows import Index, Leaves, Space, positions

WEIGHT = "homotopy()"  # of the actual expressions of homotopies, beside their simplified ones


class Helpers:
    """The added variables of a model, in the order in which they were made."""

    def __init__(self) -> None:
        self.variables: list[Variable] = []
        self.before: dict[Variable, Variable] = {}  # pre(x) of x
        self.single: dict[str, Variable] = {}  # initial(), terminal() and the weight of homotopies, of the whole model

    def add(
        self,
        node: Instance,
        space: Space,
        leaves: Leaves,
        name: str,
        kind: Kind = Kind.UNKNOWN,
        type_: str = "Real",
    ) -> tuple[Variable, Index, Expr]:
        """Add one variable for each row of a space.

        Parameters
        ----------
        node, space, leaves : of the `Context` in which it is used

        Returns
        -------
        variable, positions : the variable, and which of its elements stands in each row
        slot : the column that holds them
        """
        around = node.total
        whole = space.whole and space.shape[: len(around)] == around
        dims = space.shape[len(around) :] if whole else (prod(space.shape),)
        made = Variable(name, node, dims, None, node.scope, True, BUILTINS[type_], NOTHING)
        if not whole:  # some rows only: numbered one after the other, whatever part they belong to
            made.total, made.path = dims, (((f"{node.label}.{name}" if node.label else name), dims),)
        made.kind = kind
        self.variables.append(made)
        if not made.total:
            return made, 0, leaves.slot(made, 0)
        index = positions(made.total)
        index = index if whole else index.reshape(space.shape)
        return made, index, leaves.slot(made, index)

    def pre(self, variable: Variable) -> Variable:
        """Return the variable that holds the value of another one before the present event."""
        made = self.before.get(variable)
        if made is None:
            name = f"pre({variable.name})"
            made = Variable(name, variable.parent, variable.dims, None, variable.scope, True, variable.type, NOTHING)
            made.unit = variable.unit
            made.kind = Kind.DISCRETE
            self.before[variable] = made
            self.variables.append(made)
        return made

    def of_model(self, root: Instance, name: str, kind: Kind = Kind.DISCRETE, type_: str = "Boolean") -> Variable:
        """Return a variable that the whole model has once."""
        made = self.single.get(name)
        if made is None:
            made = self.single[name] = Variable(name, root, (), None, root.scope, True, BUILTINS[type_], NOTHING)
            made.kind = kind
            self.variables.append(made)
        return made
