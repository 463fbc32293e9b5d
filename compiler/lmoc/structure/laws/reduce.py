"""Reduction of scenes with laws: the free scene says what its coordinates are, the switched form has those states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lmoc.ir.flat import FlatDAE
from lmoc.ir.law import JENKINS, LawKind, Laws
from lmoc.ir.reduced import Reduced
from lmoc.messages.diagnostics import Report
from lmoc.structure.coordinates.shared import Shared
from lmoc.structure.laws.degree import NOT_FELT, relative_degree
from lmoc.structure.laws.switched import free, switched
from lmoc.structure.reduce import reduce


def reduce_with_laws(
    flat: FlatDAE,
    values: np.ndarray | None = None,
    states: Sequence[str] | None = None,
    report: Report | None = None,
    shared: Shared | None = None,
) -> Reduced:
    """Return the smallest system of a flat model, whatever laws it has; otherwise as `structure.reduce.reduce`.

    The result is that of the switched form: its flat model has a few variables more at the end of the table.

    Raises
    ------
    ModelError
        Through `report`: E0440 a law whose force does not act on its own motion, E0441 friction of a contact between
        springs alone.
    """
    if not flat.laws or flat.closed is not None:
        return reduce(flat, values, states, report, shared=shared)
    report = Report() if report is None else report
    given = flat.parameter_values() if values is None else values
    loose, loosened = free(flat)
    first = reduce(loose, loose.extended(given), states, report)
    report.check()
    degree = relative_degree(loosened, first)
    _report_not_felt(flat, degree, report)
    form, places = switched(flat, degree)
    named = [name for name in first.state_names if form.find(name) is not None]  # others are rates without a name
    reduced = reduce(form, form.extended(given), named, report)
    alike = _in_order_of(reduced, replace(first, switched=loosened))
    guards = reduced.guards if alike is None else (*reduced.guards, *alike.guards)
    return replace(reduced, switched=places, lawful=flat, free=alike, guards=guards)


def _in_order_of(reduced: Reduced, free: Reduced) -> Reduced | None:
    """Return the free scene in the order of the states of the switched form; None where these are not the same."""
    names = [[r.register_name(int(k)) for k in (*r.states, *r.quadratures)] for r in (reduced, free)]
    if sorted(names[0]) != sorted(names[1]) or free.guess is not None:
        return None
    first = len(free.states)
    order = np.array([names[1].index(name) for name in names[0]], int)
    states, quadratures = order[:first], order[first:] - first
    if (states >= first).any():
        return None
    return replace(
        free,
        states=free.states[states],
        derivatives=free.derivatives[states],
        quadratures=free.quadratures[quadratures],
        quadrature_derivatives=free.quadrature_derivatives[quadratures],
    )


def _report_not_felt(flat: FlatDAE, degree: np.ndarray, report: Report) -> None:
    first = 0
    for laws in flat.laws:
        own = degree[first : first + laws.rows]
        first += laws.rows
        for row in np.flatnonzero(own == NOT_FELT)[:1].tolist():
            _report_one(flat, laws, row, report)
        if laws.kind is LawKind.CONTACT_FRICTION and (own == JENKINS).any():
            _report_massless(flat, laws, report)
    report.check()


def _report_massless(flat: FlatDAE, laws: Laws, report: Report) -> None:
    report.error(
        "E0441",
        f"nothing between the contact '{flat.parts[laws.part].pattern}' and the springs around it has mass or damping",
        flat.parts[laws.part].span or laws.span,
        expected="friction whose sliding velocity its force changes through a mass or a damper",
        hint="give the point between the spring and the friction a small mass, or a damper beside the spring",
    )


def _report_one(flat: FlatDAE, laws: Laws, row: int, report: Report) -> None:
    force, motion = (flat.variable_name(int(v[row])) for v in (laws.force, laws.motion))
    report.error(
        "E0440",
        f"the force '{force}' of a law does not act on its own motion '{motion}'",
        laws.span,
        expected="a force that opens the gap, or slows the sliding, that it belongs to",
        hint="the ends may both be fixed or prescribed, or the force may enter no balance",
    )
