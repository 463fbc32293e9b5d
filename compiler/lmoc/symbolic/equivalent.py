"""Equivalent constants of a passive network between two of its ports: k_eq, c_eq, m_eq.

The flat equations are taken to the Laplace domain and solved for the displacement between the ports under a unit
force on them: its inverse is the dynamic stiffness ``Z(s) = m_eq·s² + c_eq·s + k_eq``. Where Z is no such polynomial,
a single spring, damper or inertia does not do, and Z itself is the answer.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lmoc.expression.to_sympy import lower
from lmoc.ir.flat import FlatDAE, Kind
from lmoc.messages.diagnostics import Diagnostic, ModelError, nearest
from lmoc.support.quoted import parent
from lmoc.support.records import dataclass
from lmoc.symbolic.elimination import Row, eliminate
from lmoc.symbolic.parameters import ParameterSymbols
from lmoc.symbolic.slope import slope
from lmoc.symbolic.sorting import lowest
from lmoc.symbolic.system import MOST_EQUATIONS, refuse

if TYPE_CHECKING:
    import sympy


@dataclass(frozen=True, eq=False)
class Equivalent:
    """The equivalent of a network between two ports.

    Attributes
    ----------
    dynamic_stiffness : Expr
        Force over displacement, in ``Symbol("s")``.
    stiffness, damping, inertia : Expr | None
        The constants, where one spring, damper and inertia side by side are equivalent; None where they are not.
    rotational : bool
        Torque over angle.
    """

    ports: tuple[str, str | None]
    dynamic_stiffness: sympy.Expr
    stiffness: sympy.Expr | None
    damping: sympy.Expr | None
    inertia: sympy.Expr | None
    rotational: bool = False

    def __str__(self) -> str:
        import sympy as sp

        from lmoc.symbolic.notation import Notation

        notation = Notation.of(self.dynamic_stiffness)
        named = {"k_eq": self.stiffness, "c_eq": self.damping, "J_eq" if self.rotational else "m_eq": self.inertia}
        found = [f"{name} = {notation.text(value)}" for name, value in named.items() if value]
        if found:
            return "\n".join([*found, *notation.legend()])
        quotient = notation.quotient(*sp.fraction(sp.cancel(self.dynamic_stiffness)), "s")  # type: ignore[call-arg]
        law = f"{'torque/angle' if self.rotational else 'force/displacement'} = {quotient}"
        return "\n".join([law, *notation.legend()])


def equivalent(flat: FlatDAE, values: np.ndarray, port: str, other: str | None = None) -> Equivalent:
    """Equivalent constants of the network seen at a port, against another port or against the ground.

    Parameters
    ----------
    flat : FlatDAE
    values : (flat.count,)
        Parameter values in force.
    port, other : names of connectors (``spring1.a``)

    Raises
    ------
    ModelError
        E0661 for a name that is no port, E0660 where the displacement is not determined by a linear law.
    """
    import sympy as sp

    if flat.equation_count > MOST_EQUATIONS:
        raise refuse(f"{flat.equation_count} equations are too many for equivalent constants in symbols")
    s = sp.Symbol("s")
    network = _Network(flat, ParameterSymbols(flat, values))
    seen = _port(flat, port)
    load = [(seen, 1)] + ([(_port(flat, other), -1)] if other else [])
    _check_alike(flat, [potential for (potential, _), _ in load], (port, other))
    rows, forced = network.rows(load)
    displacement = flat.count
    rows.append({displacement: sp.S.One} | {potential: sp.Integer(-sign) for (potential, _), sign in load})
    found = eliminate(rows, wanted=[displacement])
    compliance = _total(found.solution.get(displacement, {}), forced)
    if found.by_free.get(displacement, {None: None}) or any(_total(c, forced) != 0 for c in found.conditions):
        between = f"'{port}' and '{other}'" if other else f"'{port}' and the ground"
        raise refuse(f"no linear law ties the motion and the force between {between}")
    if compliance == 0:
        raise refuse(f"'{port}' is held: no force moves it")
    stiffness = sp.factor(sp.cancel(1 / compliance))
    rotational = flat.block_at(seen[1]).unit == "N.m"
    return Equivalent((port, other), stiffness, *_constants(stiffness, s), rotational)  # type: ignore[call-arg]


def _check_alike(flat: FlatDAE, potentials: list[int], names: tuple[str, str | None]) -> None:
    units = [flat.block_at(p).unit for p in potentials]
    if len(set(units)) > 1:
        raise refuse(
            f"'{names[0]}' moves in {units[0] or '1'} and '{names[1]}' in {units[1] or '1'}: no one law ties them"
        )


def _total(combination: Row, forced: dict[int, int]) -> sympy.Expr:
    import sympy as sp

    return sp.cancel(sum((c * forced[j] for j, c in combination.items() if j in forced), sp.S.Zero))


def _constants(stiffness: sympy.Expr, s: sympy.Symbol) -> tuple:
    import sympy as sp

    if sp.denom(sp.cancel(stiffness)).has(s) or sp.degree(sp.numer(sp.cancel(stiffness)), s) > 2:
        return None, None, None
    parts = [sp.cancel(stiffness).diff(s, n).subs(s, 0) / sp.factorial(n) for n in range(3)]
    return tuple(lowest(c) for c in parts)


def _port(flat: FlatDAE, name: str) -> tuple[int, int]:
    """(potential, flow) of a connector."""
    ports = {}
    for part in flat.parts:
        for p, f in part.ports:
            for i in range(flat.blocks[p].size):
                potential = flat.blocks[p].name(i)
                ports[parent(potential)] = (flat.blocks[p].offset + i, flat.blocks[f].offset + i)
    if name not in ports:
        raise ModelError([Diagnostic("E0661", f"there is no port '{name}'", hint=_port_hint(name, list(ports)))])
    return ports[name]


def _port_hint(name: str, ports: list[str]) -> str:
    """Suggest a port: for a part one of its own, for a variable one of the same part."""
    inside = [port for port in ports if port.startswith(f"{name}.")]
    beside = [port for port in ports if parent(port) == parent(name)]
    if inside:
        return f"'{name}' is a part; did you mean {' or '.join(inside[:6])}?"
    return nearest(name, ports) or f"there are {', '.join((beside or ports)[:6])}"


class _Network:
    """The linear flat equations in the Laplace domain, in deviations, sources at zero."""

    def __init__(self, flat: FlatDAE, parameters: ParameterSymbols):
        self.flat = flat
        self.parameters = parameters

    def rows(self, load: list[tuple[tuple[int, int], int]]) -> tuple[list[Row], dict[int, int]]:
        """Coefficients of each equation, and the load on those that balance the ports' flows.

        The load acts on a port from outside its part. There the flow into the part stands with a plus, in the sum of a
        connection or alone where nothing is connected; the port of a part with connections of its own stands in a
        second sum, seen from inside, with a minus (Modelica specification, 9.2).
        """
        flat = self.flat
        rows: list[Row] = []
        balance_of: dict[int, int] = {}
        for group in flat.groups:
            if group.origin == "ledger":
                continue
            for r in range(group.rows):
                row = self._row(group, r)
                if row:
                    if group.origin == "unconnected":
                        balance_of |= {v: len(rows) for v in row}
                    rows.append(row)
        for i in range(flat.sums.rows):
            part = slice(flat.sums.start[i], flat.sums.start[i + 1])
            row = {int(v): _number(sign) for v, sign in zip(flat.sums.index[part], flat.sums.sign[part], strict=True)}
            if all(flat.block_at(v).flow for v in row):
                balance_of |= {v: len(rows) for v, sign in row.items() if sign > 0}
            rows.append(row)
        forced: dict[int, int] = {}
        for (_, flow), sign in load:
            i = balance_of[flow]
            forced[i] = forced.get(i, 0) + sign
        return rows, forced

    def _row(self, group, r: int) -> Row:
        """Coefficients ``Σ_k ∂residual/∂x^(k)·s^k``; empty for an equation that is not linear (an energy)."""
        import sympy as sp

        s = sp.Symbol("s")
        columns = group.slots[r]
        place: dict[tuple[int, int], sympy.Dummy] = {}

        def column(k: int, order: int):
            v = int(columns[k])
            if self.flat.kind[v] in (Kind.CONSTANT, Kind.PARAMETER):
                return self.parameters[v]
            if self.flat.kind[v] != Kind.UNKNOWN:
                return sp.S.Zero
            return place.setdefault((v, order), sp.Dummy())

        residual = lower(group.residual, column)
        row: Row = {}
        jets = set(place.values())
        for (v, order), x in place.items():
            factor = slope(residual, x)
            if factor.free_symbols & jets:
                return {}
            row[v] = row.get(v, sp.S.Zero) + factor * s**order
        return row


def _number(sign: float):
    import sympy as sp

    return sp.Integer(int(sign))
