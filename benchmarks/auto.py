"""How good the choice of `auto` is: over models and tolerances, its time against the best method's at the same error.

    python -m benchmarks.auto [--folders notes hard classic planar laws] [--rtol 1e-4 1e-6 1e-9] [--save NAME]

Every method has a curve of time over error, straight in logarithms between its tolerances. A pair (model, tolerance)
is good where `auto` takes at most 1.5 times as long as the fastest curve at the error that `auto` has reached. The
beginning of a long run stands for it all. Times are those of the processor, warm, in turns, the shortest of several.
"""

from __future__ import annotations

import argparse
import math
import time

from benchmarks.common import ROOT, save, table

METHODS = ("dop853", "taylor", "adams", "cvode", "radau", "gauss")
TOLERANCES = (1e-4, 1e-6, 1e-9)
GOOD = 1.5
RUN = 0.03  # s that a run by `auto` may take


def curve(points, error: float) -> float:
    """Seconds that a method needs for an error, infinity where it does not reach it."""
    reached = sorted((p for p in points if p.ok and p.error > 0), key=lambda p: p.error)
    if not reached or error < reached[0].error:
        return math.inf
    best = min(p.seconds for p in reached if p.error <= error)
    for fine, coarse in zip(reached, reached[1:], strict=False):
        if fine.error <= error < coarse.error:
            share = math.log(error / fine.error) / math.log(coarse.error / fine.error)
            best = min(best, fine.seconds * (coarse.seconds / fine.seconds) ** share)
    return best


def judge(path, tolerances) -> list[dict[str, object]]:
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
    reference = make_reference(runner, first, 3.0, lambda text, share: None)
    until = time.thread_time() + 8.0
    measurement = Measurement(runner, reference.signals, 0.25, until, lambda text, share: None)
    finer = sorted({*tolerances, *(t / 10 for t in tolerances)}, reverse=True)
    series = [[Setting(name, "reduced", t) for t in finer] for name in METHODS]
    measurement.measure([[Setting("auto", "reduced", t) for t in tolerances], *series], 2)
    rows = []
    for rtol in tolerances:
        own = measurement.points[Setting("auto", "reduced", rtol)]
        row = {"model": path.stem, "rtol": rtol, "auto": own.note.split(";")[0], "error/rtol": own.error / rtol,
               "ms": own.seconds * 1e3, "trusted": reference.uncertainty < own.error}  # fmt: skip
        times = {n: curve([p for s, p in measurement.points.items() if s.solver == n], own.error) for n in METHODS}
        best = min(times, key=times.__getitem__)
        if not own.ok:
            row |= {"best": own.status[:60], "ratio": math.inf}
        else:
            row |= {"best": best, "ratio": own.seconds / times[best] if math.isfinite(times[best]) else 1.0}
        rows.append(row)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folders", nargs="*", default=["notes", "hard", "classic", "planar", "laws"])
    parser.add_argument("--models", nargs="*", help="only these")
    parser.add_argument("--rtol", nargs="*", type=float, default=list(TOLERANCES))
    parser.add_argument("--save", default="auto")
    arguments = parser.parse_args()
    rows = []
    for folder in arguments.folders:
        for path in sorted((ROOT / "models" / folder).glob("*.lmo")):
            if arguments.models and path.stem not in arguments.models:
                continue
            try:
                rows += judge(path, arguments.rtol)
            except Exception as error:  # a scene without states, or one that is meant to fail, has no chart
                print(f"{path.stem}: {type(error).__name__}: {str(error)[:120]}")
    table("auto against the fastest method at the same error", list(rows[0]), [list(r.values()) for r in rows])
    good = sum(r["ratio"] <= GOOD for r in rows)
    calibrated = sum(0.1 <= r["error/rtol"] <= 30 for r in rows if r["trusted"])
    print(f"\nwithin {GOOD} times of the best: {good} of {len(rows)} pairs")
    print(f"error/rtol between 0.1 and 30: {calibrated} of {sum(r['trusted'] for r in rows)} pairs")
    save(arguments.save, rows)


if __name__ == "__main__":
    main()
