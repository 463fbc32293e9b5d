"""How accurately an FMU integrates by itself: as `simulate` does, whose rules say how errors of steps add up."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.run.segments import FINER
from lmoc.numerics.steps.added_errors import calibrated, growth, refined
from lmoc.view.javascript.accuracy import refinement

if TYPE_CHECKING:
    from lmoc.dae import CompiledDAE
    from lmoc.run import Run


def step_factor(dae: CompiledDAE, plan: Plan, run: Run, inputs: Mapping[str, float]) -> float:
    """Return the factor on the tolerance of DOP853's steps with which the experiment as a whole keeps it.

    Where the scene has turned out to be stiff, nothing is said of how many steps there are.

    Parameters
    ----------
    run : of the experiment
    """
    method, factor = str(run.stats["solver"]), calibrated(plan)
    if plan.reduced.in_all_coordinates:
        factor *= FINER  # as a run behind a change of coordinates
    if not set(method.split(", ")) <= {"dop853", "taylor"} or not len(plan.states):
        return factor
    # with laws or events a run is in minimal coordinates
    smooth = plan.reduced.switched is None and plan.reduced.flat.events is None
    formulation = "projected" if plan.reduced.in_all_coordinates and smooth else "auto"
    if method != "dop853" or formulation != "auto":  # a series has fewer steps
        run = dae.simulate(points=2, energy=False, inputs=inputs, solver="dop853", formulation=formulation)
    first = run.trajectory.segments[0]
    slowest = refinement(first.observer, float(first.time[0]), first.table[0])["slowest"]
    length = float(run.trajectory.planned) - float(run.time[0])
    return factor * refined(growth(plan), length / max(1, run.stats["steps"]), length, slowest)
