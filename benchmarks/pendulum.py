"""The pendulum over 2000 s, in an angle and in x and y: error and CPU time over tolerances.

    python -m benchmarks.pendulum [--repeat 5]

Released horizontally; the error is that of x over all output times, by elliptic functions. Whole `simulate` calls with
501 output times, warm, alternating, the shortest of each. The ratio is that of the fastest run in x and y with an error
of 1e-6 to the fastest one in the angle with 1e-8.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from benchmarks.common import ROOT, save, table

STOP = 2000.0
TOLERANCES = (1e-8, 3e-9, 1e-9, 1e-10, 1e-11, 1e-12)
ANGLE = """
model Pendulum
  Real phi(start = asin(1), fixed = true), w(start = 0, fixed = true);
  output Real x = sin(phi), y = -cos(phi);
equation
  der(phi) = w; der(w) = -9.81*sin(phi);
end Pendulum;
"""


def exact(times: np.ndarray) -> np.ndarray:
    """Return x: sin(phi/2) = k·sn(K − ω·t, k), k² = 1/2."""
    from scipy.special import ellipj, ellipk

    period = 4 * ellipk(0.5)
    half = np.sqrt(0.5) * ellipj((period / 4 - np.sqrt(9.81) * times) % period, 0.5)[0]
    return 2 * half * np.sqrt(1 - half**2)


def main() -> None:
    import lmoc

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeat", type=int, default=5)
    arguments = parser.parse_args()
    scenes = {
        "angle": lmoc.compile_text(ANGLE),
        "x and y": lmoc.compile(ROOT / "models/planar/pendulum_cartesian.lmo"),
    }
    rows, ratios = [], {}
    for solver in ("auto", "taylor", "dop853"):
        settings = [(name, rtol) for name in scenes for rtol in TOLERANCES]
        spent, runs = dict.fromkeys(settings, np.inf), {}
        for _ in range(arguments.repeat + 1):  # the first one warms up
            for name, rtol in settings:
                begin = time.process_time()
                run = scenes[name].simulate(stop=STOP, rtol=rtol, solver=solver)
                seconds = time.process_time() - begin
                if (name, rtol) in runs:
                    spent[name, rtol] = min(spent[name, rtol], seconds)
                runs[name, rtol] = run
        errors = {key: float(np.abs(run["x"] - exact(run.time)).max()) for key, run in runs.items()}
        for name, rtol in settings:
            run = runs[name, rtol]
            length = float(np.abs(np.hypot(run["x"], run["y"]) - 1).max())
            cells = [f"{errors[name, rtol]:.0e}", f"{1e3 * spent[name, rtol]:.0f} ms", str(run.stats["steps"])]
            rows.append([solver, name, f"{rtol:g}", *cells, f"{length:.0e}"])
        least = [
            min((spent[k] for k in settings if k[0] == name and errors[k] <= most), default=np.nan)
            for name, most in (("x and y", 1e-6), ("angle", 1e-8))
        ]
        ratios[solver] = least[0] / least[1]
    table(f"pendulum, {STOP:g} s", ["solver", "written in", "rtol", "error", "CPU time", "steps", "length"], rows)
    for solver, ratio in ratios.items():
        print(f"{solver}: 1e-6 in x and y takes {ratio:.2g} times as long as 1e-8 in the angle")
    save("pendulum", {"rows": rows, "ratios": ratios})


if __name__ == "__main__":
    main()
