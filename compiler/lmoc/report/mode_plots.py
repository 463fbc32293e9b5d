"""The picture of a linear model: its eigenvalues in the complex plane, and the shapes of its modes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lmoc.report.files import PICTURES, check_target
from lmoc.report.plots import COLOURS, GREY, STYLE, head, literal, write

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from lmoc.symbolic.linearize import LinearModel

MOST_MODES = 6  # whose shapes are drawn
MOST_NAMED = 10  # coordinates named on the axis


def modes(model: LinearModel, path: str | Path | None = None, title: str = "") -> Figure:
    """Draw the eigenvalues of a model in numbers and the shapes of its slowest modes.

    A shape shows each coordinate's amplitude, the largest being 1, on the side of its phase: as the mode looks at
    the moment when that largest coordinate is at its extreme.

    Raises
    ------
    ModelError
        E0623, E0624: the picture cannot be written; E0660: a model in symbols.
    """
    if path is not None:
        check_target(Path(path), PICTURES)
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    chosen = [i for i, v in enumerate(model.eigenvalues) if v.imag >= 0][:MOST_MODES]
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(10, max(3.6, 1.0 + 1.1 * len(chosen))), dpi=150, layout="constrained")
        FigureCanvasAgg(figure)
        grid = figure.add_gridspec(max(1, len(chosen)), 2, width_ratios=[1, 1.2])
        _eigenvalues(figure.add_subplot(grid[:, 0]), model, chosen)
        above = None
        for row, i in enumerate(chosen):
            above = figure.add_subplot(grid[row, 1], sharex=above)
            _shape(above, model, i, COLOURS[row % len(COLOURS)], last=row == len(chosen) - 1)
        head(figure, f"{title}: modes of the linear model" if title else "Modes of the linear model")
        if path is not None:
            write(figure, Path(path))
    return figure


def _eigenvalues(axis: Axes, model: LinearModel, chosen: list[int]) -> None:
    """All of them, those whose shapes are drawn in the colours of these."""
    values = model.eigenvalues.astype(complex)
    axis.axhline(0, color="#bbbbbb", linewidth=0.8, zorder=0.5)
    axis.axvline(0, color="#bbbbbb", linewidth=0.8, zorder=0.5)
    others = np.delete(values, chosen)
    axis.plot(others.real, others.imag, "x", color=GREY, markersize=5)
    for row, i in enumerate(chosen):
        pair = np.array([values[i], values[i].conjugate()])
        axis.plot(pair.real, pair.imag, "x", color=COLOURS[row % len(COLOURS)], markersize=7, markeredgewidth=2)
    reach = float(np.abs(np.concatenate([values.real, values.imag])).max(initial=0.0)) or 1.0
    left = min(float(values.real.min(initial=0.0)) * 1.15, -0.15 * reach)
    right = max(float(values.real.max(initial=0.0)) * 1.15, 0.15 * reach)
    axis.set_xlim(left, right)
    axis.set_ylim(-1.15 * reach, 1.15 * reach)
    axis.set_xlabel("real part in 1/s")
    axis.set_ylabel("imaginary part in rad/s")


def _shape(axis: Axes, model: LinearModel, i: int, colour: str, last: bool) -> None:
    places = [q for q, _ in model.coordinates] or list(range(len(model.states)))
    shape = np.real(model.modes[places, i])
    at = np.arange(1, len(places) + 1)
    axis.axhline(0, color="#bbbbbb", linewidth=0.8, zorder=0.5)
    if len(places) <= MOST_NAMED:
        axis.vlines(at, 0, shape, color=colour, linewidth=1.6)
        axis.plot(at, shape, "o", color=colour, markersize=5)
        axis.set_xticks(at, [literal(model.states[q]) for q in places], fontsize=8)
        axis.set_xlim(0.5, len(places) + 0.5)
    else:
        axis.plot(at, shape, color=colour)
        if last:
            axis.set_xlabel(literal(f"coordinate, {model.states[places[0]]} to {model.states[places[-1]]}"))
    axis.tick_params(labelbottom=last)
    axis.set_ylim(-1.25, 1.25)
    axis.set_yticks([-1, 0, 1])
    axis.set_title(_told(model, i), loc="left", fontsize=8, color=colour, pad=2)


def _told(model: LinearModel, i: int) -> str:
    value, frequency, damping = model.eigenvalues[i], model.frequencies[i], model.dampings[i]
    if value == 0:
        return "rigid motion"
    if value.imag == 0:
        grows = "grows" if value.real > 0 else "decays"
        return f"{grows} with {abs(value.real):.4g}/s"
    return f"{frequency:.4g} rad/s, {frequency / (2 * np.pi):.4g} Hz, damping {damping + 0.0:.3g}"
