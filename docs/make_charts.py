"""Writes docs/charts/, docs/accuracy.md and docs/stability.md from runs: ``python docs/make_charts.py [PART …]``.

Without names everything is run anew, in about ten minutes; with names these parts alone (``make charts ONLY="andrews
economy"``): a scene; "economy", what reduction saves; "methods", the table of all methods; "others", methods that lmoc
does not have; "pages" runs no more than the failures. The pages are made from what is kept beside the pictures
(`docs/charts/*.json`). What `auto` chooses is what `python -m benchmarks.auto --keep` has kept, and the comparison with
other tools what `python -m benchmarks.peers --scenes` has: both take their time, and the second one needs the tools.
"""

from __future__ import annotations

import json
import sys
import time as clock
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))  # benchmarks
FOLDER = ROOT / "docs" / "charts"
RTOLS = tuple(10.0**-k for k in range(3, 11))


@dataclass(frozen=True)
class Scene:
    """A scene of the page, until a stop time, and the seconds that its chart may take.

    What the chart teaches is said by `benchmarks.lessons`, from its points.
    """

    name: str
    title: str
    model: str
    stop: float | None = None
    seconds: float = 15.0


SCENES = (
    Scene("spring_mass_damper", "Spring, mass and damper", "notes/ex02_spring_mass_damper"),
    Scene("suspension", "Quarter car (Example 5)", "notes/ex05_suspension"),
    Scene(
        "stiffness_ratio", "Stiffness 1e8 beside 1, both modes at work (H13)", "hard/h13_stiffness_ratio", 0.05, 30.0
    ),
    Scene("plucked_string", "A string of 100 masses (H14)", "hard/h14_plucked_string", 0.5),
    Scene("andrews", "Andrews' squeezing mechanism", "classic/andrews", seconds=30.0),
    Scene("double_pendulum", "Double pendulum", "planar/double_pendulum"),
    Scene("bungee", "A string that goes slack and taut (H06)", "laws/h06_bungee"),
    Scene("prothero_robinson", "A fast relaxation (H28)", "hard/h28_prothero_robinson", seconds=30.0),
)

ACCURACY = """\
# Speed against accuracy

Each chart shows what a scene costs by method and tolerance: to the right more digits, down less time. The error
is the largest deviation from a reference, relative to each signal's largest value; the reference comes from two
different methods, and the grey band is where they disagree. Rings are what `auto` does at the tolerance beside
them. What gave no result stands on the rail above, with its reason. Times are those of the processor for whole
runs of 501 output times, warm, the shortest of several that took turns, on {machine}.

Of a scene of your own: `lmoc chart FILE --plot chart.png` (see [use.md](use.md#speed-against-accuracy)); how
methods fail is told in [stability.md](stability.md). *This page is made from runs by `make charts`.*
"""
STABILITY = """\
# How methods fail

Each section shows a failure by numbers of runs, the command that makes them, and what lmoc does about it or offers.
*This page is made from runs by `make charts`, and the tests make the runs again (`tests/docs/test_stability.py`).*
"""


def chart(scene: Scene) -> None:
    """Chart a scene and keep its picture and its points."""
    import lmoc

    dae = lmoc.compile(ROOT / "models" / f"{scene.model}.lmo")
    found = dae.chart(rtols=RTOLS, stop=scene.stop, seconds=scene.seconds)
    found.plot(FOLDER / f"{scene.name}.png")
    found.save(FOLDER / f"{scene.name}.json")
    print(f"{scene.name}: {found.recommendation}; {found.reference.text}")


def kept(name: str) -> Any:
    """What has been measured, from beside the pictures."""
    return json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))


def keep(name: str, data: object) -> None:
    (FOLDER / f"{name}.json").write_text(json.dumps(data, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def accuracy() -> str:
    """The page of charts."""
    from benchmarks import auto, economy, other_methods
    from benchmarks.common import machine
    from benchmarks.frontier import page as peers
    from benchmarks.lessons import LESSONS, Points

    parts = [ACCURACY.format(machine="an {processor} with {cores} cores".format(**machine()))]
    for scene in SCENES:
        data = kept(scene.name)
        stop = "" if scene.stop is None else f" --stop {scene.stop:g}"
        one, two = data["reference"]["methods"]
        parts.append(
            f"## {scene.title}\n\n![{scene.title}](charts/{scene.name}.png)\n\n"
            f"{LESSONS[scene.name](Points(data['points']))}\n\n"
            f"`lmoc chart models/{scene.model}.lmo{stop}` recommends, {data['recommendation']}. The reference: "
            f"{one} and "
            f"{two} agree to {data['reference']['uncertainty']:.0e}. {_auto(data['points'])}\n"
        )
    economy.draw(kept("economy"), FOLDER / "economy.png")
    parts.append(economy.page(kept("economy")))
    parts.append(auto.page(kept("auto")))
    parts.append(other_methods.page(kept("others")))
    peers.draw(kept("peers"), FOLDER / "peers.png")
    parts.append(peers.page(kept("peers")))
    return "\n".join(parts)


def _auto(points: list[dict]) -> str:
    """What `auto` has reached at 1e-6."""
    own = [p for p in points if p["solver"] == "auto" and p["status"] == "ok" and abs(p["rtol"] / 1e-6 - 1) < 1e-6]
    if not own:
        return ""
    p = own[0]
    return f"At 1e-6 `auto` uses {p['note'] or 'auto'}: error {p['error']:.0e} in {p['seconds'] * 1e3:.2g} ms."


def stability() -> str:
    """The page of failures."""
    from benchmarks import methods
    from benchmarks.stability import ALL

    parts = [STABILITY]
    for make in ALL:
        failure = make()
        commands = "\n".join(failure.commands)
        parts.append(f"## {failure.title}\n\n```\n{commands}\n```\n\n{failure.seen}\n\n{failure.remedy}\n")
    parts.append(methods.page(kept("methods")))
    return "\n".join(parts)


def parts() -> dict[str, Callable[[], object]]:
    """Return what is measured, by name."""
    from benchmarks import economy, methods, other_methods

    measured: dict[str, Callable[[], object]] = {scene.name: partial(chart, scene) for scene in SCENES}
    for name, measure in (
        ("economy", economy.measure),
        ("methods", methods.measure),
        ("others", other_methods.measure),
    ):
        measured[name] = lambda name=name, measure=measure: keep(name, measure())
    return measured


def pages() -> None:
    """Write the pages, from what is kept and from the failures, which are run anew."""
    (ROOT / "docs" / "accuracy.md").write_text(accuracy(), encoding="utf-8")
    (ROOT / "docs" / "stability.md").write_text(stability(), encoding="utf-8")


def main() -> None:
    names, measured = sys.argv[1:], parts()
    unknown = sorted(set(names) - set(measured) - {"pages"})
    if unknown:
        sys.exit(f"no part {', '.join(unknown)}; there are: {', '.join([*measured, 'pages'])}")
    FOLDER.mkdir(exist_ok=True)
    chosen = {name: make for name, make in measured.items() if not names or name in names} | {"pages": pages}
    began = clock.monotonic()
    for k, (name, make) in enumerate(chosen.items(), 1):
        print(f"[{k}/{len(chosen)}] {name} …", flush=True)
        begin = clock.monotonic()
        make()
        print(f"[{k}/{len(chosen)}] {name}: {clock.monotonic() - begin:.0f} s", flush=True)
    print(f"all in {(clock.monotonic() - began) / 60:.1f} min; see docs/accuracy.md and docs/stability.md")


if __name__ == "__main__":
    main()
