"""FMUs of models against `simulate`, by FMPy: Model Exchange with CVode, Co-Simulation with few and many steps.

    python benchmarks/fmi.py [--parameters] [FILE …]

For each model (those of notes, hard and planar by default) and version of FMI: what `validate_fmu` says, and the
largest difference from `DAE.simulate` over states and outputs, as a multiple of the tolerance of the size of each.
With `--parameters` instead, for each parameter that can be set, the difference where it is larger by 30 %.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

import lmoc

RTOL = 1e-6
MODELS = Path(__file__).parents[1] / "models"


def difference(run, result, names) -> float:
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
            found[kind, steps] = difference(run, result[np.minimum(keep, len(result) - 1)], names)
    return said, found


def by_parameters(path: str | Path) -> dict[str, float | str]:
    """Return, for each parameter that can be set, how far the end of a run is off with another value of it."""
    import fmpy

    dae, found = lmoc.compile(path), {}
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "scene.fmu"
        exported = dae.export(target)
        description = fmpy.read_model_description(str(target))
        names = [n for n in (*dae.states, *dae.outputs) if n in dae.variables]
        stop = float(description.defaultExperiment.stopTime)
        times = [float(description.defaultExperiment.startTime), stop]
        for v in [v for v in description.modelVariables if v.causality == "parameter"][:40]:
            value = float(v.start) * 1.3 or 0.01
            try:
                run = dae.simulate(
                    times=times, rtol=RTOL / 100, inputs=exported.zero_inputs, parameters={v.name: value}
                )
                result = fmpy.simulate_fmu(
                    str(target), fmi_type="CoSimulation", start_time=times[0], stop_time=stop, relative_tolerance=RTOL,
                    output_interval=stop - times[0], start_values={v.name: value}, output=names, logger=lambda *_: None,
                )  # fmt: skip
                found[v.name] = difference(run, result[[0, -1]], names)
            except Exception as error:
                found[v.name] = f"{type(error).__name__}: {str(error)[:150]}"
    return found


def _tell_by_parameters(paths: list[Path]) -> None:
    for path in paths:
        try:
            found = by_parameters(path)
        except lmoc.ModelError as error:
            print(f"{path.stem:36} refused: {error.diagnostics[-1].message[:150]}")
            continue
        worst = max((v for v in found.values() if not isinstance(v, str)), default=0.0)
        odd = {n: v for n, v in found.items() if isinstance(v, str) or v > 100}
        print(f"{path.stem:36} {len(found)} parameters, {worst:.3g} {odd or ''}", flush=True)


def main(files: list[str]) -> None:
    every = [p for kind in ("notes", "hard", "planar") for p in sorted((MODELS / kind).glob("*.lmo"))]
    paths = [Path(f) for f in files if f != "--parameters"] or every
    if "--parameters" in files:
        return _tell_by_parameters(paths)
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
