"""The picture of a run: signals in stacked panels by unit, and what became of the energy."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lmoc.ir.flat import Kind
from lmoc.ir.names import names_of
from lmoc.messages.diagnostics import Diagnostic, ModelError
from lmoc.report.display import Display, display
from lmoc.report.events import mark_events
from lmoc.report.files import PICTURES, check_target
from lmoc.support.replacing import replace_file
from lmoc.symbolic.styles import unit_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from lmoc.report.result import Result

# Okabe and Ito's colours, distinguishable with any colour vision, the pale yellow left out
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#444444")
GREY = "#555555"
MOST_LABELLED = 10  # curves of a panel with names of their own; more are a family with a colour scale
MOST_CURVES = 200
MOST_NAMED = 3  # curves that name their axis
LONGEST = 36  # characters of a name
LONGEST_TITLE = 100
MOST_PANELS = 5  # of those shown by default
FLAT = 1e-3  # of the energy that moves between the stores: what changes by less is drawn as a flat line

STYLE = {
    "font.size": 9,
    "font.family": "DejaVu Sans",
    "text.parse_math": False,  # a user's names may hold dollar signs
    "axes.edgecolor": "#999999",
    "axes.labelcolor": GREY,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.7,
    "axes.axisbelow": True,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "lines.linewidth": 1.6,
    "svg.fonttype": "none",
}
QUANTITIES = {
    "m": "position", "mm": "position", "cm": "position", "km": "position",
    "m/s": "velocity", "km/h": "velocity", "m/s2": "acceleration", "N": "force", "kN": "force",
    "rad": "angle", "deg": "angle", "rad/s": "angular velocity", "rpm": "speed of rotation", "Hz": "frequency",
    "rad/s2": "angular acceleration", "N.m": "torque", "N.s": "impulse", "J": "energy", "kJ": "energy", "W": "power",
    "kW": "power", "1": "ratio", "kg": "mass", "s": "time", "Pa": "pressure", "K": "temperature", "degC": "temperature",
    "A": "current", "V": "voltage", "C": "charge", "Wb": "flux", "T": "flux density", "m2": "area", "m3": "volume",
    "m3/s": "flow", "kg/s": "mass flow", "N/m": "stiffness", "N.s/m": "damping",
}  # fmt: skip
DASHES = ("-", "--", ":")  # where there are more curves than colours


def plot(
    run: Result,
    names: str | Sequence[str] | None = None,
    path: str | Path | None = None,
    units: str | Sequence[str] | None = None,
) -> Figure:
    """Draw a run.

    Parameters
    ----------
    names : what to show, one name or several; by default the outputs, else the states, the inputs that change, and
        the energy
    path : where to write the picture (.png, .svg, .pdf), if anywhere
    units : in which to show quantities (`display`)

    Raises
    ------
    ModelError
        E0623, E0624: the picture cannot be written, or there is nothing to draw; E0629: an unknown unit.
    UnknownNameError
        One of the names is not in the model.
    """
    if path is not None:
        check_target(Path(path), PICTURES)
    shown, run = display(units), run.fine
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        panels = group_by_unit(run, choose(run) if names is None else names_of(names))
        left = panels[MOST_PANELS:] if names is None else []
        panels = panels[: len(panels) - len(left)]
        ledger = names is None and _has_ledger(run)
        heights = [1.0] * len(panels) + [0.8] * ledger
        if not heights:
            message = f"there is nothing to draw: {run.flat.name} has no output, state or input"
            raise ModelError([Diagnostic("E0623", message, hint="name variables to draw")])
        figure = Figure(figsize=(9, 1.1 + 1.9 * sum(heights)), dpi=150, layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
        for axis, (unit, members) in zip(axes, panels, strict=False):
            _signals(axis, run, unit, members, shown)
        if ledger:
            _energy(axes[-1], run, shown)
        for axis in axes:
            axis.margins(x=0)
        more = f"   (not shown: {', '.join(name for _, members in left for name in members[:2])} …)" if left else ""
        axes[-1].set_xlabel(f"time in s{more}")
        head(figure, _title(run))
        figure.align_ylabels()
        if path is not None:
            write(figure, Path(path))
    return figure


def stacked(panels: int, path: str | Path | None, title: str, share: bool = True) -> tuple[Figure, tuple[Axes, ...]]:
    """Return a figure of panels one below the other, with one abscissa.

    Parameters
    ----------
    path : where the picture will be written (`finished`), if anywhere
    share : whether the panels have one abscissa

    Raises
    ------
    ModelError
        E0623, E0624: it could not be written there.
    """
    if path is not None:
        check_target(Path(path), PICTURES)
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(8, 1.4 + 2.2 * panels), dpi=150, layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(panels, 1, sharex=share, squeeze=False)[:, 0]
        head(figure, title)
    return figure, tuple(axes)


def finished(figure: Figure, path: str | Path | None) -> Figure:
    """Align a figure's panels and write it where it shall be."""
    for axis in figure.axes:
        axis.margins(x=0)
    figure.align_ylabels()
    if path is not None:
        write(figure, Path(path))
    return figure


def shortened(text: str, most: int = LONGEST) -> str:
    """Return a text without its middle where it is longer than there is room for."""
    return literal(text if len(text) <= most else f"{text[: most // 2]}…{text[-(most // 2 - 1) :]}")


def literal(text: str) -> str:
    """Return a text as matplotlib can show it; dollar signs are no formulas there (`STYLE`)."""
    return "".join(sign if sign.isprintable() else "·" for sign in text)


def head(figure: Figure, title: str) -> None:
    figure.suptitle(shortened(title, LONGEST_TITLE), x=0.01, ha="left", fontsize=11, fontweight="bold", color="#222222")


def choose(run: Result) -> list[str]:
    """Return the default variables of a picture: those kept, else the outputs or the states, and the inputs."""
    if run.kept is not None:
        return list(run.kept)
    registers = run.reduced.states
    some = registers if len(registers) <= MOST_CURVES else registers[_spread(len(registers), MOST_CURVES)]
    shown = run.outputs or [run.reduced.register_name(int(r)) for r in some]
    return [*shown, *(name for name in _moving_inputs(run) if name not in shown)]


def _moving_inputs(run: Result) -> list[str]:
    """Top-level inputs that change during the run: what the motion answers to, the modes of laws left out."""
    form = run.reduced.switched
    held = set() if form is None else {int(v) for own in (form.closed, form.push, form.direction) for v in own}
    names = [
        b.name(i)
        for b in run.flat.blocks
        if b.kind == Kind.INPUT
        for i in range(min(b.size, MOST_CURVES))
        if b.offset + i not in held
    ]
    return [name for name in names if np.ptp(run[name]) > 0]


def group_by_unit(run: Result, names: Sequence[str]) -> list[tuple[str, list[str]]]:
    """Names in panels of one unit each, in order of appearance; arrays by their members."""
    panels: dict[str, list[str]] = {}
    for name in names:
        found = run.flat.find(name)
        members = [name] if found is None or len(found) == 1 else [run.flat.variable_name(int(v)) for v in found]
        panels.setdefault(run.unit(members[0]), []).extend(members)
    return list(panels.items())


def _title(run: Result) -> str:
    text = run.flat.description or run.flat.name
    return text + ("" if run.complete else f" (failed at t = {run.broke_off:g} s)")


def _has_ledger(run: Result) -> bool:
    e = run.energy
    if e is None or len(run.time) < 2 or not np.isfinite(e.balance):
        return False
    return bool(e.stored.any() or e.supplied.any() or e.lost.any())


def _signals(axis: Axes, run: Result, unit: str, names: list[str], display: Display) -> None:
    shown = names if len(names) <= MOST_CURVES else [names[k] for k in _spread(len(names), MOST_CURVES)]
    if len(shown) <= MOST_LABELLED:
        for k, name in enumerate(shown):
            colour, dashes = COLOURS[k % len(COLOURS)], DASHES[k // len(COLOURS)]
            axis.plot(run.time, display.value(run[name], unit), color=colour, linestyle=dashes, label=shortened(name))
        _legend(axis)
    else:
        _family(axis, run, shown, len(names), lambda name: display.value(run[name], unit))
    axis.set_ylabel(_axis_label(display.unit(unit), names))
    mark_events(axis, run.events)
    _rest_line(axis)


def _family(
    axis: Axes, run: Result, names: list[str], total: int, values: Callable[[str], np.ndarray]
) -> None:
    """Many curves: coloured by their place in the list, with the first and the last named."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    colours = colormaps["viridis"]
    for k, name in enumerate(names):
        axis.plot(run.time, values(name), color=colours(0.95 * k / (len(names) - 1)), linewidth=0.8, alpha=0.8)
    beside = axis.inset_axes((1.012, 0.05, 0.012, 0.9))
    scale = axis.figure.colorbar(ScalarMappable(Normalize(0, 1), colours), cax=beside)
    scale.set_ticks([0.01, 0.99], labels=[shortened(names[0]), shortened(names[-1])])
    scale.outline.set_visible(False)
    scale.ax.tick_params(length=0)
    if total > len(names):
        axis.set_title(f"{len(names)} of {total} signals", loc="right", fontsize=8, color=GREY)


def _energy(axis: Axes, run: Result, display: Display) -> None:
    energy = run.energy
    supplied, lost, change = (
        display.value(e, "J") for e in (energy.supplied, energy.lost, energy.stored - energy.stored[0])
    )
    axis.plot(run.time, supplied, color=COLOURS[0], label="supplied")
    axis.plot(run.time, lost, color=COLOURS[1], label="lost")
    axis.fill_between(run.time, change, color=COLOURS[2], alpha=0.18, linewidth=0)
    axis.plot(run.time, change, color=COLOURS[2], label="stored since start")
    axis.set_ylabel(f"energy in {display.unit('J')}")
    _legend(axis, f"balance error {energy.balance:.0e}")
    scale = display.value(energy.scale, "J")
    if np.ptp(axis.get_ylim()) < FLAT * scale:  # rounding, and not to be looked at through a magnifier
        axis.set_ylim(-scale / 10, scale / 10)
    _rest_line(axis)


def _legend(axis: Axes, title: str | None = None) -> None:
    axis.legend(
        loc="center left", bbox_to_anchor=(1.005, 0.5), frameon=False, title=title, title_fontsize=8, alignment="left",
        labelcolor="#222222", handlelength=1.4, borderaxespad=0,
    )  # fmt: skip


def _rest_line(axis: Axes) -> None:
    """A faint line at zero where zero is in sight; a constant signal gets some room."""
    low, high = axis.get_ylim()
    if math.isclose(low, high):
        axis.set_ylim(low - 1, high + 1)
    if low < 0 < high:
        axis.axhline(0, color="#bbbbbb", linewidth=0.8, zorder=0.5)


def _axis_label(unit: str, names: Sequence[str]) -> str:
    """Quantity and unit; where neither is known, what the curves are called."""
    quantity = QUANTITIES.get(unit) or (", ".join(map(shortened, names)) if len(names) <= MOST_NAMED else "")
    return f"{quantity} in {unit_text(unit)}" if quantity and unit else quantity or unit_text(unit) or "values"


def _spread(total: int, most: int) -> list[int]:
    return np.unique(np.linspace(0, total - 1, most).round().astype(int)).tolist()


def write(figure: Figure, path: Path) -> None:
    """Write a picture; E0623 where the system refuses."""
    import warnings
    from io import BytesIO

    picture = BytesIO()  # matplotlib's own writers of files do not all survive a full disk
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from font")  # the picture has boxes in their place
        figure.savefig(picture, format=path.suffix[1:].lower())
    try:
        replace_file(path, lambda target: target.write_bytes(picture.getvalue()))
    except OSError as error:
        reason = error.strerror or error
        raise ModelError([Diagnostic("E0623", f"'{path}' cannot be written: {reason}")]) from None
