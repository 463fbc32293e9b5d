"""How the errors of steps add up over a run, and by what factor its tolerance is refined for that.

The bounds come from charts of speed against accuracy over the models (`benchmarks/auto.py`).
"""

from __future__ import annotations

import numpy as np

from lmoc.numerics.plan.linearity import is_linear
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.base import Outcome, Problem
from lmoc.numerics.steps.modes import Modes

CALIBRATED = 0.25  # factor on the tolerance of DOP853 for what is not linear: errors are then as asked for
NO_FINER = 1e-12  # than this, since rounding looks like an error where the equations are stiff
ADDED = 100.0, 1.0  # steps whose errors add up to what a tolerance promises, in linear motion in proportion, …
# … and in others by this power of their number: an error of the amplitude is one of the frequency, too, and the phase
# adds it up once more, so that it is between 1 and 2
DEPHASED = 60.0, 1.5
_ADDED_SERIES, _DEPHASED_SERIES = (1e4, 1.0), (100.0, 1.5)  # the same along a Taylor series, whose errors are smaller
WORTHWHILE = 0.5  # factor on the tolerance
LEAST_FACTOR = 1e-6  # on the tolerance; where the memory of a motion is not known …
LEAST_UNKNOWN = 0.1  # … this
FORGOTTEN = 3.0  # time constants of its slowest mode after which a motion has forgotten an error
_TIGHTER = 0.1  # factor on the tolerances of BDF, whose global error is larger than its local one by more than DOP853's
_PERIODS = 5.0  # of an undamped motion over which BDF then keeps the tolerance


def calibrated(plan: Plan) -> float:
    """Return the factor on the tolerance of DOP853 for runs in which few errors add up.

    The errors of a linear motion obey its own equations and do not outgrow it: over the models of the notes and the
    hard scenes they are below 20 times a tolerance of 1e-6 without a factor. Those of other motions may grow.
    """
    return 1.0 if plan.once(is_linear) else CALIBRATED


def calibration(problem: Problem) -> float:
    """Return the same, with which the tolerance is no finer than rounding lets it be."""
    return max(calibrated(problem.system.plan), min(1.0, NO_FINER / problem.rtol))


def growth(plan: Plan) -> tuple[float, float]:
    """Return how many steps of DOP853 keep the tolerance without a factor, and the power by which errors add up."""
    return ADDED if plan.once(is_linear) else DEPHASED


def refinement(problem: Problem, modes: Modes, mean: float, series: bool) -> float:
    """Return the factor on the tolerance with which the run as a whole keeps it.

    Parameters
    ----------
    mean : s, the length of the steps
    series : whether they are those of a Taylor series
    """
    linear = problem.system.plan.once(is_linear)
    added = (_ADDED_SERIES if linear else _DEPHASED_SERIES) if series else growth(problem.system.plan)
    length = problem.end - problem.t
    if refined(added, mean, length, None) == 1.0:  # whatever the motion forgets
        return 1.0
    return refined(added, mean, length, None if modes.values is None else modes.memory)


def refined(added: tuple[float, float], mean: float, length: float, memory: float | None) -> float:
    """Return the factor on the tolerance with which a run as a whole keeps it.

    Parameters
    ----------
    added : as of `growth`
    mean, length : s, of the steps and of the run
    memory : 1/s, rate at which the motion forgets an error; None where it is not known
    """
    steps, power = added
    least = LEAST_UNKNOWN if memory is None else LEAST_FACTOR
    if memory is not None and memory > 0:
        length = max(mean, min(length, FORGOTTEN / memory))
    factor = max(least, min(1.0, steps * mean / length) ** power)
    return factor if factor < WORTHWHILE else 1.0


def bdf_factor(problem: Problem, outcome: Outcome, jacobian: np.ndarray | None) -> float:
    """Return the factor on the tolerance of BDF, which loses more in each period that the motion remembers.

    Parameters
    ----------
    jacobian : where it begins; None where nothing is known of it
    """
    if jacobian is None:
        return _TIGHTER
    n, length = problem.system.plan.state_count, problem.end - outcome.time
    values = np.linalg.eigvals(jacobian[:n, :n])
    with np.errstate(divide="ignore"):
        memory = np.minimum(length, np.where(values.real < 0, -FORGOTTEN / values.real, np.inf))
    periods = float((memory * np.abs(values.imag)).max(initial=0.0)) / (2 * np.pi)
    return _TIGHTER * min(1.0, _PERIODS / max(periods, 1.0))
