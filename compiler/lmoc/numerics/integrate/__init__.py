"""Integrators behind one interface, and the choice among them."""

from __future__ import annotations

from lmoc.numerics.integrate.base import Outcome, Problem, Properties
from lmoc.numerics.integrate.choice import run, table

__all__ = ["Outcome", "Problem", "Properties", "run", "table"]
