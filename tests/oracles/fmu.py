"""FMUs as FMPy runs them."""

from __future__ import annotations

import atexit
import pickle
import select
import subprocess
import sys
from pathlib import Path

import numpy as np

import lmoc


def exported(model: Path, target: Path, fmi: int) -> str:
    """Export a model; return why it is refused, nothing where it is not."""
    try:
        lmoc.compile(model).export(target, fmi=fmi)
    except lmoc.ModelError as error:
        return f"refused: {error.diagnostics[-1].message[:120]}"
    return ""


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


BEGIN = """
import os, pickle, sys, traceback
told = os.fdopen(os.dup(1), "wb")
os.dup2(2, 1)  # what an FMU prints is no answer
"""
SERVE = """
while True:
    try:
        asked = pickle.load(sys.stdin.buffer)
    except EOFError:
        break
    try:
        answer = True, answer_to(asked)
    except Exception:
        answer = False, traceback.format_exc()
    pickle.dump(answer, told)
    told.flush()
"""
SIMULATE = """
import fmpy
def answer_to(asked):
    path, options = asked
    return fmpy.simulate_fmu(path, **options)
"""
BY_CVODE = """
import casadi, numpy as np
from fmpy.sundials import CVodeSolver
def answer_to(asked):
    ode, (start, inputs, values), nominal, times, rtol = asked
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
    return np.array(found)
"""
_servers: dict[str, subprocess.Popen] = {}


def _end(server: subprocess.Popen) -> None:
    server.stdin.close()
    server.wait()


def _apart(script: str, asked: tuple) -> np.ndarray:
    """What a script makes of what is asked, in a process of its own: two copies of SUNDIALS in one can crash it.

    The process imports FMPy once, and answers until this one ends.
    """
    server = _servers.get(script)
    if server is None or server.poll() is not None:
        command = [sys.executable, "-c", BEGIN + script + SERVE]
        server = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        _servers[script] = server
        atexit.register(_end, server)
    pickle.dump(asked, server.stdin)
    server.stdin.flush()
    if not select.select([server.stdout], [], [], 300)[0]:
        server.kill()
    try:
        good, found = pickle.load(server.stdout)
    except EOFError:
        good, found = False, f"the process of FMPy has ended: {server.wait()}"
    assert good, found
    return found


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
