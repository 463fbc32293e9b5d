"""The equations of a page: those of motion in MathML; of a scene with laws, those of each mode that the run has met."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from lmoc import pipeline
from lmoc.ir.flat import FlatDAE
from lmoc.ir.prepared import Prepared
from lmoc.ir.program import Solve
from lmoc.ir.reduced import Reduced
from lmoc.messages.diagnostics import ModelError
from lmoc.report.result import Result
from lmoc.session import reduced_at, released_in_mode
from lmoc.support.records import dataclass

if TYPE_CHECKING:
    from lmoc.symbolic.sorting import Equation

MOST_DERIVED = 24  # states of a scene whose equations are derived for the page
MOST_CLOSED = 4  # unknowns of closed loops: with 6 (Andrews' mechanism) it takes more than half a minute


@dataclass(frozen=True, eq=False)
class PageEquations:
    """The equations of a page.

    Attributes
    ----------
    html : the equations, or why they are not shown
    modes : ({law: what its mode is called}, equations in it); None where there are no laws
    """

    html: str
    modes: tuple[tuple[Mapping[str, str] | None, tuple[Equation, ...]], ...] = ()


def page_equations(run: Result) -> PageEquations:
    """Return the equations, or why they are not shown."""
    count = len(run.reduced.states)
    if count > MOST_DERIVED:
        return PageEquations(f"<p>Not derived for the page: the scene has {count} states.</p>")
    try:
        prepared = _as_written(run)
        steps = prepared.reduced.rhs
        closed = sum(step.unknowns.size for step in steps if isinstance(step, Solve) and not step.linear)
        if closed > MOST_CLOSED:
            told = f"{closed} variables follow from the closing of loops"
            return PageEquations(f"<p>Not derived for the page: {told}.</p>")
        return _of_modes(prepared, run) if prepared.flat.laws else _of_motion(prepared)
    except ModelError as error:
        return PageEquations(f"<p>None that could be read: {escape(error.diagnostics[0].message)}.</p>")


def _of_motion(prepared: Prepared) -> PageEquations:
    from lmoc.symbolic.equations import equations_in_short

    found = equations_in_short(prepared, lambda: released_in_mode(prepared.reduced))
    return PageEquations(found.html(), ((None, found.equations),))


def _of_modes(prepared: Prepared, run: Result) -> PageEquations:
    from lmoc.symbolic.laws.equations import equations_of_modes, met_modes
    from lmoc.symbolic.laws.modes import Lawful

    lawful = Lawful(prepared, _reduced, released_in_mode, reduced_at)
    found = equations_of_modes(lawful, met_modes(run.trajectory))
    return PageEquations(found.html(), tuple((one.mode, one.equations.equations) for one in found.modes))


def _as_written(run: Result) -> Prepared:
    """Return the scene as it is in the text: with its laws, and with relations in place of discrete variables.

    Its coordinates are the fewest, in whatever coordinates of its loops it has been run.
    """
    origin = run.reduced.lawful or run.flat
    values = run.trajectory.observer.values[: origin.count]
    if origin.events is None:
        in_all = run.reduced.invariants is not None and run.reduced.constraints is None
        return Prepared(origin, _reduced(origin, values, None) if in_all else run.reduced, values)
    from lmoc.ir.written import as_written

    made = as_written(origin, values, run.reduced.discrete)
    return Prepared(made.flat, _reduced(made.flat, made.values, None), made.values)


def _reduced(flat: FlatDAE, values: np.ndarray, states: Sequence[str] | None) -> Reduced:
    return pipeline.reduce(flat, values, states, pipeline.Clock())
