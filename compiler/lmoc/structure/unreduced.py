"""A flat model as it stands, for comparison: every equation and every variable, nothing eliminated.

Either the equations as they are written, whatever their index, or with the derivatives that the Σ-method asks for
(Pryce, BIT 41, 2001) and dummy derivatives chosen among all variables (Mattsson & Söderlind, SIAM J. Sci. Comput. 14,
1993).
"""

from __future__ import annotations

import numpy as np

from lmoc.expression.dag import sub
from lmoc.ir.flat import FlatDAE
from lmoc.ir.normalized import JetGroup, LongSums, Normalized
from lmoc.ir.program import Apply, Program, Total
from lmoc.ir.reduced import Reduced
from lmoc.structure.blocks.block_equations import SquareSystem
from lmoc.structure.coordinates.selection import Selection, select
from lmoc.structure.index.system import EquationSystem
from lmoc.structure.registers.assemble import Solved, assemble
from lmoc.structure.registers.layout import RegisterLayout
from lmoc.support.indices import INDEX, counted
from lmoc.support.records import dataclass


class SingularSystemError(Exception):
    """The equations do not determine all variables, as they stand."""


@dataclass(frozen=True, eq=False)
class Unreduced:
    """Equations left open: ``x' = derivatives``, ``0 = residual``.

    Attributes
    ----------
    reduced : the registers and what is known of them; its right-hand side fills the residuals
    unknown : registers that are neither states nor given, as many as residuals
    residual : registers
    """

    reduced: Reduced
    unknown: np.ndarray
    residual: np.ndarray


def as_written(flat: FlatDAE, values: np.ndarray) -> Unreduced:
    """Return the equations of a flat model as they are written.

    Raises
    ------
    SingularSystemError
    """
    system = EquationSystem(_as_it_stands(flat, values))
    if system.incidence.rows != system.incidence.columns:
        raise SingularSystemError("there are not as many equations as variables")
    d = np.zeros(len(system.variable), np.int64)
    np.maximum.at(d, system.incidence.column.astype(np.int64), system.incidence.order.astype(np.int64))
    batches, sums = system.differentiated(np.zeros(system.rows, np.int64))
    layout = RegisterLayout(system, d, system.highest_inputs(batches))
    variable, order = layout.jets
    is_state = (order < layout.width[variable] - 1) & (system.column[variable] >= 0)
    return _open(system, layout, SquareSystem(batches, sums, layout.base, layout.count), is_state)


def with_dummy_derivatives(flat: FlatDAE, values: np.ndarray) -> Unreduced:
    """Return the equations of a flat model with their derivatives, and dummy derivatives.

    Raises
    ------
    SingularSystemError
    """
    system = EquationSystem(_as_it_stands(flat, values))
    match = system.transversal()
    if match is None:
        raise SingularSystemError("the equations are structurally singular")
    selection = select(system, match, np.zeros(0, np.int64))
    if not isinstance(selection, Selection):
        raise SingularSystemError("some constraints follow from others")
    return _open(system, selection.layout, selection.square, selection.is_state)


def _as_it_stands(flat: FlatDAE, values: np.ndarray) -> Normalized:
    """Return a flat model as if everything had been eliminated that could be: nothing."""
    groups, first = [], 0
    for g in flat.groups:
        source = counted(first, first + len(g.slots))
        groups.append(JetGroup(sub(g.left, g.right), g.slots.astype(INDEX), source))
        first += len(g.slots)
    s = flat.sums
    rows = len(s.start) - 1
    sums = LongSums(s.start, s.index.astype(INDEX), np.zeros(len(s.index), INDEX), s.sign, first + np.arange(rows))
    nothing, own = np.full(flat.count, -1, INDEX), counted(0, flat.count)
    order = np.zeros(flat.count, INDEX)
    return Normalized(flat, values, (), np.zeros(0), own, order, nothing, nothing, tuple(groups), sums)


def _open(
    system: EquationSystem, layout: RegisterLayout, square: SquareSystem, is_state: np.ndarray
) -> Unreduced:
    program, residual = _residuals(square, layout.count)
    variable, _ = layout.jets
    unknown = np.flatnonzero((system.column[variable] >= 0) & ~is_state)
    if len(unknown) != len(residual):
        raise SingularSystemError("there are not as many equations as variables")
    solved = Solved(
        system=system,
        layout=layout,
        rhs=program,
        rest=(),
        states=np.flatnonzero(is_state),
        quadratures=np.zeros(0, np.int64),
        helpers=len(residual),
        guards=(),
        notes=(),
        guess=None,
        guess_at=None,
        constraints=None,
        invariants=None,
    )
    return Unreduced(assemble(solved), unknown, residual)


def _residuals(square: SquareSystem, first: int) -> tuple[Program, np.ndarray]:
    """Return the steps that compute how far each equation is from being satisfied, and their registers."""
    from lmoc.structure.linear.explicit import as_formula

    steps: list[Apply | Total] = []
    for rows in square.rows:
        steps.append(Apply(as_formula(rows.batch.shape)[0], rows.registers, first + rows.equations))
    for sums in square.sums:
        steps.append(Total(sums.sums.start, sums.registers, sums.sums.coefficient, first + sums.equations))
    return tuple(steps), first + np.arange(square.count)
