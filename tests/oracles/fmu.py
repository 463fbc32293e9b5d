"""FMUs as FMPy runs them."""

from __future__ import annotations

import pickle
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np


def instance(path, kind="CoSimulation", **more):
    """An instance that has been set up but not initialized; and value references by name."""
    import fmpy

    description = fmpy.read_model_description(str(path))
    folder = fmpy.extract(str(path))
    made = fmpy.instantiate_fmu(folder, description, fmi_type=kind, **more)
    return made, {v.name: v.valueReference for v in description.modelVariables}


def begin(fmu, three=True):
    """Initialize."""
    if three:
        fmu.enterInitializationMode(startTime=0.0)
    else:
        fmu.setupExperiment(startTime=0.0)
        fmu.enterInitializationMode()
    fmu.exitInitializationMode()


SIMULATE = """
import pickle, sys
import fmpy
with open(sys.argv[1], "rb") as file:
    path, options = pickle.load(file)
found = fmpy.simulate_fmu(path, **options)
with open(sys.argv[1], "wb") as file:
    pickle.dump(found, file)
"""


def simulated(path: str | Path, **options) -> np.ndarray:
    """What FMPy makes of an FMU, in a process of its own: two copies of SUNDIALS in one process can crash it."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "asked"
        place.write_bytes(pickle.dumps((str(path), options)))
        done = subprocess.run([sys.executable, "-c", SIMULATE, str(place)], capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, done.stderr
        return pickle.loads(place.read_bytes())


def beside_a_run(dae, path: str | Path, kind: str) -> tuple:
    """A tight run of a scene, and what FMPy makes of its FMU at the same times (CVode, or told nothing)."""
    run = dae.simulate(points=31, rtol=1e-9)
    found = simulated(
        path, fmi_type=kind, stop_time=run.time[-1], relative_tolerance=1e-8 if kind == "ModelExchange" else 1e-6,
        output_interval=run.time[1], output=list(dae.outputs), record_events=False,
    )  # fmt: skip
    return run, found[np.searchsorted(found["time"], run.time - 1e-9)]
