"""The comparison with other tools as a section of `docs/accuracy.md` and as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

SECTION = """\
## Against other tools

![Time over error of each tool on {count} scenes](charts/peers.png)

{Count} scenes at equal error: milliseconds of the processor for a warm run of 501 output times, by each tool's fastest
method whose error is at most the one in the second column; in brackets the milliseconds on the clock from the scene or
the equations to the result. Each tool is in a process of its own, and they take turns. lmoc reads the scene; SciPy,
casadi, heyoka and diffsol have its equations by hand, which SciPy and lmoc evaluate as C, casadi in its virtual
machine, heyoka and diffsol as machine code of their own. MuJoCo, Exudyn and Pinocchio have the bodies, where a scene is
a tree of them or of springs alone; SymPy derives Lagrange's equations, which SciPy integrates as NumPy functions.

{table}

{lesson}

What the milliseconds contain: in lmoc a whole `simulate` call, that is the check of options and parameters, the
solution for the start and the check that all of its values are finite, the integration, and the reading of the signals;
in the other tools the integration alone with its output, from the start values they are given. Nobody computes energy.
Angles and places of mechanisms that are no states of lmoc's are solved for at each output time; the others have them as
states.

`python -m benchmarks.peers --scenes` measures this with those of the tools that are installed (`--packages` takes the
packages of another environment); here on an {processor} with {cores} cores. Tolerances go down to 1e-13 for lmoc and
heyoka, to 1e-12 for the others; a dash stands where that was not enough within 100 times lmoc's time, or where a tool
has no such scene.
"""
MARKERS = ("o", "s")
NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine")


def page(data: dict) -> str:
    """Return the section of `docs/accuracy.md` from what `race.compare_all` has kept."""
    rows, machine_ = data["figures"]["rows"], data["machine"]
    tools = list(dict.fromkeys(r["tool"] for r in rows))
    head = ["scene", "error", *tools, "lmoc / fastest other"]
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    for (scene, target), here in _pairs(rows).items():
        cells = [_cell(here[t]) if t in here else "–" for t in tools]
        lines.append("| " + " | ".join([scene, f"{target:.0e}", *cells, _ratio_text(_ratio(here))]) + " |")
    count = NUMBERS[len({r["scene"] for r in rows})]
    return SECTION.format(
        table="\n".join(lines), lesson=lesson(rows), count=count, Count=count.capitalize(), **machine_
    )


def lesson(rows: Sequence[dict]) -> str:
    """Return what the figures amount to: where lmoc leads, by whom it is led, and how it stands to heyoka."""
    pairs = _pairs(rows)
    known = {pair: _ratio(here) for pair, here in pairs.items() if _ratio(here) is not None}
    ahead = [pair for pair, ratio in known.items() if ratio <= 1]
    leaders = {pair: min((r["ms"], t) for t, r in here.items() if t != "lmoc")[1] for pair, here in pairs.items()
               if pair in known and known[pair] > 1}  # fmt: skip
    text = f"lmoc is the fastest in {len(ahead)} of {len(known)} rows"
    if leaders:
        names = sorted({*leaders.values()}, key=list(leaders.values()).count, reverse=True)
        text += f"; in the others {' or '.join(names)} is"
    heyoka = {pair: here["lmoc"]["ms"] / here["heyoka"]["ms"] for pair, here in pairs.items()
              if {"lmoc", "heyoka"} <= set(here)}  # fmt: skip
    if heyoka:
        far = [
            f"{scene} at {target:.0e} ({ratio:.0f} times)" for (scene, target), ratio in heyoka.items() if ratio > 10
        ]
        within = f"within 10 times of heyoka's time in {len(heyoka) - len(far)} of {len(heyoka)}"
        text += f". It is {within}" + (f", and beyond in {', '.join(far)}" if far else "")
    return text + "."


def _pairs(rows: Sequence[dict]) -> dict[tuple[str, float], dict[str, dict]]:
    """Return the rows by scene and target, and by tool."""
    found: dict[tuple[str, float], dict[str, dict]] = {}
    for row in rows:
        found.setdefault((row["scene"], row["target"]), {})[row["tool"]] = row
    return found


def _ratio(here: dict[str, dict]) -> float | None:
    """Return the time of lmoc over that of the fastest other tool; None where there is nothing to compare."""
    others = [r["ms"] for tool, r in here.items() if tool != "lmoc"]
    return here["lmoc"]["ms"] / min(others) if others and "lmoc" in here else None


def _ratio_text(ratio: float | None) -> str:
    return "–" if ratio is None else f"{ratio:.{0 if ratio >= 10 else 1}f}"


def draw(data: dict, path: Path) -> None:
    """Draw time over error, one panel a scene, one curve a tool of its runs that no other of its own is better than."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from lmoc.report.plots import COLOURS, STYLE, head
    from lmoc.report.powers import label_powers

    runs = data["figures"]["runs"]
    scenes, tools = (list(dict.fromkeys(r[key] for r in runs)) for key in ("scene", "tool"))
    styles = {tool: {"color": COLOURS[k % len(COLOURS)], "marker": MARKERS[k // len(COLOURS)], "markersize": 3,
                     "linewidth": 2.2 if tool == "lmoc" else 1.2} for k, tool in enumerate(tools)}  # fmt: skip
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(10, 5.8), dpi=150, layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(2, len(scenes) // 2 + 1, sharex=True, squeeze=False).ravel()
        for axis, scene in zip(axes, scenes, strict=False):
            axis.set_xscale("log")
            axis.set_yscale("log")
            label_powers(axis)
            for tool in tools:
                best = envelope([(r["error"], r["ms"]) for r in runs if (r["scene"], r["tool"]) == (scene, tool)])
                if best:
                    axis.plot(*zip(*best, strict=True), **styles[tool])
            axis.set_title(scene, fontsize=9)
            axis.set_xlim(1e-3, 1e-11)
        for axis in axes[len(scenes) :]:
            axis.set_axis_off()
        handles = [axes[0].plot([], [], label=tool, **styles[tool])[0] for tool in tools]
        axes[-1].legend(handles=handles, loc="center left", frameon=False)
        figure.supylabel("milliseconds of a warm run", fontsize=9)
        figure.supxlabel("error: largest deviation, relative to each signal's largest value", fontsize=9)
        head(figure, f"{NUMBERS[len(scenes)].capitalize()} scenes by lmoc and by other tools")
        figure.savefig(path)


def envelope(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the points than which no other has both a smaller error and a shorter time, the largest error first."""
    best: list[tuple[float, float]] = []
    for error, seconds in sorted(points):
        if not best or seconds < best[-1][1]:
            best.append((error, seconds))
    return best[::-1]


def _cell(row: dict) -> str:
    ms, first = (f"{row[k]:.3g}" if row[k] < 1000 else f"{row[k]:.0f}" for k in ("ms", "from nothing ms"))
    return f"{ms} {row['method']} ({first})"
