"""Which integrator, and why."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module

from lmoc.numerics.integrators.base import Outcome, Problem, Properties

_MODULES = {"dop853": "dop853"}


def table() -> tuple[Properties, ...]:
    """What each integrator can do."""
    return tuple(_module(name).PROPERTIES for name in _MODULES)


def _module(name: str):
    return import_module(f"lmoc.numerics.integrators.{_MODULES[name]}")


def integrator(name: str) -> Callable[[Problem], Outcome]:
    return _module(name).integrate


def run(problem: Problem, solver: str) -> tuple[Outcome, dict[str, object]]:
    """Integrate with a named solver, or with the one that suits.

    Returns
    -------
    The outcome, and the statistics: which solver, and why.
    """
    if solver != "auto":
        return integrator(solver)(problem), {"solver": solver, "reason": "asked for"}
    return integrator("dop853")(problem), {"solver": "dop853", "reason": "not stiff"}
