"""Mechanisms against equations written by hand, and chains of bars: what a run and an evaluation cost.

    python -m benchmarks.mechanisms [--repeat 7] [--bars 2 5 10 100]

Andrews' squeezer and the car axis: whole `simulate` calls, warm, against the index-1 equations by hand as a casadi
function under SciPy's DOP853 at the same tolerance in the same process, calls alternating, the shortest of each. Once
with a C compiler, once without (a process of its own). Chains: microseconds an evaluation, beside those of pinocchio's
aba (5.7 and 43 µs at 10 and 100 bars on the machine where that was measured).
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time

import numpy as np

from benchmarks.common import ROOT, buffered, native, save, table

TOLERANCES = (1e-8, 1e-10)


def by_hand(make, rtol: float):
    """A function without arguments that integrates the hand-written equations."""
    from scipy.integrate import solve_ivp

    function, start, stop = make()
    rhs, times = buffered(function, len(start)), np.linspace(0, stop, 501)
    return lambda: solve_ivp(rhs, (0, stop), start, "DOP853", times, rtol=rtol, atol=rtol * 1e-3)


def ratios(repeat: int) -> list[dict[str, object]]:
    """Both mechanisms at both tolerances, in this process."""
    import lmoc
    from benchmarks import by_hand as equations

    rows = []
    for name, make, states in (("andrews", equations.andrews, {"beta": 0, "Theta": 1}),
                               ("car_axis", equations.car_axis, {"xl": 0, "yl": 1})):  # fmt: skip
        dae = lmoc.compile(ROOT / f"models/classic/{name}.lmo")
        for rtol in TOLERANCES:
            run = dae.simulate(rtol=rtol, points=501)
            other = by_hand(make, rtol)
            solution = other()
            ours, theirs = [], []
            for _ in range(repeat):
                for call, kept in ((lambda: dae.simulate(rtol=rtol, points=501), ours), (other, theirs)):  # noqa: B023
                    begin = time.perf_counter()
                    call()
                    kept.append(time.perf_counter() - begin)
            apart = max(float(np.abs(run[s] - solution.y[k]).max()) for s, k in states.items())
            rows.append({"scene": name, "rtol": rtol, "evaluation": run.stats["evaluation"], "seconds": min(ours),
                         "by hand": min(theirs), "ratio": min(ours) / min(theirs), "apart": apart,
                         "evaluations": run.stats["evaluations"], "theirs": solution.nfev})  # fmt: skip
    return rows


def without_compiler(repeat: int) -> list[dict[str, object]]:
    command = [sys.executable, "-m", "benchmarks.mechanisms", "--inner", "--repeat", str(repeat)]
    done = subprocess.run(command, env={**os.environ, "LMOC_CC": ""}, capture_output=True, text=True, cwd=ROOT)
    if done.returncode:
        raise RuntimeError(done.stderr)
    return json.loads(done.stdout.strip().splitlines()[-1])


def chain(n: int, repeat: int) -> dict[str, object]:
    """A chain of n bars: seconds to compile, and microseconds an evaluation through the system's own call."""
    import lmoc

    begin = time.perf_counter()
    dae = lmoc.compile(ROOT / "models/planar/chain.lmo", parameters={"n": n})
    compiled = time.perf_counter() - begin
    system, code = native(dae)
    x, out = np.random.default_rng(1).uniform(-1, 1, system.n), np.empty(system.n)
    system.rhs(0.0, x, out)
    best = np.inf
    for _ in range(repeat):
        begin = time.perf_counter()
        for _ in range(200):
            system.rhs(0.0, x, out)
        best = min(best, (time.perf_counter() - begin) / 200)
    return {"bars": n, "states": system.n, "compile s": compiled, "C s": code, "us": best * 1e6}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeat", type=int, default=7)
    parser.add_argument("--bars", type=int, nargs="*", default=[2, 5, 10, 100])
    parser.add_argument("--inner", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    rows = ratios(arguments.repeat)
    if arguments.inner:
        print(json.dumps(rows))
        return
    rows += without_compiler(arguments.repeat)
    chains = [chain(n, arguments.repeat) for n in arguments.bars]
    table("Whole runs against equations by hand (seconds)", list(rows[0]), [list(r.values()) for r in rows])
    table("Chains of bars", list(chains[0]), [list(c.values()) for c in chains])
    save("mechanisms", {"runs": rows, "chains": chains})


if __name__ == "__main__":
    main()
