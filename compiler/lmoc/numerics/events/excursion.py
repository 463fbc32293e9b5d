"""How high a zero function that is at zero rises before it comes back, by its slope and its curvature.

Along the motion ``z(t + s) ≈ z + ż·s + z̈·s²/2``: where the curvature is against the slope, the function is back after
``-2·ż/z̈`` and has been as high as ``ż²/(2·|z̈|)``. Both derivatives are central differences, the slope along the tangent
of the motion, so that what does not move has a slope of exactly zero; the curvature along its parabola.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from lmoc.numerics.signals.signals import Signal
from lmoc.support.records import dataclass

if TYPE_CHECKING:
    from lmoc.numerics.events.layout import EventLayout


@dataclass(frozen=True, eq=False)
class Excursions:
    """The ways of zero functions from here on, each as if it began at zero.

    Attributes
    ----------
    slope : (zeros,) 1/s times the function's unit
    height : (zeros,) how far from zero it goes at the most; infinity where it does not come back
    back : (zeros,) s, after which it is at zero again; infinity where it does not come back
    """

    slope: np.ndarray
    height: np.ndarray
    back: np.ndarray


def excursions(
    layout: EventLayout, base: np.ndarray, signals: Mapping[int, Signal], t: float, x: np.ndarray, short: float
) -> Excursions:
    """Return the ways of all zero functions from a place on, by differences over a time.

    Parameters
    ----------
    base : (layout.count,) registers that do not change, with the discrete values
    short : s, over which the motion is smooth, and longer than what rounding makes of it
    """
    layout.rates.prepare(base, signals)
    layout.zeros.prepare(base, signals)
    rate = layout.rates(t, x).copy()
    bend = (layout.rates(t + short, x + short * rate).copy() - layout.rates(t - short, x - short * rate)) / (2 * short)
    here = layout.zeros(t, x).copy()
    ahead, behind = (layout.zeros(t + s, x + s * rate).copy() for s in (short, -short))
    slope = (ahead - behind) / (2 * short)
    on, back = (layout.zeros(t + s, x + s * rate + 0.5 * s * s * bend).copy() for s in (short, -short))
    curvature = (on - 2 * here + back) / short**2
    returns = slope * curvature < 0
    with np.errstate(divide="ignore", invalid="ignore"):
        height = np.where(returns, 0.5 * slope**2 / np.abs(curvature), np.inf)
        time = np.where(returns, -2.0 * slope / curvature, np.inf)
    return Excursions(slope, height, time)
