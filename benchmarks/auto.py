"""How good the choice of `auto` is: over models and tolerances, its time against the best method's at the same error.

    python -m benchmarks.auto [MODEL …] [--unseen] [--rtol 1e-4 1e-6 1e-9] [--seconds 3] [--keep]

Every method has a curve of time over error, straight in logarithms between its tolerances. A pair (model, tolerance)
is good where `auto` takes at most 1.5 times as long as the fastest curve at the error that `auto` has reached. The
beginning of a long run stands for it all. Times are those of the processor, warm, in turns, the shortest of several.
Where `auto` has used the fastest method itself, the two differ by their work, and evaluations are counted instead: they
do not depend on what else the machine does.

What `auto` does is the same in the first run of a scene and in all others, while the other methods find their Taylor
series compiled.

Results are written after each model to ``out/benchmarks/auto.jsonl``; ``--keep`` makes them those of the page, where
they take the place of what was kept of the same models, and writes that section of `docs/accuracy.md`. The scenes in
`benchmarks/unseen/` were written after the rules of `auto` and are no part of the table: ``--unseen`` judges them.
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
REFERENCE = 2.0  # s that a run of the reference may take
UNJUDGED = ("failures/drift",)  # what their outputs are is an error itself
LONGEST = 0.3, 10.0  # s that a run by another method may take, and times as long as one by `auto`
KEPT = ROOT / "docs" / "charts" / "auto.json"
PAGE = ROOT / "docs" / "accuracy.md"
TITLE = "## What `auto` chooses"
SECTION = """\
{title}

Over {models} scenes and three tolerances, with the time of `auto` against that of the fastest method at the same error:

{shares}

"Before" is what `auto` did when this table was first made; "now" is the same in the first run of a scene and in all
others; "without series" compares with the methods other than the Taylor series. Errors far below the
tolerance cost nothing: the series has an order of 18 at least, and steps end at outputs, breaks or events.
`failures/drift` is left out of the errors: its output is itself what the steps' errors have made.

Why `auto` chooses so: along a Taylor series a sum costs the same at each order, a product as much as there are orders
below. So it is faster than DOP853 where sums outweigh products and functions in the equations, by up to ten times in
long runs, whose errors add up less along it; and for less than 1000 steps the change is not worth while. In scenes of
up to 60 rows of equations it is as fast as DOP853 or faster from the first step on, whatever is in them, since what a
step takes beside the equations outweighs these. What other runs have done does not count: the same call gives the same
bits.

The exceptions by more than 2 ms, and the errors above 30 times the tolerance:

{odd}

<details><summary>All pairs: what was chosen, error over tolerance, time over that of the fastest method; the same ratio
before, and now over that of the fastest method but the series</summary>

{table}

</details>

`python -m benchmarks.auto` measures this: the beginning of each scene that `auto` does in 30 ms, all methods in turns.
The rules of `auto` were tried on {unseen_models} scenes that are not in the table (`benchmarks/unseen/`): {unseen}.
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
    from lmoc.numerics.options.options import RunOptions
    from lmoc.simulation import Request
    from lmoc.studies.points import Measurement, Runner, Setting
    from lmoc.studies.reference import make_reference, probe

    runner = Runner(lmoc.compile(path)._session, Request(RunOptions()))
    first = probe(runner, 3.0)
    if first.seconds > RUN:
        runner = runner.until(first.begin + (first.reached - first.begin) * RUN / first.seconds)
        first = probe(runner, 3.0)
    reference = make_reference(runner, first, REFERENCE, lambda text, share: None)
    longest = max(LONGEST[0], LONGEST[1] * first.seconds)
    finer = sorted({10 * max(tolerances), *tolerances, *(t / 10 for t in tolerances)}, reverse=True)
    methods = STIFF if first.stiff else METHODS
    own = [Setting("auto", "reduced", t) for t in tolerances]

    measurement = Measurement(runner, reference.signals, longest, math.inf, lambda text, share: None)
    measurement.measure([[Setting(name, "reduced", t) for t in finer] for name in methods], 0)
    measurement.measure([own], 0)
    measurement.until = time.thread_time() + seconds
    measurement.measure([], 8)
    by_method = {n: [p for s, p in measurement.points.items() if s.solver == n] for n in methods}

    uncompiled = {n: points for n, points in by_method.items() if n != "taylor"}
    name = f"{path.parent.name}/{path.stem}"
    return [
        {"model": name, "rtol": setting.rtol, "trusted": reference.uncertainty}
        | _pair(measurement.points[setting], by_method, reference.uncertainty)
        | {"first": _pair(measurement.points[setting], uncompiled, reference.uncertainty)}
        for setting in own
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
    if best == used and math.isfinite(times[best]):
        ratio = min(ratio, own.evaluations / curve(by_method[best], error, "evaluations"))
    return row | {"best": best, "ratio": ratio}


def is_good(row: dict) -> bool:
    return row["ratio"] <= GOOD


def is_near(row: dict, unnoticed: float = UNNOTICED) -> bool:
    """Whether it is good, or so many ms behind at most that nobody notices."""
    return is_good(row) or row["ms"] * (1 - 1 / row["ratio"]) < unnoticed


def is_calibrated(row: dict) -> bool | None:
    """Whether the error is near the one asked for; None where the reference is not good enough to tell."""
    share = row["error"] / row["rtol"]
    if row["failed"] or (row["trusted"] > row["error"] and row["trusted"] > CALIBRATED[0] * row["rtol"]):
        return None
    return CALIBRATED[0] <= share <= CALIBRATED[1]


def summary(rows: Sequence[dict]) -> dict[str, tuple[int, int]]:
    """Return {property: (pairs with it, pairs judged)}."""
    judged = [r for r in rows if is_calibrated(r) is not None and r["model"] not in UNJUDGED]
    return {
        "within 1.5 times": (sum(map(is_good, rows)), len(rows)),
        "within 1.5 times or 1 ms": (sum(is_near(r, 1.0) for r in rows), len(rows)),
        "within 1.5 times or 2 ms": (sum(map(is_near, rows)), len(rows)),
        "error at most 30 times the tolerance": (
            sum(r["error"] <= CALIBRATED[1] * r["rtol"] for r in judged), len(judged)
        ),
        "error at least a tenth of it": (sum(r["error"] >= CALIBRATED[0] * r["rtol"] for r in judged), len(judged)),
        "fails where another method succeeds": (sum(bool(r["failed"]) for r in rows), len(rows)),
    }  # fmt: skip


def firsts(rows: Sequence[dict]) -> list[dict]:
    """The same pairs against the methods that need no compiler."""
    return [r | r["first"] for r in rows if "first" in r]


def page(data: dict) -> str:
    """Return the section of `docs/accuracy.md`."""
    rows, before, unseen = data["pairs"], data["before"], data["unseen"]
    shares = summary(unseen), summary(firsts(unseen))
    lines = ["| scene | " + " | ".join(f"{t:.0e} | error/rtol | ratio | before | without" for t in TOLERANCES) + " |"]
    lines.append("| --- |" + " --- |" * 5 * len(TOLERANCES))
    for name in sorted({r["model"] for r in rows}):
        cells = [_cells(_of(rows, name, t), _of(before, name, t)) for t in TOLERANCES]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    odd = [r for r in rows if not is_near(r) or (_is_above(r) and r["model"] not in UNJUDGED)]
    good, near = (shares[0][key] for key in ("within 1.5 times", "within 1.5 times or 2 ms"))
    return SECTION.format(
        title=TITLE,
        models=len({r["model"] for r in rows}), table="\n".join(lines), odd="\n".join(map(_odd, odd)),
        shares=_shares(before, rows, firsts(rows)), unseen_models=len({r["model"] for r in unseen}),
        unseen=f"{good[0]} of {good[1]} pairs are within 1.5 times, {near[0]} within that or 2 ms; without series "
        f"{shares[1]['within 1.5 times'][0]} and {shares[1]['within 1.5 times or 2 ms'][0]}",
    )  # fmt: skip


def _shares(before: list[dict], rows: list[dict], first: list[dict]) -> str:
    """Return a table of what holds for how many pairs."""
    columns = [summary(rows) for rows in (before, rows, first)]
    lines = ["| pairs | before | now | without series |", "| --- | --- | --- | --- |"]
    for key in columns[0]:
        lines.append(f"| {key} | " + " | ".join(f"{c[key][0]} of {c[key][1]}" for c in columns) + " |")
    return "\n".join(lines)


def _of(rows: list[dict], model: str, rtol: float) -> dict | None:
    return next((r for r in rows if r["model"] == model and r["rtol"] == rtol), None)


def _cells(row: dict | None, before: dict | None) -> str:
    earlier = "–" if before is None else f"{before['ratio']:.2f}"
    if row is None or row["failed"]:
        return f"{'–' if row is None else 'fails'} | – | – | {earlier} | –"
    mark = "" if is_calibrated(row) is not None else "≈ "
    share, first = row["error"] / row["rtol"], row["first"]
    return f"{row['auto']} | {mark}{share:.1g} | {row['ratio']:.2f} | {earlier} | {first['ratio']:.2f}"


def _is_above(row: dict) -> bool:
    """Whether the error is too large, as far as the reference tells."""
    return is_calibrated(row) is False and row["error"] > CALIBRATED[1] * row["rtol"]


def _odd(row: dict) -> str:
    """Return a line about a pair that is not as it should be."""
    if row["failed"]:
        return f"* {row['model']} at {row['rtol']:.0e}: fails; without failure: {row['best'] or 'none'}"
    what = [f"error {row['error'] / row['rtol']:.0f} times rtol"] * _is_above(row)
    what += [f"{row['ms']:.0f} ms, {row['ratio']:.1f} times as long as {row['best']}"] * (not is_near(row))
    return f"* {row['model']} at {row['rtol']:.0e}: {', '.join(what)}"


def keep(rows: list[dict], without: dict[str, str], part: str) -> None:
    """Keep what has been measured, in place of what was kept of the same models, and write the page's section."""
    data = json.loads(KEPT.read_text())
    measured = {r["model"] for r in rows} | set(without)
    pairs = [*(r for r in data[part] if r["model"] not in measured), *rows]
    pairs.sort(key=lambda r: (r["model"], -r["rtol"]))
    others = {name: why for name, why in data["without"].items() if name not in measured} | without
    data |= {"machine": machine(), part: pairs, "without": others}
    KEPT.write_text(json.dumps(data, indent=1) + "\n")
    text = PAGE.read_text()
    begin = text.index(TITLE)
    end = text.find("\n## ", begin) + 1 or len(text)
    PAGE.write_text(text[:begin] + page(data) + ("\n" if end < len(text) else "") + text[end:])


def models(names: Sequence[str], unseen: bool) -> list[Path]:
    """The models named by parts of their paths, else all; of the table, or of those that are not in it."""
    every = sorted((ROOT / "benchmarks").glob("unseen/*.lmo") if unseen else (ROOT / "models").glob("*/*.lmo"))
    return [p for p in every if not names or any(n in f"{p.parent.name}/{p.stem}" for n in names)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="*", help="parts of their paths; all by default")
    parser.add_argument("--unseen", action="store_true", help="the scenes that the rules were not made by")
    parser.add_argument("--rtol", nargs="*", type=float, default=list(TOLERANCES))
    parser.add_argument("--seconds", type=float, default=3.0, help="of the processor for the repeats of each model")
    parser.add_argument("--keep", action="store_true", help="keep the result, and write the section of the page")
    arguments = parser.parse_args()
    RESULTS.mkdir(parents=True, exist_ok=True)
    rows, without = [], {}
    with (RESULTS / "auto.jsonl").open("a") as file:
        for path in models(arguments.models, arguments.unseen):
            try:
                own = judge(path, arguments.rtol, arguments.seconds)
            except Exception as error:  # a scene without states, or one that is meant to fail, has no chart
                text = f"{type(error).__name__}: {error}".replace(f"{ROOT}/", "")
                without[f"{path.parent.name}/{path.stem}"] = text[:160]
                print(f"{path.stem}: {type(error).__name__}: {str(error)[:120]}", flush=True)
                continue
            for row in own:
                file.write(json.dumps(row) + "\n")
                print(_line(row), flush=True)
            file.flush()
            rows += own
    again, first = summary(rows), summary(firsts(rows))
    table("pairs", ["", "again", "first", "of"], [[k, again[k][0], first[k][0], again[k][1]] for k in again])
    if arguments.keep:
        keep(rows, without, "unseen" if arguments.unseen else "pairs")


def _line(row: dict) -> str:
    """Return what is printed of a pair."""
    mark = (" " if is_good(row) else "*") + {None: "?", True: " ", False: "!"}[is_calibrated(row)]
    share, first = row["error"] / row["rtol"], row["first"]
    return (
        f"{mark} {row['model']:38} {row['rtol']:.0e} {share:9.3g} {row['ms']:8.3g} ms {row['ratio']:7.3g}  "
        f"{row['auto']} / {row['best']} {row['failed']} | first {first['error'] / row['rtol']:9.3g} "
        f"{first['ms']:8.3g} ms {first['ratio']:7.3g}  {first['auto']} / {first['best']} {first['failed']}"
    )


if __name__ == "__main__":
    main()
