"""casadi's own IDAS: BDF for implicit systems, the whole trajectory in one native call."""

from __future__ import annotations

from lmoc.numerics.problem.base import Outcome, Problem, Properties
from lmoc.numerics.steps import casadi_run

PROPERTIES = Properties(
    "idas", "BDF", "BDF", "1-5", "1-5", "casadi",
    stability="A(α)", implicit=True, steps=False,
    good_for="small systems: a run is one call; ida takes over where steps are looked at",
)  # fmt: skip
INSTEAD = "ida"  # takes the runs that this one does not


def integrate(problem: Problem) -> Outcome | None:
    """Integrate over the output times; None where casadi's method does not suit or has failed without a result."""
    return casadi_run.integrate(problem, "idas", casadi_run.adaptive_options(problem))
