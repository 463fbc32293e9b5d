"""A picture as PNG or PDF, painted by matplotlib."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmoc.view.scene.picture import Circle, Frame, Label, Path, Picture
from lmoc.view.scene.text import LOWERED, RAISED, SMALL, runs, width

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK = {"ink": "#1b1b1b", "muted": "#888888", "force": "#c2410c", "string": "#8a6d3b", "accent": "#0072b2"}
FILL = {"body": (0.357, 0.553, 0.749, 0.28), "ground": (0.53, 0.53, 0.53, 0.35), "paper": "#ffffff"}
POINT = 72.0 / 96.0  # pt per px


def figure(picture: Picture, scale: float = 2.0) -> Figure:
    """Return a picture as a matplotlib figure of its own size, `scale` dots a px."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with matplotlib.rc_context({"font.family": "DejaVu Sans", "text.parse_math": False, "text.usetex": False}):
        made = Figure(figsize=(picture.width / 96, picture.height / 96), dpi=96 * scale)
        FigureCanvasAgg(made)
        axes = made.add_axes((0, 0, 1, 1))
        axes.set_axis_off()
        axes.set_xlim(0, picture.width)
        axes.set_ylim(picture.height, 0)
        for order, (_, shape, frame) in enumerate(picture.placed()):
            _paint(axes, shape, frame, order)
    return made


def _paint(axes: Axes, shape: Path | Circle | Label, frame: Frame, order: int) -> None:
    from matplotlib import patches

    if isinstance(shape, Label):
        _write(axes, shape, frame, order)
        return
    colour = INK.get(shape.colour, shape.colour)
    fill = colour if shape.fill == "ink" else FILL.get(shape.fill, shape.fill or "none")
    dash = (0, tuple(d / max(shape.width, 0.1) for d in shape.dash)) if shape.dash else "solid"
    style = {
        "edgecolor": colour, "facecolor": fill, "linewidth": shape.width * POINT, "linestyle": dash, "zorder": order,
        "joinstyle": "round", "capstyle": "round",
    }  # fmt: skip
    if isinstance(shape, Circle):
        axes.add_patch(patches.Circle(frame.place(shape.centre), shape.radius, **style))
        return
    points = [frame.place(v) for v in shape.vertices]
    axes.add_patch(patches.Polygon(points, closed=shape.closed, fill=bool(shape.fill), **style))


def _write(axes: Axes, label: Label, frame: Frame, order: int) -> None:
    """A text piece by piece: matplotlib's own formulas would read a user's signs as commands."""
    x, y = frame.place(label.at)
    x -= {"start": 0.0, "middle": 0.5, "end": 1.0}[label.anchor] * _wide(label.text, label.size)
    base = y + 0.35 * label.size
    for piece, level in runs(label.text):
        shift = (LOWERED if level < 0 else RAISED if level > 0 else 0.0) * label.size
        size = label.size * (SMALL if level else 1.0)
        axes.text(
            x, base + shift, piece, fontsize=size * POINT, color=INK.get(label.colour, label.colour),
            ha="left", va="baseline", zorder=order, parse_math=False,
        )  # fmt: skip
        x += _wide(piece, size)


def _wide(text: str, size: float) -> float:
    """The width of a text in px, as matplotlib sets it."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    total = 0.0
    for piece, level in runs(text):
        own = size * (SMALL if level else 1.0)
        if not piece.strip():
            total += width(piece, own)
            continue
        # a stroke at the end, so that spaces before it count
        prop = FontProperties(family="DejaVu Sans")
        bar = TextPath((0, 0), "|", size=own, prop=prop).get_extents()
        both = TextPath((0, 0), piece + "|", size=own, prop=prop).get_extents()
        total += both.x1 - bar.x1
    return total
