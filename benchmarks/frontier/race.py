"""lmoc and other tools on seven scenes: the time that an error of 1e-6 and of 1e-9 costs.

General integrators get the same equations, written by hand (`by_hand`): SciPy evaluates them as C where a compiler is,
casadi in its virtual machine, heyoka and diffsol compile them. Tools for rigid bodies have the bodies (`bodies`), lmoc
has the scene. Each tool has a process of its own. Each method is run over tolerances until it is as exact as asked for;
then the fastest that are exact enough take turns, one tool after the other, and the shortest processor time of each
counts. The error is the largest deviation of a signal from the reference at 501 output times, in units of its largest
value.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.common import ROOT, save, table
from benchmarks.frontier.scenes import SCENES, Scene, deviation
from benchmarks.frontier.tools import lmoc_with, scipy_with
from benchmarks.frontier.worker import FAR, SHORT, SLOW, TOOLS, Candidate, Worker

TARGETS = (1e-6, 1e-9)
KEPT = ROOT / "docs" / "charts" / "peers.json"

Workers = dict[str, Worker]


def reference(scene: Scene) -> tuple[np.ndarray, float]:
    """Signals in closed form, else by lmoc's Taylor series at 1e-14, and the deviation of a second way to them.

    The second way is the Taylor series, else SciPy's DOP853 at 1e-12 on the equations by hand.
    """
    series = lmoc_with("taylor")(scene, 1e-14)()
    if scene.exact is not None:
        exact = scene.exact(scene.times())
        return exact, deviation(series, exact)
    return series, deviation(scipy_with("DOP853")(scene, 1e-12)(), series)


def scan(scene: Scene, exact: np.ndarray, packages: Sequence[str]) -> tuple[Workers, list[Candidate]]:
    """Return the tools that can run a scene, each at work in its process, and their runs."""
    workers: Workers = {}
    candidates: list[Candidate] = []
    slow = SLOW
    for tool in TOOLS:
        worker = Worker(tool, scene.name, packages)
        try:
            answer = worker.ask("scan", exact, min(TARGETS), slow)
        except RuntimeError as failure:
            answer = [str(failure)]
        found = [one for one in answer if isinstance(one, Candidate)]
        for text in answer:
            if isinstance(text, str):
                print(f"  {tool}: {text}", flush=True)
        if found:
            workers[tool] = worker
            candidates += found
            if tool == "lmoc":
                slow = min(SLOW, max(SHORT, FAR * min(c.seconds for c in found)))
        else:
            worker.close()
    return workers, candidates


def race(workers: Workers, candidates: list[Candidate], target: float, repeat: int) -> dict[str, tuple]:
    """Return for each tool its fastest run with an error of at most the target, and its time, s.

    Those that lead take turns.
    """
    best: dict[str, tuple[Candidate, float]] = {}
    leading: list[Candidate] = []
    for tool in workers:
        leading += sorted((c for c in candidates if c.tool == tool and c.error <= target), key=lambda c: c.seconds)[:2]
    for k in range(repeat):
        for c in leading:
            if k > 1 and k * c.seconds > SLOW:  # long runs scatter little
                continue
            seconds = workers[c.tool].ask("turn", c.method, c.rtol)
            if c.tool not in best or seconds < best[c.tool][1]:
                best[c.tool] = c, seconds
    return best


def compare(scene: Scene, repeat: int, packages: Sequence[str]) -> tuple[list[dict], list[dict]]:
    """Return the rows of a scene, one a tool and target, with the ratio to lmoc; and all runs, for the curves."""
    lmoc_with("auto")(scene, 1e-6)()
    time.sleep(4)  # the compiler works beside the first run
    exact, uncertainty = reference(scene)
    print(f"{scene.name}: references agree to {uncertainty:.0e}", flush=True)
    workers, candidates = scan(scene, exact, packages)
    rows: list[dict[str, object]] = []
    try:
        for target in TARGETS:
            best = race(workers, candidates, target, repeat)
            for tool, (c, seconds) in best.items():
                first = workers[tool].ask("from nothing", c.method, c.rtol)
                rows.append({"scene": scene.name, "target": target, "tool": tool, "method": c.method, "rtol": c.rtol,
                             "error": c.error, "ms": seconds * 1e3, "ratio": seconds / best["lmoc"][1],
                             "from nothing ms": first * 1e3})  # fmt: skip
    finally:
        for worker in workers.values():
            worker.close()
    table(scene.name, list(rows[0]), [list(r.values()) for r in rows])
    return rows, [{"scene": scene.name, "tool": c.tool, "error": c.error, "ms": c.seconds * 1e3} for c in candidates]


def compare_all(repeat: int, names: Sequence[str], packages: Sequence[str]) -> Path:
    """Compare all scenes, or those named; all together are kept for the page beside its pictures.

    Raises
    ------
    SystemExit
        For a name that no scene has.
    """
    unknown = sorted(set(names) - set(SCENES))
    if unknown:
        raise SystemExit(f"no scene {', '.join(unknown)}; there are: {', '.join(SCENES)}")
    found = [compare(scene, repeat, packages) for name, scene in SCENES.items() if not names or name in names]
    rows, runs = ([item for part in parts for item in part] for parts in zip(*found, strict=True))
    path = save("frontier", {"rows": rows, "runs": runs})
    if not names:
        shutil.copy(path, KEPT)
    return path
