"""Formulations of closed loops at equal error: what six digits cost in each, and how well the loops stay closed.

    python -m benchmarks.formulations [--digits 6] [--repeat 3]

Each formulation runs with its default solver at tolerances from 1e-3 to 1e-10. The table has the coarsest run that
reaches the digits: the shortest time of a whole warm `simulate` call, all formulations in turns in one process, and the
residual of positions. The reference is the reduced scene at 1e-12; the projected one should agree with it.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

import lmoc
from benchmarks.common import ROOT, save, table

FORMULATIONS = ("reduced", "projected", "index1", "baumgarte:10", "baumgarte:1000", "ggl")
_ROUNDING = 1e-6  # a signal that stays below is rounding and says nothing
RTOLS = tuple(10.0**-k for k in range(3, 11))
HANGING = """
model Hanging "six rods and five point masses between two walls, let go beside their rest"
  import Planar.*;
  parameter Integer n = 5;
  inner World world;
  Anchor left, right(x = 2.4);
  PointMass m[n](each m = 1, x(start = {0.5, 0.9, 1.2, 1.6, 2.0}), y(start = {-0.2, -0.6, -0.9, -0.6, -0.3}));
  Rod rod[n + 1](each L = 0.5);
equation
  connect(left.point, rod[1].a);
  for i in 1:n loop
    connect(rod[i].b, m[i].point);
    connect(m[i].point, rod[i + 1].a);
  end for;
  connect(rod[n + 1].b, right.point);
end Hanging;
"""
SCENES = {
    "pendulum in x and y, 10 s": ("models/planar/pendulum_cartesian.lmo", {"stop": 10.0}),
    "four-bar, 2 s": ("models/planar/four_bar.lmo", {"stop": 2.0}),
    "Andrews' mechanism": ("models/classic/andrews.lmo", {}),
    "hanging chain of six rods, 2 s": (HANGING, {"stop": 2.0}),
}


def compiled(source: str) -> lmoc.DAE:
    return lmoc.compile_text(source) if source.startswith("\n") else lmoc.compile(ROOT / source)


def measured(dae: lmoc.DAE, digits: float, repeat: int, **options) -> list[dict[str, object]]:
    """What the runs of one scene have given, one row a formulation."""
    reference = dae.simulate(rtol=1e-12, **options)
    names = [n for n in reference.outputs or reference.states if np.abs(reference[n]).max() > _ROUNDING]
    expected = np.stack([reference[n] for n in names])
    size = np.abs(expected).max(axis=1, keepdims=True)

    def error(run: lmoc.Run) -> float:
        return float((np.abs(np.stack([run[n] for n in names]) - expected) / size).max())

    agreement = error(dae.simulate(rtol=1e-12, formulation="projected", **options))
    rows: dict[str, dict[str, object]] = {}
    for formulation in FORMULATIONS:
        rows[formulation] = {"formulation": formulation, "seconds": np.inf, "reference": agreement}
        for rtol in RTOLS:
            row = _run(dae, formulation, rtol, error, options)
            if row is not None and row["error"] < 10.0**-digits:
                rows[formulation] |= row
                break
    for _ in range(repeat):
        for row in rows.values():
            if "rtol" in row:
                began = time.thread_time()
                dae.simulate(rtol=row["rtol"], formulation=row["formulation"], **options)
                row["seconds"] = min(row["seconds"], time.thread_time() - began)
    return list(rows.values())


def _run(dae: lmoc.DAE, formulation: str, rtol: float, error, options) -> dict[str, object] | None:
    try:
        run = dae.simulate(rtol=rtol, formulation=formulation, **options)
    except lmoc.SimulationError:
        return None
    return {"rtol": rtol, "error": error(run), "evaluations": run.stats["evaluations"], "position": run.residual[0]}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--digits", type=float, default=6.0)
    parser.add_argument("--repeat", type=int, default=3)
    arguments = parser.parse_args()
    found = {}
    for scene, (source, options) in SCENES.items():
        rows = found[scene] = measured(compiled(source), arguments.digits, arguments.repeat, **options)
        title = f"{scene}: {arguments.digits:g} digits; the two references agree to {rows[0]['reference']:.0e}"
        table(title, ("formulation", "rtol", "error", "evaluations", "ms", "residual"), [_line(row) for row in rows])
    save("formulations", found)


def _line(row: dict[str, object]) -> tuple[str, ...]:
    if "rtol" not in row:
        return str(row["formulation"]), "–", "–", "–", "–", "–"
    seconds = f"{1e3 * row['seconds']:.1f}"
    error, position = f"{row['error']:.0e}", f"{row['position']:.0e}"
    return str(row["formulation"]), f"{row['rtol']:.0e}", error, str(row["evaluations"]), seconds, position


if __name__ == "__main__":
    main()
