"""Whether a Taylor series is better than DOP853 in a run, its compilation included.

To compile a series takes as long as many short runs. So it is compiled when the runs of a scene, with what lies ahead,
have cost as much: whatever follows, all runs together cost at most twice what the better choice would have (Karlin,
Manasse, Rudolph and Sleator, Competitive snoopy caching, Algorithmica 3, 1988). The same runs in the same order always
lead to the same choices.
"""

from __future__ import annotations

from lmoc.numerics.evaluate.native.compiler import find_compiler
from lmoc.numerics.evaluate.select import COMPILED_ROWS
from lmoc.numerics.evaluate.system import System
from lmoc.numerics.plan import Plan
from lmoc.support.records import dataclass

# Steps of DOP853 that cost as much as to compile a series. Where Python makes them one takes about 8 µs, and longer
# the more there is to evaluate; the compiler takes 0.25 s, and longer likewise.
STEPS = 25_000
# Tolerance from which a series is faster although the equations are compiled for DOP853, too. Time of a series over
# that of DOP853 at 1e-4, 1e-6 and 1e-9: Andrews 1.8, 1.3, 1.0; car axis 1.0, 1.1, 0.9; elastic slider crank 1.1, 1.0,
# 0.6.
FINE = 1e-7


@dataclass
class Series:
    """The Taylor series of a plan, as far as it concerns the choice of a method.

    Attributes
    ----------
    steps : that DOP853 has made so far in its place
    compiled : it has been
    refused : there is none, or none in C
    """

    steps: int = 0
    compiled: bool = False
    refused: bool = False


def series(plan: Plan) -> Series:
    """Return what is known of the series of a plan; to be asked for by `Plan.once`."""
    return Series()


def is_better(system: System, rtol: float, ahead: float = 0.0) -> bool:
    """Return whether a series does a run faster than DOP853.

    Of many rows it is not: its coefficients of all registers do not stay in the cache. Time of a series at rtol 1e-9
    over that of DOP853, both in C, for 2000 states: chain 1.2, lattice 1.6, levers 1.6, network 1.7; more at 1e-4. Of
    200 states evaluated by casadi, 0.15; of the small scenes, 0.3 to 1.

    Parameters
    ----------
    rtol : of the steps of DOP853
    ahead : steps that DOP853 would make
    """
    own = system.plan.once(series)
    if find_compiler() is None or own.refused or system.plan.row_count > COMPILED_ROWS:
        return False
    if system.description == "C" and rtol > FINE:
        return False
    return own.compiled or own.steps + ahead >= STEPS
