"""FMUs of models against `simulate`, by FMPy: Model Exchange with CVode, Co-Simulation with few and many steps.

    python benchmarks/fmi.py [FILE …]

For each model (those of notes, hard and planar by default) and version of FMI: what `validate_fmu` says, and the
largest difference from `DAE.simulate` over states and outputs, as a multiple of the tolerance of the size of each.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

import lmoc

RTOL = 1e-6
MODELS = Path(__file__).parents[1] / "models"


def difference(run, result, names, begin: float) -> float:
    """Largest difference over some variables, in units of RTOL times the largest magnitude of each."""
    worst = 0.0
    for name in names:
        expected, found = np.asarray(run[name]), result[name]
        size = max(float(np.abs(expected).max()), 1e-3)
        worst = max(worst, float(np.abs(np.interp(run.time, result["time"], found) - expected).max()) / size / RTOL)
    return worst


def compare(path: str | Path, fmi: int, kinds=(("ModelExchange", 500), ("CoSimulation", 10), ("CoSimulation", 1000))):
    """Return what validation says, and {(kind, steps): difference in units of RTOL}."""
    from fmpy import simulate_fmu
    from fmpy.validation import validate_fmu

    dae = lmoc.compile(path)
    with tempfile.TemporaryDirectory() as folder:
        target = str(Path(folder) / "scene.fmu")
        exported = dae.export(target, fmi=fmi)
        said = validate_fmu(target)
        experiment = dae.simulate(points=2, inputs=exported.zero_inputs)
        start, stop = float(experiment.time[0]), float(experiment.time[-1])
        found = {}
        for kind, steps in kinds:
            times = np.linspace(start, stop, steps + 1)
            run = dae.simulate(times=times, rtol=RTOL / 100, inputs=exported.zero_inputs)
            names = [n for n in (*dae.states, *dae.outputs) if n in dae.variables]
            result = simulate_fmu(
                target, fmi_type=kind, start_time=start, stop_time=stop, output_interval=(stop - start) / steps,
                relative_tolerance=RTOL / 100 if kind == "ModelExchange" else RTOL, output=names,
                logger=lambda *_: None,
            )  # fmt: skip
            keep = np.searchsorted(result["time"], times - 1e-9 * (stop - start))
            found[kind, steps] = difference(run, result[np.minimum(keep, len(result) - 1)], names, start)
    return said, found


def main(files: list[str]) -> None:
    every = [p for kind in ("notes", "hard", "planar") for p in sorted((MODELS / kind).glob("*.lmo"))]
    paths = [Path(f) for f in files] or every
    for path in paths:
        for fmi in (3, 2):
            try:
                said, found = compare(path, fmi)
            except lmoc.ModelError as error:
                print(f"{path.stem:36} refused: {error.diagnostics[-1].message[:150]}")
                break
            except Exception as error:
                print(f"{path.stem:36} {fmi}: FAILED {type(error).__name__}: {str(error)[:300]}")
                continue
            text = "  ".join(f"{kind[0]}{steps}: {value:.3g}" for (kind, steps), value in found.items())
            print(f"{path.stem:36} {fmi}: {text}{'  ' + '; '.join(said)[:300] if said else ''}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
