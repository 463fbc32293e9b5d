"""How good the choice of `auto` is: over models and tolerances, its time against the best method's at the same error.

    python -m benchmarks.auto [MODEL …] [--rtol 1e-4 1e-6 1e-9] [--seconds 3] [--keep]

Every method has a curve of time over error, straight in logarithms between its tolerances. A pair (model, tolerance)
is good where `auto` takes at most 1.5 times as long as the fastest curve at the error that `auto` has reached. The
beginning of a long run stands for it all. Times are those of the processor, warm, in turns, the shortest of several.
Where `auto` has used the fastest method itself, the two differ by their work, and evaluations are counted instead: they
do not depend on what else the machine does.

Results are written after each model to ``out/benchmarks/auto.jsonl``; ``--keep`` makes them those of the page, where
they take the place of what was kept of the same models.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Sequence
from pathlib import Path

from benchmarks.common import RESULTS, ROOT, machine, table

METHODS = ("dop853", "taylor", "adams", "cvode")
STIFF = (*METHODS, "cvodes", "radau", "gauss")  # where `auto` has found the scene stiff
TOLERANCES = (1e-4, 1e-6, 1e-9)
GOOD = 1.5
UNNOTICED = 2.0  # ms
CALIBRATED = 0.1, 30.0  # error / rtol
RUN = 0.03  # s that a run by `auto` may take
LONGEST = 0.3, 10.0  # s that a run by another method may take, and times as long as one by `auto`
KEPT = ROOT / "docs" / "charts" / "auto.json"
SECTION = """\
## What `auto` chooses

Over {models} scenes and three tolerances `auto` is within 1.5 times of the fastest method at the same error in {good}
pairs, and within that or 2 ms in {near}. Its error is at most 30 times the tolerance in {not_above}, and at least a
tenth of it in {not_below}: the errors far below are of scenes whose steps end at outputs, breaks or events, or whose
motion a method of order 8 follows exactly. It fails where another method succeeds in {failed}. Before these figures set
its bounds, the error was at most 30 times the tolerance in 103 of 117 pairs, over the classic and the hard scenes and
the failures.

Where `auto` is behind, nearly always, a Taylor series that is compiled already needs fewer steps than DOP853 for the
few milliseconds of a run. To compile it takes a quarter of a second, once for each scene; so `auto` takes it only where
that is regained, over many steps.

The exceptions by more than 2 ms, and the errors above 30 times the tolerance:

{odd}

<details><summary>All pairs: what was chosen, error over tolerance, time over that of the fastest method</summary>

{table}

</details>

`python -m benchmarks.auto` measures this: the beginning of each scene that `auto` does in 30 ms, all methods in turns.
"""


def curve(points, error: float, cost: str = "seconds") -> float:
    """What an error costs with a method, infinity where it does not reach it."""
    reached = sorted((p for p in points if p.ok), key=lambda p: p.error)
    if not reached or error < reached[0].error:
        return math.inf
    best = min(getattr(p, cost) for p in reached if p.error <= error)
    for fine, coarse in zip(reached, reached[1:], strict=False):
        if fine.error <= error < coarse.error:
            share = math.log(error / max(fine.error, 1e-16)) / math.log(coarse.error / max(fine.error, 1e-16))
            low, high = max(getattr(fine, cost), 1e-9), max(getattr(coarse, cost), 1e-9)
            best = min(best, low * (high / low) ** share)
    return best


def judge(path: Path, tolerances: Sequence[float], seconds: float) -> list[dict[str, object]]:
    """The pairs of one model."""
    import lmoc
    from lmoc.numerics.options import RunOptions
    from lmoc.simulation import Request
    from lmoc.studies.points import Measurement, Runner, Setting
    from lmoc.studies.reference import make_reference, probe

    dae = lmoc.compile(path)
    runner = Runner(dae._session, Request(RunOptions()))
    first = probe(runner, 3.0)
    if first.seconds > RUN:
        runner = runner.until(first.begin + (first.reached - first.begin) * RUN / first.seconds)
        first = probe(runner, 3.0)
    reference = make_reference(runner, first, 0.7, lambda text, share: None)
    longest = max(LONGEST[0], LONGEST[1] * first.seconds)
    measurement = Measurement(runner, reference.signals, longest, math.inf, lambda text, share: None)
    finer = sorted({*tolerances, *(t / 10 for t in tolerances)}, reverse=True)
    methods = STIFF if first.stiff else METHODS
    series = [[Setting(name, "reduced", t) for t in finer] for name in methods]
    measurement.measure([[Setting("auto", "reduced", t) for t in tolerances], *series], 0)
    measurement.until = time.thread_time() + seconds
    measurement.measure([], 8)
    by_method = {n: [p for s, p in measurement.points.items() if s.solver == n] for n in methods}
    name = f"{path.parent.name}/{path.stem}"
    return [
        {"model": name, "rtol": rtol, "trusted": reference.uncertainty}
        | _pair(measurement.points[Setting("auto", "reduced", rtol)], by_method, reference.uncertainty)
        for rtol in tolerances
    ]


def _pair(own, by_method: dict[str, list], uncertainty: float) -> dict[str, object]:
    """One row: what `auto` has done, which method is the fastest at its error, and by how much."""
    used = own.note.split(";")[0]
    row = {"auto": used, "error": own.error, "ms": own.seconds * 1e3, "failed": "" if own.ok else own.status[:80]}
    if not own.ok:
        others = [n for n, points in by_method.items() if any(p.ok for p in points)]
        return row | {"best": ", ".join(others), "ratio": math.inf if others else 1.0}
    error = max(own.error, uncertainty)
    times = {n: curve(points, error) for n, points in by_method.items()}
    best = min(times, key=times.__getitem__)
    ratio = own.seconds / times[best] if math.isfinite(times[best]) else 1.0
    if best == used:
        ratio = min(ratio, own.evaluations / curve(by_method[best], error, "evaluations"))
    return row | {"best": best, "ratio": ratio}


def is_good(row: dict) -> bool:
    return row["ratio"] <= GOOD


def is_near(row: dict) -> bool:
    """Whether it is good, or so little behind that nobody notices."""
    return is_good(row) or row["ms"] * (1 - 1 / row["ratio"]) < UNNOTICED


def is_calibrated(row: dict) -> bool | None:
    """Whether the error is near the one asked for; None where the reference is not good enough to tell."""
    share = row["error"] / row["rtol"]
    if row["failed"] or (row["trusted"] > row["error"] and row["trusted"] > CALIBRATED[0] * row["rtol"]):
        return None
    return CALIBRATED[0] <= share <= CALIBRATED[1]


def summary(rows: Sequence[dict]) -> dict[str, tuple[int, int]]:
    """Good and calibrated pairs, each out of how many, and those that fail where another method succeeds."""
    judged = [r for r in rows if is_calibrated(r) is not None]
    return {
        "good": (sum(map(is_good, rows)), len(rows)),
        "near": (sum(map(is_near, rows)), len(rows)),
        "not_above": (sum(r["error"] <= CALIBRATED[1] * r["rtol"] for r in judged), len(judged)),
        "not_below": (sum(r["error"] >= CALIBRATED[0] * r["rtol"] for r in judged), len(judged)),
        "failed": (sum(bool(r["failed"]) for r in rows), len(rows)),
    }


def page(data: dict) -> str:
    """Return the section of `docs/accuracy.md`."""
    rows = data["pairs"]
    found = {key: f"{count} of {total}" for key, (count, total) in summary(rows).items()}
    lines = ["| scene | " + " | ".join(f"{t:.0e} | error/rtol | ratio" for t in TOLERANCES) + " |"]
    lines.append("| --- |" + " --- | --- | --- |" * len(TOLERANCES))
    for name in sorted({r["model"] for r in rows}):
        own = {r["rtol"]: r for r in rows if r["model"] == name}
        cells = [_cells(own[t]) if t in own else "– | – | –" for t in TOLERANCES]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    odd = [r for r in rows if not is_near(r) or r["error"] > CALIBRATED[1] * r["rtol"]]
    return SECTION.format(
        **found, models=len({r["model"] for r in rows}), table="\n".join(lines), odd="\n".join(map(_odd, odd))
    )


def _cells(row: dict) -> str:
    if row["failed"]:
        return "fails | – | –"
    share = row["error"] / row["rtol"]
    mark = "" if is_calibrated(row) is not None else "≈ "
    return f"{row['auto']} | {mark}{share:.1g} | {row['ratio']:.2f}"


def _odd(row: dict) -> str:
    """Return a line about a pair that is not as it should be."""
    what = [f"error {row['error'] / row['rtol']:.0f} times rtol"] * (row["error"] > CALIBRATED[1] * row["rtol"])
    what += [f"{row['ms']:.0f} ms, {row['ratio']:.1f} times as long as {row['best']}"] * (not is_near(row))
    return f"* {row['model']} at {row['rtol']:.0e}: {', '.join(what)}"


def keep(rows: list[dict], without: dict[str, str]) -> None:
    """Keep what has been measured for the page, in place of what was kept of the same models."""
    data = json.loads(KEPT.read_text()) if KEPT.exists() else {"pairs": [], "without": {}}
    measured = {r["model"] for r in rows} | set(without)
    pairs = [*(r for r in data["pairs"] if r["model"] not in measured), *rows]
    others = {name: why for name, why in data["without"].items() if name not in measured} | without
    pairs.sort(key=lambda r: (r["model"], -r["rtol"]))
    KEPT.write_text(json.dumps({"machine": machine(), "pairs": pairs, "without": others}, indent=1) + "\n")


def models(names: Sequence[str]) -> list[Path]:
    """The models named by parts of their paths, else all."""
    every = sorted((ROOT / "models").glob("*/*.lmo"))
    return [p for p in every if not names or any(n in f"{p.parent.name}/{p.stem}" for n in names)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="*", help="parts of their paths; all by default")
    parser.add_argument("--rtol", nargs="*", type=float, default=list(TOLERANCES))
    parser.add_argument("--seconds", type=float, default=3.0, help="of the processor for the repeats of each model")
    parser.add_argument("--keep", action="store_true", help="keep the result for the page")
    arguments = parser.parse_args()
    RESULTS.mkdir(parents=True, exist_ok=True)
    rows, without = [], {}
    with (RESULTS / "auto.jsonl").open("a") as file:
        for path in models(arguments.models):
            try:
                own = judge(path, arguments.rtol, arguments.seconds)
            except Exception as error:  # a scene without states, or one that is meant to fail, has no chart
                without[f"{path.parent.name}/{path.stem}"] = f"{type(error).__name__}: {error}"[:160]
                print(f"{path.stem}: {type(error).__name__}: {str(error)[:120]}", flush=True)
                continue
            for row in own:
                file.write(json.dumps(row) + "\n")
                share = row["error"] / row["rtol"]
                mark = " " if is_good(row) else "*"
                mark += {None: "?", True: " ", False: "!"}[is_calibrated(row)]
                print(f"{mark} {row['model']:38} {row['rtol']:.0e} {share:9.3g} {row['ms']:8.3g} ms "
                      f"{row['ratio']:7.3g}  {row['auto']} / {row['best']} {row['failed']}", flush=True)  # fmt: skip
            file.flush()
            rows += own
    table("pairs", ["", "of them", "of"], [[k, *v] for k, v in summary(rows).items()])
    if arguments.keep:
        keep(rows, without)


if __name__ == "__main__":
    main()
