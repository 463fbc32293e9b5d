"""FMUs of models against `simulate`, by FMPy: Model Exchange with CVode, Co-Simulation with few and many steps.

    python benchmarks/fmi.py [--parameters] [--fmi 3] [FILE …]

For each model (those of notes, hard, laws and planar by default) and version of FMI: what `validate_fmu` says, the
largest difference from `DAE.simulate` over states and outputs, as a multiple of the tolerance of the size of each, and
how many events of laws, relations and `when`, of those of `simulate`, come in the same order. Where CVode leaves more
than 100 in Model Exchange, the same equations by CVode without an FMU, with the same tolerances, stand beside it: those
of `dae.functions`, of `simulate`, or written by hand; and the first of the finer tolerances of CVode with which the FMU
holds, if there is one.
With `--parameters` instead, for each parameter that can be set, the difference where it is larger by 30 %.
"""

from __future__ import annotations

import argparse
import pickle
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

import numpy as np

import lmoc

Way = tuple[str, int, float]  # kind, outputs, relative tolerance
RTOL = 1e-6
MOST = 100
WAYS = ("ModelExchange", 500, RTOL / 100), ("CoSimulation", 10, RTOL), ("CoSimulation", 1000, RTOL)
# FMPy allows CVode 500 steps from output to output
FINER = ("ModelExchange", 500, 1e-9), ("ModelExchange", 500, 1e-10), ("ModelExchange", 20_000, 1e-11)
ROOT = Path(__file__).parents[1]
FMPY = """
import pickle, sys, fmpy
with open(sys.argv[1], "rb") as file:
    path, jobs = pickle.load(file)
from fmpy.validation import validate_fmu
said, found = validate_fmu(path), []
for job in jobs:
    lines = []
    try:
        result = fmpy.simulate_fmu(path, debug_logging=True, logger=lambda *a: lines.append(a[-1].decode()), **job)
    except Exception as error:
        result = f"{type(error).__name__}: {error}"
    found.append((result, lines))
with open(sys.argv[1], "wb") as file:
    pickle.dump((said, found), file)
"""
# by hand, behind FMPy's own loop over events: equations, functions whose roots are events, what happens there
BY_HAND = {
    "h17_backlash": ("""
def rates(t, x):
    s = x[0] - 2*x[2]
    tm = 2000*(s - 0.01) if s > 0.01 else 2000*(s + 0.01) if s < -0.01 else 0.0
    return [x[1], 2*np.sin(6*t) - tm, x[3], (2*tm - 0.2*x[3])/2]
def roots(t, x):
    return [x[0] - 2*x[2] - 0.01, x[0] - 2*x[2] + 0.01]
def happens(t, x):
    return x
""", {"first.theta": 0.0, "first.omega": 0.0, "second.theta": 0.0, "second.omega": 0.0}),
}  # fmt: skip
BY_CVODE = """
import pickle, sys
import numpy as np
from fmpy.sundials import CVodeSolver
with open(sys.argv[1], "rb") as file:
    text, start, nominal, times, rtol = pickle.load(file)
exec(text)
n, now = len(start), {"t": times[0], "x": np.array(start)}
m = len(roots(times[0], now["x"]))
def put(to, values):
    np.ctypeslib.as_array(to, (len(values),))[:] = values
class Signals:
    apply = staticmethod(lambda t: None)
solver = CVodeSolver(
    nx=n, nz=m, input=Signals, startTime=times[0], maxStep=(times[-1] - times[0]) / 50, relativeTolerance=rtol,
    get_x=lambda to, n: put(to, now["x"]), set_x=lambda x, n: now.update(x=np.ctypeslib.as_array(x, (n,)).copy()),
    get_dx=lambda to, n: put(to, rates(now["t"], now["x"])),
    get_z=lambda to, n: m and put(to, roots(now["t"], now["x"])),
    get_nominals=lambda to, n: put(to, nominal), set_time=lambda t: now.update(t=t),
)
found, t = [now["x"]], times[0]
for until in times[1:]:
    while t < until - 1e-12:
        event, _, t = solver.step(t, until)
        if event:
            now["x"] = np.array(happens(t, now["x"]))
            solver.reset(t)
    found.append(now["x"])
with open(sys.argv[1], "wb") as file:
    pickle.dump(np.array(found), file)
"""


def _apart(script: str, asked: tuple):
    """Return what a script makes of what is asked, in a process of its own: two SUNDIALS in one can crash it."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "asked"
        place.write_bytes(pickle.dumps(asked))
        done = subprocess.run([sys.executable, "-c", script, str(place)], capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError(done.stderr.strip()[-300:])
        return pickle.loads(place.read_bytes())


def difference(run, result, names: Iterable[str]) -> float:
    """Largest difference over some variables, in units of RTOL times the largest magnitude of each."""
    worst = 0.0
    for name in names:
        expected, found = np.asarray(run[name]), result[name]
        size = max(float(np.abs(expected).max()), 1e-3)
        worst = max(worst, float(np.abs(np.interp(run.time, result["time"], found) - expected).max()) / size / RTOL)
    return worst


def _in_order(own: list, told: list) -> str:
    same = next((k for k, (a, b) in enumerate(zip(own, told, strict=False)) if a != b), min(len(own), len(told)))
    return f"{same} of {len(own)}" if len(own) == len(told) else f"{same} of {len(own)} against {len(told)}"


def events_of(dae, run, lines: list[str]) -> str:
    """Return how many events come in the same order, of how many: those of laws, and of relations that are told of."""
    form, said = dae.reduced.switched, []
    kinds = {"impact", "accumulation"} | {k for g in (form.laws if form else ()) for k in (g.closing, g.opening)}
    own = [(e.name, e.kind) for e in run.events if e.kind in kinds]
    told = [m.groups() for line in lines if (m := re.match(r"t = \S+ s: (.*): (.*), impulse", line))]
    if own or told:
        said.append(f"{_in_order(own, told)} events")
    truth = {"true": "1", "false": "0"}
    changed = [m.groups() for line in lines if (m := re.match(r"t = \S+ s: (.*): relation, now (.*)", line))]
    relations = [(e.name, truth[e.after]) for e in run.events if e.kind == "relation" and e.after in truth]
    whens = [(e.after, "1") for e in run.events if e.kind == "when"]
    for own, word in (relations, "relations"), (whens, "of when"):
        names = {name for name, _ in own}
        told = [(name, value) for name, value in changed if name in names and (own is relations or value == "1")]
        if own:
            said.append(f"{_in_order(own, told)} {word}")
    return f" ({'; '.join(said)})" if said else ""


def compare(path: str | Path, fmi: int) -> tuple[list[str], dict[Way, tuple[float | str, str]]]:
    """Return what validation says, and {way: (difference in units of RTOL or what failed, events)}.

    Where Model Exchange does not hold, it is among the ways once more, with the first finer tolerance that does, or the
    last one.
    """
    dae = lmoc.compile(path)
    with tempfile.TemporaryDirectory() as folder:
        target = str(Path(folder) / "scene.fmu")
        inputs = dae.export(target, fmi=fmi).zero_inputs
        said, found = _compared(dae, target, inputs, WAYS)
        finer: dict[Way, tuple[float | str, str]] = {}
        for way in () if holds(found[WAYS[0]][0]) else FINER:
            _, finer = _compared(dae, target, inputs, (way,))
            if holds(finer[way][0]):
                break
    return said, found | finer


def _compared(dae, target: str, inputs, ways: tuple[Way, ...]) -> tuple[list[str], dict[Way, tuple[float | str, str]]]:
    experiment = dae.simulate(points=2, inputs=inputs)
    start, stop = float(experiment.time[0]), float(experiment.time[-1])
    names = [n for n in (*dae.states, *dae.outputs) if n in dae.variables]
    jobs = [
        {"fmi_type": kind, "start_time": start, "stop_time": stop, "output_interval": (stop - start) / steps,
         "relative_tolerance": rtol, "output": names}
        for kind, steps, rtol in ways
    ]  # fmt: skip
    said, results = _apart(FMPY, (target, jobs))
    found: dict[Way, tuple[float | str, str]] = {}
    for way, (result, lines) in zip(ways, results, strict=True):
        if isinstance(result, str):
            found[way] = f"{result} {lines[-1:]}", ""
            continue
        times = np.linspace(start, stop, way[1] + 1)
        run = dae.simulate(times=times, rtol=RTOL / 100, inputs=inputs)
        keep = np.searchsorted(result["time"], times - 1e-9 * (stop - start))
        off = difference(run, result[np.minimum(keep, len(result) - 1)], names)
        found[way] = off, events_of(dae, run, lines)
    return said, found


def holds(value: float | str) -> bool:
    """Return whether a run has come to its end, and near enough to that of `simulate`."""
    return not isinstance(value, str) and value <= MOST


def by_cvode(path: Path) -> str:
    """Return how far CVode is off without an FMU, with the tolerances that FMPy gives it, and on which equations."""
    dae = lmoc.compile(path)
    end = float(dae.simulate(points=2).time[-1])
    times = np.linspace(0.0, end, 501)
    run = dae.simulate(times=times, rtol=RTOL / 100)
    sizes = {name: float(np.abs(run[name]).max()) or 1.0 for name in dae.states}
    smooth = not (dae.reduced.switched or dae.flat.events) and path.stem not in BY_HAND
    if path.stem in BY_HAND:
        text, begin = BY_HAND[path.stem]
        found = _apart(BY_CVODE, (text, list(begin.values()), [sizes[n] for n in begin], times, RTOL / 100))
        result = {"time": times} | dict(zip(begin, found.T, strict=True))
        return f"{difference(run, result, begin):.4g} by hand"
    if smooth and len(run.trajectory.segments) == 1:
        functions = dae.functions
        text = (
            f"import casadi\node = casadi.Function.deserialize({functions.ode.serialize()!r})\n"
            f"values, inputs = {list(map(float, functions.values))!r}, {[0.0] * len(functions.inputs)!r}\n"
            "def rates(t, x): return np.ravel(ode(t, x, inputs, values))\n"
            "def roots(t, x): return []\n"
        )
        states = list(functions.states)
        begin = [float(run[n][0]) for n in states]
        try:
            found = _apart(BY_CVODE, (text, begin, [sizes[n] for n in states], times, RTOL / 100))
        except RuntimeError as error:
            return f"dae.functions: {str(error).splitlines()[-1]}"
        return f"{difference(run, {'time': times} | dict(zip(states, found.T, strict=True)), states):.4g} dae.functions"
    least = RTOL / 100 * min(sizes.values())
    other = dae.simulate(times=times, rtol=RTOL / 100, atol=least, solver="cvode")
    result = {"time": times} | {n: np.asarray(other[n]) for n in (*dae.states, *dae.outputs)}
    return f"{difference(run, result, [n for n in result if n != 'time']):.4g} simulate, cvode, atol {least:.2g}"


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


def tell(path: Path, fmi: int) -> None:
    """Print one row of the table."""
    said, found = compare(path, fmi)
    row = []
    for way, (value, events) in found.items():
        text = value if isinstance(value, str) else f"{value:.3g}"
        if way == WAYS[0] and not holds(value):
            text += f" [without an FMU: {by_cvode(path)}]"
        tolerance = f" at {way[2]:g}" if way in FINER else ""
        row.append(f"{way[0][0]}{way[1]}{tolerance}: {text}{events}")
    print(f"{path.stem:36} {fmi}: {'  '.join(row)}{'  ' + '; '.join(said)[:300] if said else ''}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--parameters", action="store_true", help="other values of parameters instead")
    parser.add_argument("--fmi", type=int, choices=(3, 2), help="one version only")
    given = parser.parse_args()
    every = [p for kind in ("laws", "planar", "hard", "notes") for p in sorted((ROOT / "models" / kind).glob("*.lmo"))]
    paths = given.files or every
    if given.parameters:
        return _tell_by_parameters(paths)
    for path in paths:
        for fmi in [given.fmi] if given.fmi else (3, 2):
            try:
                tell(path, fmi)
            except lmoc.ModelError as error:
                print(f"{path.stem:36} refused: {error.diagnostics[-1].message[:150]}", flush=True)
                break
            except Exception as error:
                print(f"{path.stem:36} {fmi}: FAILED {type(error).__name__}: {str(error)[:300]}", flush=True)


if __name__ == "__main__":
    main()
