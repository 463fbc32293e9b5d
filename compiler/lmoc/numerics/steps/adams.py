"""CVODE's Adams methods: few evaluations for smooth problems that are not stiff."""

from __future__ import annotations

from lmoc.numerics.problem.base import Integration, Problem, Properties
from lmoc.numerics.steps import cvode

PROPERTIES = Properties(
    "adams", "Adams", "Adams", "1-12", "1-12", "SUNDIALS",
    good_for="costly smooth right-hand sides",
)  # fmt: skip


def begin(problem: Problem) -> Integration:
    """Return the method at the beginning of a problem.

    Raises
    ------
    NotFound
        The libraries are not at hand.
    """
    return cvode.begin(problem, "adams")
