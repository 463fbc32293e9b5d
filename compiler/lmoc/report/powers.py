"""Powers of ten at logarithmic axes, in plain characters: the style of pictures leaves formulas alone."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def label_powers(*axes: Axes) -> None:
    """Label the logarithmic ones among the axes by ``10⁻³``; between them, where there is room, by ``2×10⁻³``."""
    from matplotlib.ticker import LogFormatterSciNotation

    class Powers(LogFormatterSciNotation):
        """The labels of Matplotlib without its mark-up."""

        def __call__(self, x: float, pos: int | None = None) -> str:
            return plain(super().__call__(x, pos))

    for both in axes:
        for axis in (both.xaxis, both.yaxis):
            if axis.get_scale() == "log":
                axis.set_major_formatter(Powers())
                axis.set_minor_formatter(Powers(labelOnlyBase=False, minor_thresholds=(1, 0.4)))


def plain(text: str) -> str:
    r"""Return a label such as ``$\mathdefault{2\times10^{-3}}$`` as ``2×10⁻³``."""
    inner = re.sub(r"\^\{(-?\d+)\}", lambda found: found[1].translate(_RAISED), text)
    return inner.strip("$").replace(r"\mathdefault{", "").rstrip("}").replace(r"\times", "×").replace("−", "-")
