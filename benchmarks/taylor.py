"""The Taylor integrator against DOP853: error and time over tolerances, on small smooth scenes.

    python -m benchmarks.taylor [--repeat 5]

Whole `simulate` calls, warm, alternating, the shortest of each; the error is the largest of all states at the output
times against DOP853 at 1e-14, in units of each state's largest value.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from benchmarks.common import ROOT, save, table

TOLERANCES = (1e-6, 1e-9, 1e-11, 1e-13)
PENDULUM = """
model Pendulum
  Real phi(start = 1.5, fixed = true), w(start = 0, fixed = true);
equation
  der(phi) = w; der(w) = -9.81*sin(phi);
  annotation(experiment(StopTime = 20));
end Pendulum;
"""


def scenes():
    import lmoc

    yield "pendulum", lmoc.compile_text(PENDULUM), {}
    yield "double pendulum", lmoc.compile(ROOT / "models/planar/double_pendulum.lmo"), {"stop": 5.0}
    yield "Pleiades", lmoc.compile(ROOT / "models/classic/pleiades.lmo"), {}
    yield "Andrews", lmoc.compile(ROOT / "models/classic/andrews.lmo"), {}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeat", type=int, default=5)
    arguments = parser.parse_args()
    rows = []
    for name, dae, options in scenes():
        options = {**options, "points": 21, "energy": False}
        reference = dae.simulate(rtol=1e-14, solver="dop853", **options)
        time.sleep(3)  # the compiler works beside the first run
        for rtol in TOLERANCES:
            spent, runs = {}, {}
            for _ in range(arguments.repeat):
                for solver in ("taylor", "dop853"):
                    begin = time.perf_counter()
                    runs[solver] = dae.simulate(rtol=rtol, solver=solver, **options)
                    spent[solver] = min(spent.get(solver, 1e9), time.perf_counter() - begin)
            for solver, run in runs.items():
                apart = [np.abs(run[s] - reference[s]).max() / np.abs(reference[s]).max() for s in dae.states]
                rows.append({"scene": name, "rtol": rtol, "solver": run.stats["solver"], "ms": spent[solver] * 1e3,
                             "error": float(max(apart)), "steps": run.stats["steps"],
                             "rejected": run.stats["rejected"]})  # fmt: skip
    table("Taylor series and DOP853", list(rows[0]), [list(r.values()) for r in rows])
    save("taylor", rows)


if __name__ == "__main__":
    main()
