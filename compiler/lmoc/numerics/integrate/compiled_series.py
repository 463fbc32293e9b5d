"""Whether a Taylor series is better than DOP853 in a run: by the scene, the tolerance and the steps of this run alone.

What other runs have left behind, in this process or in the cache, does not count, nor does the clock: the same run has
the same digits always.
"""

from __future__ import annotations

from lmoc.numerics.evaluate.native.c_code import Unsupported
from lmoc.numerics.evaluate.native.compiler import find_compiler
from lmoc.numerics.evaluate.select import COMPILED_ROWS
from lmoc.numerics.evaluate.system import System
from lmoc.numerics.plan import Plan

# Steps of DOP853 that a run must have had or still have ahead for a series to be compiled. The compiler takes 0.3 s for
# a small scene, once: then as many steps by DOP853 take 40 ms, and 10 ms along the series. Where the equations are in C
# with the blocks that they solve, a step takes from 5 to 300 µs, and the series is compiled in 1 to 3 s.
STEPS, STEPS_IN_C = 5_000, 25_000
# Tolerance from which a series is faster although the equations are compiled for DOP853, too. Time of a series over
# that of DOP853 at 1e-4, 1e-6 and 1e-9: Andrews 1.8, 1.3, 1.0; car axis 1.0, 1.1, 0.9; elastic slider crank 1.1, 1.0,
# 0.6.
FINE = 1e-7


def is_better(system: System, rtol: float, steps: float) -> bool:
    """Return whether a series does a run faster than DOP853.

    Of many rows it is not: its coefficients of all registers do not stay in the cache. Time of a series at rtol 1e-9
    over that of DOP853, both in C, for 2000 states: chain 1.2, lattice 1.6, levers 1.6, network 1.7; more at 1e-4. Of
    200 states evaluated by casadi, 0.15; of the small scenes, 0.3 to 1.

    Parameters
    ----------
    rtol : of the steps of DOP853
    steps : of DOP853 in this run, so far and ahead
    """
    in_c = system.description == "C"
    if steps < (STEPS_IN_C if in_c else STEPS) or (in_c and rtol > FINE) or system.plan.row_count > COMPILED_ROWS:
        return False
    return find_compiler() is not None and system.plan.once(has_series)


def has_series(plan: Plan) -> bool:
    """Return whether a plan has a Taylor series in C; to be asked for by `Plan.once`."""
    from lmoc.numerics.evaluate.native.taylor_system import TaylorSystem

    try:
        plan.once(TaylorSystem)
    except (Unsupported, OSError):
        return False
    return True
