"""What reduction saves: scenes with all their equations, with dummy derivatives, and reduced; states, time and error.

    python -m benchmarks.economy [SCENE …]

The picture and the section of `docs/accuracy.md` are made of what `measure` returns.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

from benchmarks.common import ROOT, save, table

SCENES = {
    "spring, mass, damper": "notes/ex02_spring_mass_damper",
    "quarter car": "notes/ex05_suspension",
    "block and tackle": "hard/h22_block_and_tackle",
    "planetary gear": "hard/h23_planetary_gear",
    "double pendulum": "planar/double_pendulum",
    "crane": "planar/crane",
    "Andrews": "classic/andrews",
}
MARKS = {
    ("all equations", False): ("s", "all equations, IDA"),
    ("dummy derivatives", False): ("D", "dummy derivatives, IDA"),
    ("reduced", False): ("o", "reduced, IDA"),
    ("reduced", True): ("*", "reduced, auto"),
}
HEAD = ("scene", "form", "solver", "states", "unknowns", "steps", "time", "error")
SECTION = """\
## What reduction saves

![States and time in four forms](charts/economy.png)

The same scene, the same tolerance of 1e-6: as its parts say it, without any reduction (all flat equations in IDA);
after index reduction with dummy derivatives; reduced to its degrees of freedom, in IDA as before; and as `lmoc run`
integrates it. {lesson}

{table}

States are the variables with a derivative that the solver integrates, work and heat not counted where the scene is
reduced; unknowns are all variables of the solver. Of a scene of your own: `dae.economy()`. Here:
`python -m benchmarks.economy`.
"""


def measure(names: Sequence[str] = ()) -> list[dict]:
    """Return a row for each form of each scene."""
    import lmoc

    rows = []
    for name, model in SCENES.items():
        if names and name not in names:
            continue
        for form in lmoc.compile(ROOT / "models" / f"{model}.lmo").economy(rtol=1e-6):
            rows.append({"scene": name, **vars(form)})
    return rows


def row_text(row: dict) -> tuple[str, ...]:
    """Return a row as text, in the order of `HEAD`."""
    from lmoc.studies.findings import seconds_text

    error = row["status"] or f"{row['error']:.0e}"
    seconds = "–" if row["status"] else seconds_text(row["seconds"])
    return (row["scene"], row["form"], row["solver"], *(str(row[k]) for k in ("states", "unknowns", "steps")), seconds,
            error)  # fmt: skip


def _is_chosen(row: dict) -> bool:
    """Whether `auto` has chosen the method."""
    return row["form"] == "reduced" and row["solver"] != "ida"


def lesson(rows: Sequence[dict]) -> str:
    """Return what the figures amount to."""

    def ratios(form: str, key: str) -> list[float]:
        found = []
        for scene in dict.fromkeys(r["scene"] for r in rows):
            own = {(r["form"], _is_chosen(r)): r for r in rows if r["scene"] == scene}
            other, ours = own[form, False], own["reduced", key == "seconds"]
            if not other["status"]:
                found.append(other[key] / ours[key])
        return found

    failed = [r["scene"] for r in rows if r["form"] == "all equations" and r["status"]]
    unknowns, plain, dummy = (
        ratios("all equations", "unknowns"),
        ratios("all equations", "seconds"),
        ratios("dummy derivatives", "seconds"),
    )
    text = (
        f"Where a scene can be integrated without reduction, {min(unknowns):.0f} to {max(unknowns):.0f} times as many "
        f"unknowns cost {min(plain):.0f} to {max(plain):.0f} times as much time; dummy derivatives, which all scenes "
        f"allow, cost {min(dummy):.0f} to {max(dummy):.0f} times as much as the reduced scene."
    )
    if failed:
        text += f" {len(failed)} scenes ({', '.join(failed)}) have index 3 and stop at once."
    slower = _slower_in_ida(rows)
    if slower:
        text += (
            f" In IDA itself the reduced form takes longer than dummy derivatives in {', '.join(slower)}: most of "
            "its time goes to the watch over the choice of coordinates, which is in Python, after every step."
        )
    return text


def _slower_in_ida(rows: Sequence[dict]) -> list[str]:
    """Return the scenes that IDA integrates faster with dummy derivatives than reduced."""
    seconds = {(r["scene"], r["form"]): r["seconds"] for r in rows if r["solver"] == "ida" and not r["status"]}
    return [
        scene
        for scene in dict.fromkeys(r["scene"] for r in rows)
        if seconds.get((scene, "dummy derivatives"), math.inf) < seconds.get((scene, "reduced"), 0.0)
    ]


def draw(rows: Sequence[dict], path: Path) -> None:
    """Draw time over unknowns, one colour a scene, one mark a form."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from lmoc.report.plots import COLOURS, GREY, STYLE, head
    from lmoc.report.powers import label_powers
    from lmoc.studies.chart_plot import spread

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(9, 5.2), dpi=150, layout="constrained")
        FigureCanvasAgg(figure)
        axis = figure.subplots()
        axis.set_xscale("log")
        axis.set_yscale("log")
        label_powers(axis)
        ends = []
        for k, scene in enumerate(dict.fromkeys(r["scene"] for r in rows)):
            own, colour = [r for r in rows if r["scene"] == scene], COLOURS[k % len(COLOURS)]
            good = sorted((r for r in own if not r["status"]), key=lambda r: (r["unknowns"], r["seconds"]))
            axis.plot([r["unknowns"] for r in good], [r["seconds"] for r in good], color=colour, linewidth=1, alpha=0.6)
            for r in good:
                mark = MARKS[r["form"], _is_chosen(r)][0]
                axis.plot(r["unknowns"], r["seconds"], mark, color=colour, markersize=9 if mark == "*" else 5)
            ends.append((good[-1]["unknowns"], good[-1]["seconds"], scene, colour))
        axis.margins(x=0.05)
        low, high = (math.log10(v) for v in axis.get_ylim())
        ends.sort(key=lambda end: end[1])
        heights = spread([(math.log10(y) - low) / (high - low) for _, y, _, _ in ends], 0.05)
        for height, (x, y, scene, colour) in zip(heights, ends, strict=True):
            axis.annotate(
                scene, (x, y), xytext=(1.02, height), textcoords="axes fraction", color=colour, fontsize=9, va="center",
                arrowprops={"arrowstyle": "-", "color": colour, "linewidth": 0.5, "alpha": 0.5, "shrinkB": 4},
                annotation_clip=False,
            )  # fmt: skip
        for mark, text in MARKS.values():
            axis.plot([], [], mark, color=GREY, label=text, markersize=9 if mark == "*" else 5)
        axis.legend(loc="lower right", frameon=False)
        axis.set_xlabel("unknowns of the solver")
        axis.set_ylabel("time of a run in s")
        head(figure, "What reduction saves: one scene, one tolerance (1e-6), four forms")
        figure.savefig(path)


def page(rows: Sequence[dict]) -> str:
    """Return the section of `docs/accuracy.md`."""
    lines = ["| " + " | ".join(HEAD) + " |", "|" + " --- |" * len(HEAD)]
    lines += ["| " + " | ".join(row_text(row)) + " |" for row in rows]
    return SECTION.format(lesson=lesson(rows), table="\n".join(lines))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", help=", ".join(SCENES))
    names = parser.parse_args().scenes
    unknown = sorted(set(names) - set(SCENES))
    if unknown:
        raise SystemExit(f"no scene {', '.join(unknown)}; there are: {', '.join(SCENES)}")
    rows = measure(names)
    table("what reduction saves", HEAD, [row_text(row) for row in rows])
    save("economy", rows)


if __name__ == "__main__":
    main()
