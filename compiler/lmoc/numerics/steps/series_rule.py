"""Whether a Taylor series is better than DOP853 in a run: by the scene and the steps of this run alone.

What other runs have left behind, in this process or in the cache, does not count, nor does the clock: the same run has
the same digits always.
"""

from __future__ import annotations

from lmoc.ir.program import Solve
from lmoc.lower.series import Series
from lmoc.numerics.evaluate.taylor_system import has_series, plan_series
from lmoc.numerics.problem.system import System

# Rows of equations up to which a series is faster from the first step on, whatever is in it: what a step takes beside
# the evaluation of its equations outweighs that, and a series does with a fifth of the steps.
SMALL = 60
# The same where no block of equations has to be solved, as orders of a block are: one after the other, and for each of
# them all that its residuals are of. Of Pleiades (119 rows) a single run takes 0.9 of the time of DOP853, one of an
# ensemble 0.7 at 1e-6 and 0.85 at 1e-9; of a chain of 24 cubic springs both take 1.0 at 1e-6 and 0.5 at 1e-9.
PLAIN = 150
# States up to which their modes are looked at in no time, so that a run may begin with a series. Where DOP853 has to
# begin, a short run has no use for one: chains of 60 springs (119 rows) took 5 times as long.
LOOKED_AT = 50
# In a larger scene, steps of DOP853 that a run must have had or still have ahead: before, it is not worth the change.
STEPS = 1_000
# Share of products and functions among the recurrences up to which a series is faster. A sum costs the same at each
# order, a product as much as there are orders below. Time of a series over that of DOP853 at 1e-4, 1e-6, 1e-8, 1e-10:
# suspension (a share of 0.13) 0.5, 0.6, 0.5, 0.4; Andrews (0.30) 1.5, 2.1, 1.7, 2.0; double pendulum (0.34) 1.4, 1.4,
# 1.3, 1.1; car axis (0.43) 4.2, 1.4, 1.1, 1.0; Pleiades (0.49) 11, 10, 7, 6.
SHARE = 0.25


def is_better(system: System, steps: float) -> bool:
    """Return whether a series does a run faster than DOP853.

    Parameters
    ----------
    steps : of DOP853 in this run, so far and ahead
    """
    small = _is_small(system)
    if steps < STEPS and not small:
        return False
    if not has_series(system):
        return False
    series = system.plan.once(plan_series)
    return small or (isinstance(series, Series) and series.share_of_products <= SHARE)


def _is_small(system: System) -> bool:
    plan = system.plan
    if plan.row_count <= SMALL or plan.row_count > PLAIN or system.n > LOOKED_AT:
        return plan.row_count <= SMALL
    return not any(isinstance(step, Solve) for step in plan.program)
