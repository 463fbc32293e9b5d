"""The picture of a chart: error against time, one colour a family, one marker a method, failures on a rail above."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lmoc.numerics.problem.status import Status
from lmoc.report.files import PICTURES, check_target
from lmoc.report.plots import COLOURS, GREY, STYLE, head, write
from lmoc.report.powers import label_powers
from lmoc.studies.chart_text import by_method
from lmoc.studies.points import NOT_RUN, TOO_SLOW

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from lmoc.studies.findings import Findings
    from lmoc.studies.points import Point

_MARKERS = "os^DvP*Xp<>hdH12"  # as many as methods, so that no two of a family have the same
_FAMILIES = (*COLOURS, "#8B5A2B")  # as many as families of methods
_APART = 0.038  # of the height, between two labels
_MOST_NAMED = 16  # curves with colours and names
_MARKED = 0.3  # of the width of the rail, for the marks; the reasons stand beside
_LINE = 98  # characters of a line on the rail
_LARGEST = 10.0  # error that is drawn; larger ones stand at the edge


def plot(chart: Findings, path: str | Path | None = None) -> Figure:
    """Draw a chart.

    Parameters
    ----------
    path : where to write the picture (.png, .svg, .pdf), if anywhere

    Raises
    ------
    ModelError
        E0623, E0624: the picture cannot be written.
    """
    if path is not None:
        check_target(Path(path), PICTURES)
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        failed = _by_reason([p for p in chart.points if not p.ok and not p.status.startswith(NOT_RUN)])
        above = 0.35 + 0.19 * sum(len(lines) for lines in _texts(failed))  # inches
        figure = Figure(figsize=(9, 6.0 + above), dpi=150, layout="constrained")
        FigureCanvasAgg(figure)
        rail, axis = figure.subplots(2, 1, height_ratios=[above, 6.0])
        styles = _styles(chart)
        _frontiers(axis, chart, styles)
        _chosen(axis, chart)
        _band(axis, chart)
        _rail(rail, failed, styles)
        axis.set_xlabel("error: largest deviation, relative to each signal's largest value")
        axis.set_ylabel("time of a run in s")
        head(figure, f"{chart.name}: speed against accuracy      {chart.recommendation}")
        if path is not None:
            write(figure, Path(path))
    return figure


Style = tuple[str, str, str]  # colour, marker, dashes


def _styles(chart: Findings) -> dict[str, Style]:
    """Return colour by family, marker by method, dashes by formulation."""
    from lmoc.numerics.steps.choice import table

    properties = {one.name: one for one in table()}
    families = list(dict.fromkeys(one.family for one in properties.values()))
    found, forms = {}, list(dict.fromkeys(p.setting.formulation for p in chart.points))
    for name, points in by_method(chart.points).items():
        setting = points[0].setting
        own = properties.get(setting.solver)
        colour = "#222222" if own is None else _FAMILIES[families.index(own.family) % len(_FAMILIES)]
        marker = "o" if own is None else _MARKERS[list(properties).index(own.name) % len(_MARKERS)]
        dashes = ("-", "--", ":", "-.", (0, (5, 1, 1, 1, 1, 1)))[forms.index(setting.formulation) % 5]
        found[name] = colour, marker, dashes
    return found


def _frontiers(axis: Axes, chart: Findings, styles: dict[str, Style]) -> None:
    """Draw the curves of the methods, each with its name at an end."""
    axis.set_xscale("log")
    axis.set_yscale("log")
    label_powers(axis)
    labels = []
    curves = {name: [p for p in points if p.ok and p.error > 0] for name, points in by_method(chart.points).items()}
    curves = {n: points for n, points in curves.items() if points and points[0].setting.solver != "auto"}
    named = _named(curves)
    for name, good in curves.items():
        colour, marker, dashes = styles[name]
        x, y = [min(p.error, _LARGEST) for p in good], [p.seconds for p in good]
        if name not in named:
            axis.plot(x, y, color="#cccccc", linestyle=dashes, linewidth=0.8, zorder=1)
            continue
        axis.plot(x, y, color=colour, marker=marker, linestyle=dashes, markersize=5, linewidth=1.2, alpha=0.9)
        labels.append((x[-1], y[-1], name, colour))
    good = [p for p in chart.points if p.ok and p.error > 0]
    if not good:
        return
    low = min([p.error for p in good] + [max(chart.reference.uncertainty, 1e-16)])
    high = min(_LARGEST, max(p.error for p in good))
    axis.set_xlim(high * 2, low / 2)
    _labels(axis, labels)


def _named(curves: dict[str, list[Point]]) -> set[str]:
    """Return the methods that are named; of many, those that are the fastest at some error, the fastest first."""
    if len(curves) <= _MOST_NAMED:
        return set(curves)

    def behind(name: str) -> float:
        """Return the ratio of its time to that of the fastest at the error where it is best."""
        return min(p.seconds / min(q.seconds for q in every if q.error <= p.error) for p in curves[name])

    every = [p for points in curves.values() for p in points]
    return set(sorted(curves, key=behind)[:_MOST_NAMED])


def _labels(axis: Axes, labels: Sequence[tuple[float, float, str, str]]) -> None:
    """Write the names at the right, moved apart where they would overlap, with a thin line to where each belongs."""
    low, high = (math.log10(v) for v in axis.get_ylim())
    ordered = sorted(labels, key=lambda label: label[1])
    heights = [(math.log10(y) - low) / (high - low) for _, y, _, _ in ordered]
    for place, (x, y, name, colour) in zip(spread(heights, _APART), ordered, strict=True):
        axis.annotate(
            name, (x, y), xytext=(1.02, place), textcoords="axes fraction", color=colour, fontsize=8.5, va="center",
            arrowprops={"arrowstyle": "-", "color": colour, "linewidth": 0.5, "alpha": 0.5, "shrinkA": 1, "shrinkB": 3},
            annotation_clip=False,
        )  # fmt: skip


def spread(heights: Sequence[float], apart: float) -> list[float]:
    """Return heights in the same order, at least so far apart, as near to the given ones, increasing, as can be."""
    groups: list[list[float]] = []  # [sum of the wanted places of the first member, members]
    for height in heights:
        groups.append([height, 1.0])
        while len(groups) > 1 and groups[-2][0] / groups[-2][1] + groups[-2][1] * apart > groups[-1][0] / groups[-1][1]:
            total, count = groups.pop()
            groups[-1][0] += total - count * groups[-1][1] * apart
            groups[-1][1] += count
    return [total / count + i * apart for total, count in groups for i in range(int(count))]


def _chosen(axis: Axes, chart: Findings) -> None:
    """Mark what `auto` has chosen by rings, with the requested tolerances."""
    good = [p for p in chart.points if p.ok and p.setting.solver == "auto" and p.error > 0]
    good = [p for p in good if p.setting.formulation == "reduced"] or good
    if not good:
        return
    x, y = [min(p.error, _LARGEST) for p in good], [p.seconds for p in good]
    axis.plot(x, y, "o", markersize=12, markerfacecolor="none", markeredgecolor="#222222", markeredgewidth=1.1)
    for p, here, there in zip(good, x, y, strict=True):
        text = f"{p.setting.rtol:.0e}".replace("e-0", "e-")
        axis.annotate(text, (here, there), xytext=(0, 9), textcoords="offset points", fontsize=7, ha="center")
    axis.plot([], [], "o", markersize=9, markerfacecolor="none", markeredgecolor="#222222", label="auto, at its rtol")
    axis.legend(loc="lower left", bbox_to_anchor=(-0.01, 0.99), frameon=False, borderaxespad=0, handletextpad=0.2)


def _band(axis: Axes, chart: Findings) -> None:
    """Shade the errors that the reference does not resolve."""
    edge = axis.get_xlim()[1]
    uncertainty = max(chart.reference.uncertainty, edge)
    axis.axvspan(uncertainty, edge, color="#000000", alpha=0.06, linewidth=0)
    text = "\n".join(filter(None, [chart.note, f"not resolved: {chart.reference.text}"]))
    axis.annotate(
        text, (0.995, 0.01), xycoords="axes fraction", ha="right", va="bottom",
        fontsize=7, color=GREY,
    )  # fmt: skip


def _by_reason(failed: Sequence[Point]) -> dict[str, list[Point]]:
    """Return what gave no result by its reason, the text of which leaves out the place and the name of the method."""
    found: dict[str, list[Point]] = {}
    for point in failed:
        found.setdefault(_reason(point.status), []).append(point)
    return found


def _reason(status: str) -> str:
    """Return the reason without the method, the time that was reached, and what differs from run to run."""
    if TOO_SLOW in status:
        return "too slow: given up"
    text = status.split(" cannot be used: ")[-1]
    text = text.split(": ", 1)[1] if text.startswith("the run stopped at") else text
    return Status.NOT_FINITE.value if text.startswith(Status.NOT_FINITE.value) else text


def _texts(failed: dict[str, list[Point]]) -> list[list[str]]:
    """Return the lines of text of each reason: which methods, and why."""
    found = []
    for reason, points in failed.items():
        methods = list(by_method(points))
        names = ", ".join(methods) if len(methods) <= 3 else f"{', '.join(methods[:3])} and {len(methods) - 3} more"
        found.append(textwrap.wrap(f"{names}: {reason}", _LINE, max_lines=2, placeholder=" …"))
    return found


def _rail(axis: Axes, failed: dict[str, list[Point]], styles: dict[str, Style]) -> None:
    """Draw what gave no result at the requested tolerance (or step), with the reason and the methods."""
    axis.set_visible(bool(failed))
    if not failed:
        return
    every = sorted({_asked(p) for points in failed.values() for p in points}, reverse=True)
    row, texts = 0.0, _texts(failed)
    for points, lines in zip(failed.values(), texts, strict=True):
        methods, place = by_method(points), row - 0.5 * (len(lines) - 1)
        for name, own in methods.items():
            asked = [_asked(p) for p in own]
            heights = np.full(len(own), place)
            axis.plot(asked, heights, linestyle="none", marker="x", color=styles[name][0], markersize=5)
        axis.annotate(
            "\n".join(lines), (_MARKED, place), xycoords=("axes fraction", "data"), fontsize=7,
            color=GREY if len(methods) > 1 else styles[next(iter(methods))][0], va="center",
        )  # fmt: skip
        row -= len(lines)
    axis.set_xscale("log")
    high, low = every[0] * 3, every[-1] / 3
    axis.set_xlim(high, high * (low / high) ** (1 / _MARKED))
    shown = every if len(every) <= 4 else [every[0], every[-1]]
    axis.set_xticks(shown, [f"{value:.0e}".replace("e-0", "e-") for value in shown])
    axis.minorticks_off()
    axis.set_ylim(row + 0.4, 0.6)
    axis.set_yticks([])
    axis.grid(False)
    axis.tick_params(labelsize=7)
    axis.set_title("no result, at the requested tolerance or step (s)", fontsize=8, color=GREY, loc="left")


def _asked(point: Point) -> float:
    return point.setting.step if point.setting.fixed else point.setting.rtol

