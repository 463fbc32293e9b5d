"""FMUs of random scenes beside `simulate`: ``python tests/many_exchanges.py [FIRST] [COUNT]``; 30 by default.

The scenes are those of ``many_laws.py``: masses, gears, strings, stops, play, ratchets and friction. A third has an
input beside, another third a force that a relation switches and a counter in a `when`. FMI 3.0 and 2.0 in turns, Model
Exchange by FMPy's CVode at 1e-8 and Co-Simulation at 1e-6: the events of laws have to be the same in the same order,
and states and outputs near those of a run (1e-4 and 1e-5 of their sizes; what is chaotic may be further off).
"""

from __future__ import annotations

import re
import sys
import tempfile
from pathlib import Path

import numpy as np

import lmoc

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1])]
WAYS = ("ModelExchange", 1e-8, 1e-4), ("CoSimulation", 1e-6, 1e-5)


def scene(seed: int) -> tuple[str, dict[str, float]]:
    """A text, and what its inputs are."""
    from oracles.random_laws import draw

    drawn = draw(seed)
    q, v, _ = drawn.bodies[0]
    turns = "theta" in q
    load, port, value = ("Torque", "shaft", "tau") if turns else ("Force", "flange", "f")
    join = f"  connect(own.{port}, {q.split('.')[0]}.{port});\n"
    parts = {
        0: ("", ""),
        1: (f"  input Real u;\n  {load} own({value} = u);\n", join),
        2: (
            f"  output Integer n(start = 0, fixed = true);\n  Boolean on = {v} > 0.3;\n"
            f"  {load} own({value} = if on then 1 else -0.5);\n",
            f"{join}  when {q} > 0.1 then n = pre(n) + 1; end when;\n",
        ),
    }
    more, equations = parts[seed % 3]
    text = drawn.text.replace("equation\n", f"{more}equation\n{equations}", 1)
    text = text.replace("end Random;", "  annotation(experiment(StopTime = 2));\nend Random;")
    return text, {"u": 1.5} if seed % 3 == 1 else {}


def checked(seed: int) -> str:
    """What is to be said of one scene, with WRONG in it where something is."""
    from benchmarks.fmi import FMPY, _apart

    text, inputs = scene(seed)
    dae = lmoc.compile_text(text)
    names = [n for n in (*dae.states, *dae.outputs) if n in dae.variables]
    times = np.linspace(0, 2, 21)
    with tempfile.TemporaryDirectory() as folder:
        path = str(dae.export(Path(folder) / "scene.fmu", fmi=3 if seed % 2 else 2).path)
        jobs = [
            {"fmi_type": kind, "start_time": 0.0, "stop_time": 2.0, "output_interval": 0.1, "relative_tolerance": rtol,
             "output": names, "start_values": inputs, "record_events": False}
            for kind, rtol, _ in WAYS
        ]  # fmt: skip
        said, results = _apart(FMPY, (path, jobs))
    run = dae.simulate(times=times, rtol=1e-10, inputs={name: lambda _, u=u: u for name, u in inputs.items()})
    form = dae.reduced.switched
    kinds = {"impact", "accumulation"} | {k for g in (form.laws if form else ()) for k in (g.closing, g.opening)}
    expected = [(e.name, e.kind) for e in run.events if e.kind in kinds]
    told = [f"WRONG {said}"] if said else []
    for (kind, _, within), (result, lines) in zip(WAYS, results, strict=True):
        if isinstance(result, str):
            told.append(f"WRONG {kind}: {result[:150]} {lines[-1:]}")
            continue
        own = [m.groups() for line in lines if (m := re.match(r"t = \S+ s: (.*): (.*), impulse", line))]
        off = 0.0
        for name in names:
            right = np.asarray(run[name], float)
            found = np.interp(times, result["time"], result[name])
            off = max(off, np.abs(found - right).max() / max(np.abs(right).max(), 1e-3))
        wrong = "" if own == expected and off < within else "WRONG "
        told.append(f"{wrong}{kind}: {off:.1e}, {len(own)} of {len(expected)} events")
    return "; ".join(told)


def main() -> int:
    numbers = [int(argument) for argument in sys.argv[1:]]
    first, count = (*numbers, *(0, 30)[len(numbers) :])
    wrong = 0
    for seed in range(first, first + count):
        try:
            said = checked(seed)
        except lmoc.ModelError as error:
            said = f"refused: {error.diagnostics[-1].message[:120]}"
        except Exception as error:
            said = f"WRONG {type(error).__name__}: {str(error)[:200]}"
        wrong += "WRONG" in said
        print(f"{seed}: {said}", flush=True)
    print(f"{wrong} wrong")
    return min(wrong, 99)


if __name__ == "__main__":
    sys.exit(main())
