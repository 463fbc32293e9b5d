"""IFToMM's benchmark A02: N parallelograms of bars in a row, through ten singular positions in 10 s.

    python -m benchmarks.windows [--sizes 1,5,10,20,40,80] [--repeat 2]

`models/classic/windows.lmo` at rtol 1e-8: seconds of the processor to compile and for a warm run, of one thread, and
the error of the first crank's angle against the equation of the symmetric motion,
``((N + 1)/3 + N)·θ'' = -((N + 1)/2 + N)·g·cos θ``. The last column is what a window costs more than those of the size
before.
"""

from __future__ import annotations

import argparse
import os
import time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np  # noqa: E402

from benchmarks.common import ROOT, save, table  # noqa: E402

SIZES = "1,5,10,20,40,80"


def exact(n: int, times: np.ndarray) -> np.ndarray:
    """Angles of the cranks."""
    from scipy.integrate import solve_ivp

    ratio = ((n + 1) / 2 + n) / ((n + 1) / 3 + n) * 9.81
    slope = lambda t, z: [z[1], -ratio * np.cos(z[0])]  # noqa: E731
    done = solve_ivp(slope, (0, times[-1]), [np.pi / 2, -1], "DOP853", times, rtol=1e-13, atol=1e-13)
    return np.asarray(done.y[0])


def one_size(n: int, repeat: int) -> dict[str, float]:
    """What n windows cost, and how right they are."""
    import lmoc

    begin = time.process_time()
    dae = lmoc.compile(ROOT / "models/classic/windows.lmo", parameters={"N": n})
    compiled, spent, run = time.process_time() - begin, [], None
    for _ in range(repeat):
        begin = time.process_time()
        run = dae.simulate(rtol=1e-8)
        spent.append(time.process_time() - begin)
    error = float(np.abs(run["first.phi"] - exact(n, run.time)).max())
    return {"windows": n, "compile": compiled, "run": min(spent), "steps": run.stats["steps"], "error": error}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", default=SIZES, help="numbers of windows")
    parser.add_argument("--repeat", type=int, default=2, help="runs of each")
    arguments = parser.parse_args()
    import lmoc

    lmoc.compile(ROOT / "models/classic/windows.lmo")  # what Python imports is no window's
    figures = [one_size(int(n), arguments.repeat) for n in arguments.sizes.split(",")]
    before = {"windows": 0, "compile": 0.0, "run": 0.0}
    for own in figures:
        more = own["compile"] + own["run"] - before["compile"] - before["run"]
        own["a window"] = more / (own["windows"] - before["windows"])
        before = own
    table(
        "parallel windows, 10 s at rtol 1e-8: seconds of the processor",
        list(figures[0]),
        [list(f.values()) for f in figures],
    )
    save("windows", figures)


if __name__ == "__main__":
    main()
