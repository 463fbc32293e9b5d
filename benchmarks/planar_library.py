"""Examples of PlanarMechanics beside equations of motion written by hand: the library has no reference results.

    python -m benchmarks.planar_library MODELICA PLANAR

MODELICA and PLANAR are the folders of Modelica's library and of PlanarMechanics as they are published; neither is part
of this project. The equations below are Newton's and Lagrange's, integrated by SciPy's DOP853 at 1e-12; a difference is
the largest over the run, as a share of the variable's range, for a run of lmoc at 1e-10.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.common import save, table

G = 9.81
_RTOL, _TRUTH = 1e-10, 1e-12


@dataclass(frozen=True)
class Case:
    """An example, ``(t, positions, speeds) -> accelerations``, its start, and the names of the positions."""

    name: str
    accelerations: Callable[[float, np.ndarray, np.ndarray], np.ndarray | list[float]]
    start: tuple[float, ...]
    variables: tuple[str, ...]
    stop: float
    break_at: float | None = None  # where the force has a kink: the integration begins anew


def _pendulum(t: float, q: np.ndarray, v: np.ndarray) -> list[float]:
    return [-G * np.cos(q[0]) / 1.1]  # m = 1, l = 1, J = 0.1


def _excited(t: float, q: np.ndarray, v: np.ndarray) -> list[float]:
    force = -5 * np.sin(2 * np.pi * (t - 1.8)) if t > 1.8 else 0.0  # across the rod, at its end
    return [(force - G * np.cos(q[0])) / 1.1]


def _double_pendulum(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    m1, m2, l1, l2, j1, j2 = 1.0, 0.2, 1.0, 0.4, 0.1, 0.01
    a, b = q[0], q[0] + q[1]  # from the angles at the joints to those of the rods
    va, vb = v[0], v[0] + v[1]
    coupling = m2 * l1 * l2
    mass = [[j1 + (m1 + m2) * l1**2, coupling * np.cos(a - b)], [coupling * np.cos(a - b), j2 + m2 * l2**2]]
    force = [
        -coupling * np.sin(a - b) * vb**2 - (m1 + m2) * G * l1 * np.cos(a),
        coupling * np.sin(a - b) * va**2 - m2 * G * l2 * np.cos(b),
    ]
    first, second = np.linalg.solve(mass, force)
    return np.array([first, second - first])


def _crane(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    cart, load, inertia, d = 1.0, 0.5, 0.1, 10.0  # l = 1
    c, s = np.cos(q[1]), np.sin(q[1])
    mass = [[cart + load, load * c], [load * c, inertia + load]]
    return np.linalg.solve(mass, [load * s * v[1] ** 2 - d * v[0], -load * G * s])


def _spring(t: float, q: np.ndarray, v: np.ndarray) -> list[float]:
    m, c, d = 0.5, 10.0, 1.0
    return [-G - c / m * (q[0] + 0.5) - d / m * v[0]]


CASES = (
    Case("FreeBody", lambda t, q, v: [-G], (0.0,), ("body.r[2]",), 3),
    Case("Pendulum", _pendulum, (0.0,), ("revolute.phi",), 3),
    Case("PendulumExcited", _excited, (0.0,), ("revolute.phi",), 3, 1.8),
    Case("DoublePendulum", _double_pendulum, (0.0, 0.0), ("revolute.phi", "revolute1.phi"), 3),
    Case("CraneCrab", _crane, (0.0, 2.6179938779915), ("prismatic.s", "revolute.phi"), 10),
    Case("SpringDemo", _spring, (0.2,), ("prismatic.s",), 5),
)


def by_hand(case: Case, times: np.ndarray) -> np.ndarray:
    """Return the positions of the equations written by hand (positions, times)."""
    n, parts = len(case.start), []
    x, begin = np.concatenate([case.start, np.zeros(n)]), 0.0
    for end in (case.break_at, case.stop):
        if end is None:
            continue
        inside = times[(times > begin) & (times <= end)] if parts else times[times <= end]
        found = solve_ivp(
            lambda t, x: [*x[n:], *case.accelerations(t, x[:n], x[n:])],
            (begin, end), x, method="DOP853", t_eval=np.unique([*inside, end]), rtol=_TRUTH, atol=_TRUTH,
        )  # fmt: skip
        parts.append(found.y[:n, : len(inside)])
        x, begin = found.y[:, -1], end
    return np.concatenate(parts, axis=1)


def difference(case: Case, path: list[str]) -> float:
    """Return the largest difference of an example's positions from those by hand, as a share of their range."""
    import lmoc

    dae = lmoc.compile(f"PlanarMechanics.Examples.{case.name}", path=path)
    run = dae.simulate(stop=case.stop, points=301, rtol=_RTOL, atol=_RTOL)
    times, at = np.unique(run.time, return_index=True)
    truth = by_hand(case, times)
    own = [np.asarray(run[name])[at] for name in case.variables]
    return max(float(np.abs(y - x).max() / np.ptp(x)) for x, y in zip(truth, own, strict=True))


def main() -> None:
    """Print the differences of all six."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("modelica")
    parser.add_argument("planar")
    arguments = parser.parse_args()
    rows = [[case.name, case.stop, difference(case, [arguments.modelica, arguments.planar])] for case in CASES]
    table("PlanarMechanics beside equations by hand", ("example", "until s", "difference"), rows)
    save("planar_library", [dict(zip(("name", "stop", "difference"), row)) for row in rows])


if __name__ == "__main__":
    main()
