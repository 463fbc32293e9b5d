"""Examples of a Modelica library beside the reference results that are published with it.

    python -m benchmarks.msl FOLDER REFERENCES PACKAGE … [--tube 0.002] [--timeout 60]

FOLDER holds the library as it is published (`Modelica/`, `Complex.mo`, …; github.com/modelica/ModelicaStandardLibrary),
REFERENCES its results (`Modelica/Mechanics/…/Example/Example.csv`; github.com/modelica/MAP-LIB_ReferenceResults);
neither is part of this project. PACKAGE is a dotted name, `Modelica.Mechanics.Rotational`: all examples with a
reference below it are run, each in a process of its own, so that nothing that one leaves behind helps another.

An example is *right* where each of its signals stays within a tube around that of the reference: at most `tube` of
the signal's range above or below what the reference takes within `tube` of the whole time before and after. Where the
reference jumps or bends between two samples, nobody knows when: both sides go on as lines until there. Between samples
that are too far apart to show what the model does, a reference says nothing: a run that leaves the tube is looked at
once more at the reference's own times, and is right *at samples* where it stays within the tube there.

Some references follow from the model only with a value that it does not say (`GIVEN`): their row tells it.
`benchmarks.msl_proofs` shows what stands behind rows that no reference decides.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from benchmarks.common import ROOT, save, table

_JUMP = 10  # times what a signal, or its slope, changes by before and after

_NOISE = "Modelica.Blocks.Examples.Noise"
# Seeds that a tool has made of the name of a block, found by trying all that there are against the reference's numbers;
# and one of three starting states: the simplified model of `homotopy` in version 4.0.0 leads to the upper limit, the
# reference begins at the lower one, and the library has corrected the model (its pull request 3590).
GIVEN: dict[str, dict[str, float]] = {
    f"{_NOISE}.ActuatorWithNoise": {
        "motor.uniformNoise.useAutomaticLocalSeed": False, "motor.uniformNoise.fixedLocalSeed": -1385457713
    },
    f"{_NOISE}.DrydenContinuousTurbulence": {
        "whiteNoise.useAutomaticLocalSeed": False, "whiteNoise.fixedLocalSeed": 1653520918
    },
    "Modelica.Electrical.Analog.Examples.OpAmps.SignalGenerator": {"opAmp1.homotopyType": 4},  # LowerLimit
}  # fmt: skip


def examples(references: Path, package: str) -> Iterator[tuple[str, Path | None]]:
    """Yield (dotted name, its reference or None where there is no file) of all examples below a package."""
    below = references.joinpath(*package.split("."))
    for folder in sorted({p.parent for p in [*below.rglob("comparisonSignals.txt"), *below.rglob("*.csv")]}):
        csv = folder / f"{folder.name}.csv"
        yield ".".join(folder.relative_to(references).parts), csv if csv.exists() else None


def reference(path: Path) -> dict[str, np.ndarray]:
    """Return the signals of a reference result, "time" among them."""
    with path.open() as file:
        names = [name.strip().strip('"') for name in file.readline().split('","')]
        values = np.atleast_2d(np.loadtxt(file, delimiter=","))
    return dict(zip(names, values.T, strict=True))


def outside(at: np.ndarray, truth: np.ndarray, run_time: np.ndarray, run: np.ndarray, tube: float) -> float:
    """Return by how many of its widths a run leaves the tube around a reference; ≤ 1 is inside.

    Parameters
    ----------
    at, truth : the reference
    run_time, run : the run, densely sampled
    tube : half its width, as a share of the signal's range and of the whole time
    """
    if not np.isfinite(run).all():
        return np.inf
    width = tube * (at[-1] - at[0])
    low = np.searchsorted(at, run_time - width, "left")
    high = np.searchsorted(at, run_time + width, "right")
    span = max(float(np.ptp(truth)), 1e-3 * float(np.abs(truth).max()), 1e-9)
    worst = 0.0
    for a, b, t, y in zip(low.tolist(), high.tolist(), run_time.tolist(), run.tolist(), strict=True):
        near = np.array([*truth[a:b], np.interp(t, at, truth), *sides(at, truth, t)])
        worst = max(worst, (near.min() - y) / span, (y - near.max()) / span)
    return float(worst / tube)


def sides(at: np.ndarray, truth: np.ndarray, t: float) -> list[float]:
    """Return what the two sides of a jump or a bend come to at a time between the samples around it; else nothing."""
    k = int(np.searchsorted(at, t, "right")) - 1
    if not 1 <= k < len(at) - 2:
        return []
    length, change = np.diff(at[k - 1 : k + 3]), np.diff(truth[k - 1 : k + 3])
    if length.min() <= 0:
        return []
    left = truth[k] + change[0] / length[0] * (t - at[k])
    right = truth[k + 1] - change[2] / length[2] * (at[k + 1] - t)
    if abs(change[1]) > _JUMP * max(abs(change[0]), abs(change[2])):
        return [left, right]
    bend = _bend(at[k - 2 : k + 4], truth[k - 2 : k + 4]) if k >= 2 else None
    return [] if bend is None else [left if t < bend else right]


def _bend(at: np.ndarray, truth: np.ndarray) -> float | None:
    """Return when straight lines through the first and the last three of six samples meet between the middle ones."""
    if len(at) < 6 or np.diff(at).min() <= 0:
        return None
    slope = np.diff(truth) / np.diff(at)
    change = slope[3] - slope[1]
    if abs(change) <= _JUMP * max(abs(slope[1] - slope[0]), abs(slope[4] - slope[3])):
        return None
    meet = (truth[2] - truth[3] + slope[3] * at[3] - slope[1] * at[2]) / change
    return float(meet) if at[2] <= meet <= at[3] else None


def run_one(library: str, name: str, csv: str | None, tube: float) -> dict[str, object]:
    """Compile and run one example, and hold it against its reference."""
    import lmoc

    found: dict[str, object] = {"name": name, "compiles": False, "runs": False, "right": None, "stops": ""}
    begin = time.perf_counter()
    try:
        dae = lmoc.compile(name, path=library, parameters=GIVEN.get(name))
        found["compiles"], found["compile_s"] = True, time.perf_counter() - begin
        truth = reference(Path(csv)) if csv else {}
        begin = time.perf_counter()
        run = dae.simulate(stop=float(truth["time"][-1]) if truth else None, points=5001)
        found["runs"], found["run_s"] = True, time.perf_counter() - begin
        found.update(judged(run, truth, tube))
        if found["right"] is False and "worst" in found:
            at_samples = judged(dae.simulate(times=np.unique(truth["time"])), truth, tube)
            if at_samples["right"]:
                found.update(right="samples", stops=f"between samples {found['stops']}")
        if name in GIVEN:
            given = ", ".join(f"{k} = {v}" for k, v in GIVEN[name].items())
            found["stops"] = f"given {given}. {found['stops']}".strip()
    except (lmoc.ModelError, lmoc.SimulationError) as error:
        said = [d for d in getattr(error, "diagnostics", ()) if d.severity == "error"]
        text = f"{said[0].code}: {said[0].message}" if said else str(error)
        where = f" ({Path(said[0].span.source.name).name}:{said[0].span.line})" if said and said[0].span else ""
        found["stops"] = (" ".join(text.split()) + where)[:160]
    except Exception as error:  # a mistake of ours is a row of the table, too
        found["stops"] = f"internal: {type(error).__name__}: {error}"[:160]
    return found


def judged(run, truth: Mapping[str, np.ndarray], tube: float) -> dict[str, object]:
    """Return whether all signals of the reference are there and within the tube."""
    if not truth:
        return {"right": None, "stops": "no reference"}
    worst, which = 0.0, ""
    for signal, values in truth.items():
        if signal == "time":
            continue
        try:
            own = np.asarray(run[signal], float)
        except KeyError:
            return {"right": False, "stops": f"'{signal}' is missing"}
        before = run.time < run.time[-1]  # whether an event at the stop time still happens is a matter of the tool
        found = outside(truth["time"], values, run.time[before], np.broadcast_to(own, run.time.shape)[before], tube)
        if found > worst:
            worst, which = found, signal
    return {
        "right": bool(worst <= 1),
        "worst": float(worst),
        "stops": "" if worst <= 1 else f"{which}: {worst:.3g} tubes",
    }


def in_process(arguments: argparse.Namespace, name: str, csv: Path | None) -> dict[str, object]:
    """Return the row of one example, run in a process of its own."""
    command = [sys.executable, "-m", "benchmarks.msl", str(arguments.library), str(arguments.references), name, "--one"]
    command += ["--tube", str(arguments.tube), *(["--csv", str(csv)] if csv else [])]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=arguments.timeout, cwd=ROOT)
        return json.loads(done.stdout.strip().splitlines()[-1])
    except subprocess.TimeoutExpired:
        stops = f"no end within {arguments.timeout:g} s"
    except (IndexError, json.JSONDecodeError):
        stops = f"died: {done.stderr.strip()[-120:]}"
    return {"name": name, "compiles": None, "runs": False, "right": False, "stops": stops}


def main() -> None:
    """Run the examples, print the table of each package and the counts of all."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("library", type=Path)
    parser.add_argument("references", type=Path)
    parser.add_argument("packages", nargs="+")
    parser.add_argument("--tube", type=float, default=0.002)
    parser.add_argument("--timeout", type=float, default=60.0)
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--csv", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one:
        print(json.dumps(run_one(str(arguments.library), arguments.packages[0], arguments.csv, arguments.tube)))
        return
    counts, figures = [], []
    for package in arguments.packages:
        rows = []
        for name, csv in examples(arguments.references, package):
            rows.append(in_process(arguments, name, csv))
            print(".", end="", flush=True, file=sys.stderr)
        figures += rows
        marks = {True: "yes", "samples": "at samples", False: "no", None: "-"}
        cells = [
            [r["name"].removeprefix(package + "."), *(marks[r[k]] for k in ("compiles", "runs", "right")),
             r.get("compile_s"), r.get("run_s"), r["stops"]]
            for r in rows
        ]  # fmt: skip
        table(package, ("example", "compiles", "runs", "right", "compile s", "run s", "stopped by"), cells)
        known = [sum(r[k] is True for r in rows) for k in ("compiles", "runs", "right")]
        others = sum(r["right"] == "samples" for r in rows), sum(r["right"] is None and r["runs"] for r in rows)
        counts.append([package, len(rows), *known, *others])
    table("sum", ("package", "examples", "compile", "run", "right", "right at samples", "no reference"), counts)
    save("msl", figures)


if __name__ == "__main__":
    main()
