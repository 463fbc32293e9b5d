"""The picture of whatever a scene gives: runs, several of them, linear models, transfer functions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from lmoc.report.compare import Comparison, compare
from lmoc.report.result import Result

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lmoc.symbolic.linearize import LinearModel
    from lmoc.symbolic.transfer import TransferFunction

    Shown = Result | Comparison | Mapping[str, Result] | Sequence[Result] | LinearModel | TransferFunction


def plot(shown: Shown, path: str | Path | None = None, kind: str = "", **options) -> Figure:
    """Draw a run, runs over each other, the modes of a linear model, or a transfer function.

    Parameters
    ----------
    shown : what `simulate`, `compare`, `linearize` or `transfer_function` return; runs also in a list or by name
    path : where to write the picture (.png, .svg, .pdf), if anywhere
    kind : "bode" (the default) or "step" of a transfer function
    options : `names`, `units` of runs; `title`, `units`, `hertz`, `decibels` of a frequency response

    Raises
    ------
    ModelError
        E0623, E0624: the picture cannot be written.
    TypeError, ValueError
        There is no picture of it, or not of that kind.
    """
    from lmoc.symbolic.linearize import LinearModel
    from lmoc.symbolic.transfer import TransferFunction

    kinds = ("bode", "step") if isinstance(shown, TransferFunction) else ()
    if kind and kind not in kinds:
        raise ValueError(f"there is no picture '{kind}' of it" + (f": it is {' or '.join(kinds)}" if kinds else ""))
    if isinstance(shown, TransferFunction):
        from lmoc.report.linear_plots import bode, step

        return (step if kind == "step" else bode)(shown, path, **options)
    if isinstance(shown, LinearModel):
        from lmoc.report.mode_plots import modes

        return modes(shown, path, **options)
    if isinstance(shown, Result):
        from lmoc.report.plots import plot as plot_run

        return plot_run(shown, path=path, **options)
    if isinstance(shown, Comparison):
        return shown.plot(path=path, **options)
    if isinstance(shown, Mapping | list | tuple):
        return compare(shown).plot(path=path, **options)
    raise TypeError(f"there is no picture of {type(shown).__name__}")
