"""CVODE's Adams methods: few evaluations for smooth problems that are not stiff."""

from __future__ import annotations

from lmoc.numerics.integrate import cvode
from lmoc.numerics.integrate.base import Outcome, Problem

PROPERTIES = cvode.ADAMS


def integrate(problem: Problem) -> Outcome:
    """Integrate over the output times."""
    return cvode.integrate(problem, "adams")
