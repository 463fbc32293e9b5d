"""Run every model of the repository as an ensemble and alone: ``python tests/many_lanes.py [PART OF A PATH]``.

Some parameters of each have random values around their own. Runs of the ensemble have the bits of single runs, and fail
where these fail. A line for each model tells how many of its runs C has made several at a time.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

import lmoc
from lmoc.studies import batch, lanes

ROOT = Path(__file__).parents[1]
RUNS, SECONDS = 6, 20.0


def varied(dae, rng) -> dict[str, np.ndarray]:
    """Return random values of up to three real parameters that are neither zero nor structural."""
    own = {name: v for name, v in dae.parameters.items() if isinstance(v, float) and v != 0 and np.isfinite(v)}
    names = rng.permutation(sorted(own))[:3]
    return {str(name): own[name] * rng.uniform(0.95, 1.05, RUNS) for name in names}


def differences(dae, options: dict, values: dict[str, np.ndarray]) -> tuple[list[str], int]:
    """Return what differs between the ensemble and single runs, and how many of its runs C has made at once."""
    seen: set[int] = set()

    def noted(job, rows):
        made = lanes.rows_in_lanes(job, rows)
        seen.update(row for part, _ in made for row in part)
        return made

    batch.rows_in_lanes = noted
    many, found = dae.ensemble(values, workers=1, **options), []
    for row in range(RUNS):
        own = {name: float(v[row]) for name, v in values.items()}
        try:
            run = dae.simulate(parameters=own, **options)
        except (lmoc.SimulationError, lmoc.ModelError):
            found += [] if many.failed[row] else [f"run {row} fails alone"]
            continue
        if many.failed[row]:
            found.append(f"run {row} fails in the ensemble: {many.reasons[row]}")
            continue
        for name in many.kept:
            if not np.array_equal(many[name][row], run[name], equal_nan=True):
                found.append(f"run {row}: {name} differs by {np.nanmax(np.abs(many[name][row] - run[name])):.1e}")
    return found, len(seen)


def outcome(path: Path) -> tuple[str, bool]:
    """Return what is to be said of a model, and whether something differs."""
    dae = lmoc.compile(path)
    stop = dae.prepare().reduced.flat.experiment.stop
    options = {"points": 30, "stop": min(stop or 1.0, 2.0)}
    begin = time.perf_counter()
    dae.simulate(**options)
    if time.perf_counter() - begin > SECONDS / RUNS:
        options["stop"] /= 10
    values = varied(dae, np.random.default_rng(3))
    if not values:
        return "has no parameters", False
    found, together = differences(dae, options, values)
    return f"{together} of {RUNS} in C {'; '.join(found[:3])}", bool(found)


def main() -> int:
    """Try all models; return how many differ."""
    part, wrong = sys.argv[1] if len(sys.argv) > 1 else "", 0
    for path in sorted((ROOT / "models").rglob("*.lmo")):
        if part not in str(path):
            continue
        try:
            text, differs = outcome(path)
        except (lmoc.ModelError, lmoc.SimulationError) as error:
            text, differs = f"not run: {str(error).splitlines()[0]}", False
        wrong += differs
        print(f"{path.relative_to(ROOT)}: {text}", flush=True)
    print(f"{wrong} models differ")
    return wrong


if __name__ == "__main__":
    sys.exit(min(1, main()))
