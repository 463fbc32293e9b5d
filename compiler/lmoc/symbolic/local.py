"""The behaviour of each part by itself: its flows from the motion of its ports, without any balance of forces.

The flat equations without the connections are solved forwards from the potentials: ``extension = b.q − a.q``, then
``f = k·extension``, then ``a.f = −f``; a mass gives ``flange.f = m·a − m·g`` with the acceleration as a symbol. Flows
that only a balance can give (in a rod, between gears) stay unknown, tied to each other by linear relations.
"""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING

from lmoc.expression.calculus import differentiate
from lmoc.expression.dag import Expr, postorder, slots
from lmoc.expression.to_sympy import lower
from lmoc.ir.flat import FlatDAE, Group, Kind
from lmoc.symbolic.elimination import Eliminated, eliminate
from lmoc.symbolic.kinematics import Kinematics
from lmoc.symbolic.names import base_of
from lmoc.symbolic.slope import slope

if TYPE_CHECKING:
    import sympy

BALANCES = ("connection", "ledger")


class PartLaws:
    """Expressions of flat variables by the parts' own equations.

    Parameters
    ----------
    flat : FlatDAE
    kinematics : Kinematics
        Gives the known variables (parameters, inputs, potentials, states) and total time derivatives.

    Attributes
    ----------
    unknown : set of int
        Variables that no part gives by itself.
    relations, closed : lists of int
        Rows with such variables, and rows in which everything is known: identities, or equations of motion.
    """

    def __init__(self, flat: FlatDAE, kinematics: Kinematics):
        self.flat = flat
        self.kinematics = kinematics
        own = [(g, r) for g in flat.groups if g.origin not in BALANCES for r in range(g.rows)]
        curves = kinematics.curves
        self.rows = own if curves is None else [(g, r) for g, r in own if not curves.defined_by(g, r)]
        self._cause: dict[int, int] = {}  # variable -> the row that gives it
        self._value: dict[int, sympy.Expr] = {}
        self._plain: dict[tuple, bool] = {}
        self._order()

    def _order(self) -> None:
        """Assign rows to variables: rows with one variable left, repeatedly.

        A definition, ``dy = l·sin(theta)``, before a row in which the variable only occurs, ``b.y = a.y + dy``: around
        a loop both give it, and the definition is what a person would read.
        """
        open_of: list[set[int]] = []
        waiting: dict[int, list[int]] = defaultdict(list)
        for i, (group, row) in enumerate(self.rows):
            variables = {int(group.slots[row][s.value[0]]) for s in _leaves(group)}
            left = {v for v in variables if self._is_unknown(v)}
            open_of.append(left)
            for v in left:
                waiting[v].append(i)
        ready: tuple[list[int], list[int]] = ([], [])

        def queue(i: int) -> None:
            (v,) = open_of[i]
            ready[self._defines(i, v)].append(i)

        for i, left in enumerate(open_of):
            if len(left) == 1:
                queue(i)
        while ready[0] or ready[1]:
            i = (ready[1] or ready[0]).pop()
            if len(open_of[i]) != 1:
                continue
            (v,) = open_of[i]
            if v in self._cause or not self._gives(i, v):
                continue
            self._cause[v] = i
            for j in waiting[v]:
                open_of[j].discard(v)
                if len(open_of[j]) == 1:
                    queue(j)
        self.unknown = {v for left in open_of for v in left}
        self.relations = [i for i, left in enumerate(open_of) if left]
        causes = set(self._cause.values())
        self.closed = [i for i, left in enumerate(open_of) if not left and i not in causes]

    def _is_unknown(self, variable: int) -> bool:
        return self.flat.kind[variable] == Kind.UNKNOWN and variable not in self.kinematics.known

    def _defines(self, i: int, variable: int) -> bool:
        """Return whether a row says what a variable is: ``variable = …``."""
        group, row = self.rows[i]
        left = group.left
        return left.op == "slot" and left.value[1] == 0 and int(group.slots[row][left.value[0]]) == variable

    def _gives(self, i: int, variable: int) -> bool:
        """Return whether a row is solved for a variable without dividing by what moves."""
        group, row = self.rows[i]
        leaves = [s for s in _leaves(group) if group.slots[row][s.value[0]] == variable]
        return all(s.value[1] == 0 and self._is_plain(group, s) for s in leaves)

    def _is_plain(self, group: Group, leaf: Expr) -> bool:
        """Return whether only numbers and parameters multiply a variable in the equations of a group."""
        key = id(group), leaf
        if key not in self._plain:
            factor = differentiate(group.residual, leaf)
            kinds = [self.flat.kind[group.slots[0][s.value[0]]] for s in slots(factor)]
            known = all(kind in (Kind.CONSTANT, Kind.PARAMETER) for kind in kinds)
            self._plain[key] = known and not any(node.op == "time" for node in postorder(factor))
        return self._plain[key]

    def value(self, variable: int) -> sympy.Expr:
        """Expression of a variable in jets of the coordinates; unknown flows stand as themselves."""
        if variable not in self._value:
            self._value[variable] = self._evaluate(variable)
        return self._value[variable]

    def _evaluate(self, variable: int) -> sympy.Expr:
        import sympy as sp

        if not self._is_unknown(variable):
            return self.kinematics.value(variable)
        if variable not in self._cause:
            return self.symbol(variable)
        x = sp.Dummy()
        self._value[variable] = x
        residual = self.residual(self._cause[variable])
        factor = slope(residual, x)
        if factor.has(x) or factor == 0:
            raise NotLinearError(self.flat.variable_name(variable))
        return -residual.xreplace({x: sp.S.Zero}) / factor

    def same_as(self, variable: int) -> int | None:
        """The other variable of a relation that says no more than that two are equal."""
        for i in self.relations:
            group, row = self.rows[i]
            pair = group.slots[row].tolist()
            if len(pair) == 2 and variable in pair and group.left.op == group.right.op == "slot":
                return pair[1 - pair.index(variable)]
        return None

    def symbol(self, variable: int) -> sympy.Symbol:
        import sympy as sp

        return sp.Symbol(self.flat.variable_name(variable))

    def residual(self, i: int) -> sympy.Expr:
        group, row = self.rows[i]
        columns = group.slots[row]

        def column(k: int, order: int) -> sympy.Expr:
            value = self.value(int(columns[k]))
            for _ in range(order):
                value = self.kinematics.rate(value)
            return value

        return lower(group.residual, column)

    def solve_relations(
        self, balances: bool = False, massless: bool = False
    ) -> tuple[Eliminated, dict[int, sympy.Expr], list[sympy.Expr]]:
        """Eliminate unknown flows by the relations among them.

        Parameters
        ----------
        balances : bool
            With the connections' sums: then every flow that is determined gets a value.
        massless : bool
            Of the sums only those in which nothing accelerates.

        Returns
        -------
        (elimination, symbols of the unknowns, right-hand sides)
        """
        import sympy as sp

        residuals = [self.residual(i) for i in self.relations]
        unknown = set(self.unknown)
        if balances:
            sums = self.flat.sums
            for r in range(sums.rows):
                part = slice(sums.start[r], sums.start[r + 1])
                pairs = list(zip(sums.index[part].tolist(), sums.sign[part].tolist(), strict=True))
                if all(self.flat.block_at(v).flow for v, _ in pairs):
                    total = sp.Add(*(int(sign) * self.value(v) for v, sign in pairs))
                    if massless and any(base_of(s.name)[1] >= 2 for s in total.free_symbols):
                        continue
                    residuals.append(total)
                    unknown |= {v for v, _ in pairs if self._is_unknown(v) and v not in self._cause}
        unknowns = {v: self.symbol(v) for v in sorted(unknown)}
        zero = {s: sp.S.Zero for s in unknowns.values()}
        rows, right = [], []
        for residual in residuals:
            present = {v: slope(residual, s) for v, s in unknowns.items() if residual.has(s)}
            if present and not any(c.free_symbols & zero.keys() for c in present.values()):
                rows.append(present)
                right.append(-residual.xreplace(zero))
        return eliminate(rows), unknowns, right


class NotLinearError(Exception):
    """A part's law cannot be solved for its flow."""


def _leaves(group: Group):
    return {*slots(group.left), *slots(group.right)}
