"""A lowered system as text, and the lowering of the default run that it is made of."""

from __future__ import annotations

from lmoc.ir.reduced import Reduced
from lmoc.ir.text.columns import aligned
from lmoc.ir.text.reduced import program_lines, register_patterns
from lmoc.messages.diagnostics import Report
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.system import System
from lmoc.numerics.run.simulate import Simulator
from lmoc.numerics.signals.signals import default_signals
from lmoc.numerics.steps.matrices import layout_of
from lmoc.support.records import dataclass


@dataclass(frozen=True, eq=False)
class LoweredText:
    """The system that a run with the model's own signals integrates."""

    reduced: Reduced
    plan: Plan
    system: System


def lower(reduced: Reduced, report: Report) -> LoweredText:
    """Lower a reduced system for a run with the model's own signals.

    Raises
    ------
    ModelError
        A signal is missing, or lacks a derivative.
    """
    simulator = Simulator(reduced)
    return LoweredText(reduced, *simulator.system(simulator.with_modes(default_signals(reduced.flat)), True, report))


def lowered_text(lowered: LoweredText) -> str:
    """Return how the derivatives are evaluated, and the shape of their Jacobian."""
    reduced, plan, system = lowered.reduced, lowered.plan, lowered.system
    _, indices = system.pattern()
    names = register_patterns(reduced, plan.states)
    rows = [
        ("evaluated by", system.description),
        ("integrated", f"{system.n}: {', '.join(names)}"),
        ("of which", f"{plan.state_count} states, {system.n - plan.state_count} quadratures"),
        ("parameters", str(len(plan.parameters))),
        ("operations", f"{plan.row_count} scalar equations in {len(plan.program)} steps"),
        ("Jacobian", f"{len(indices)} entries; stored by an implicit method as {layout_of(system, plan).text}"),
    ]
    function = getattr(system, "function", None)
    if function is None or plan.row_count > 500:
        program = program_lines("steps", reduced, plan.program)
    else:
        program = ["casadi function", *(f"    {line}" for line in function.str(True).splitlines())]
    return "\n".join([reduced.flat.name, *aligned(rows), "", *program])
