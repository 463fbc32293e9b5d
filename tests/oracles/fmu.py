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


BY_CVODE = """
import pickle, sys
import casadi, numpy as np
from fmpy.sundials import CVodeSolver
with open(sys.argv[1], "rb") as file:
    ode, (start, inputs, values), nominal, times, rtol = pickle.load(file)
ode, n, now = casadi.Function.deserialize(ode), len(start), {"t": times[0], "x": start}
def put(to, values):
    np.ctypeslib.as_array(to, (n,))[:] = values
solver = CVodeSolver(
    nx=n, nz=0, input=None, startTime=times[0], maxStep=(times[-1] - times[0]) / 50, relativeTolerance=rtol,
    get_x=lambda to, n: put(to, now["x"]), set_x=lambda x, n: now.update(x=np.ctypeslib.as_array(x, (n,)).copy()),
    get_dx=lambda to, n: put(to, np.ravel(ode(now["t"], now["x"], inputs, values))), get_z=None,
    get_nominals=lambda to, n: put(to, nominal), set_time=lambda t: now.update(t=t),
)
found = [start]
for t, until in zip(times, times[1:]):
    solver.step(t, until)
    found.append(now["x"])
with open(sys.argv[1], "wb") as file:
    pickle.dump(np.array(found), file)
"""


def _apart(script: str, asked: tuple) -> np.ndarray:
    """What a script makes of what is asked, in a process of its own: two copies of SUNDIALS in one can crash it."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "asked"
        place.write_bytes(pickle.dumps(asked))
        done = subprocess.run([sys.executable, "-c", script, str(place)], capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, done.stderr
        return pickle.loads(place.read_bytes())


def simulated(path: str | Path, **options) -> np.ndarray:
    """What FMPy makes of an FMU."""
    return _apart(SIMULATE, (str(path), options))


def by_cvode(functions, start: list[float], nominal: list[float], times: np.ndarray, rtol: float) -> np.ndarray:
    """The states, (times, n), by FMPy's CVode on the functions of a scene, with the tolerances that it gives an FMU."""
    given = start, [0.0] * len(functions.inputs), functions.values
    return _apart(BY_CVODE, (functions.ode.serialize(), given, nominal, times, rtol))


def beside_a_run(dae, path: str | Path, kind: str) -> tuple:
    """A tight run of a scene, and what FMPy makes of its FMU at the same times (CVode, or told nothing)."""
    run = dae.simulate(points=31, rtol=1e-9)
    found = simulated(
        path, fmi_type=kind, stop_time=run.time[-1], relative_tolerance=1e-8 if kind == "ModelExchange" else 1e-6,
        output_interval=run.time[1], output=list(dae.outputs or dae.states), record_events=False,
    )  # fmt: skip
    return run, found[np.searchsorted(found["time"], run.time - 1e-9)]
