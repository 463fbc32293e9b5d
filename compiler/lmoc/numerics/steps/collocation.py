"""casadi's Gauss collocation of order 6 with steps of equal length, a run in one native call."""

from __future__ import annotations

from lmoc.numerics.problem.base import Outcome, Problem, Properties
from lmoc.numerics.steps import casadi_run

PROPERTIES = Properties(
    "collocation", "Gauss collocation", "collocation", "6", "–", "casadi",
    stability="A", implicit=True, symplectic=True, lengths="fixed", steps=False,
    needs="a small smooth scene without events; a step ends at every output time",
    good_for="comparisons: it is what casadi's users integrate by",
)  # fmt: skip


def integrate(problem: Problem) -> Outcome | None:
    """Integrate over the output times; None where casadi's method does not suit or has failed without a result."""
    return casadi_run.collocation(problem, "legendre")
