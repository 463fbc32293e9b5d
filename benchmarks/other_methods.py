"""Whether methods that lmoc does not have would earn a place: stabilized Runge–Kutta, and extrapolation.

    python -m benchmarks.other_methods

RKC (Sommeijer, Shampine, Verwer, RKC: an explicit solver for parabolic PDEs, JCAM 88, 1998) on the scenes that are
stiff by modes that decay, against BDF; ODEX (the extrapolated midpoint rule: Hairer, Nørsett, Wanner I, II.9) on smooth
scenes, against DOP853 and the Taylor series. Both are written here in the plainest way, so that evaluations are counted
and not times: an evaluation takes the same for all.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from benchmarks.common import ROOT, save, table

STIFF = ("failures/creep", "failures/relaxation", "hard/h28_prothero_robinson")
SMOOTH = ("notes/ex05_suspension", "planar/double_pendulum", "classic/pleiades", "classic/slider_crank")
TOLERANCES = tuple(10.0**-k for k in range(3, 11))
MOST = 30_000  # evaluations after which a run is given up
HEAD = ("scene", "error", "method", "evaluations", "instead", "its evaluations")

SECTION = """\
## Methods that lmoc does not have

Evaluations at equal error at the end of a run. Stabilized Runge–Kutta methods are made for mild stiffness by modes that
decay. But the modes that decay in mechanical scenes are those of massless points on dampers and of smoothed friction,
far from the pace of the motion: RKC takes {least_RKC:.0f} to {most_RKC:.0f} times the evaluations of BDF (a dash is
more than {most}). Extrapolation (ODEX) takes {least_ODEX:.1f} to {most_ODEX:.1f} times those of DOP853 where
both reach the error, and where more digits are asked for there is the Taylor series. So neither has a place.

{table}

`python -m benchmarks.other_methods` counts them.
"""

Rhs = Callable[[float, np.ndarray], np.ndarray]
Run = Callable[["Scene", float], np.ndarray]


class TooManyEvaluations(Exception):
    """A run takes more than `MOST`."""


class Scene:
    """The equations of a scene as lmoc's integrators get them, evaluations counted, and the exact state at the end."""

    def __init__(self, name: str) -> None:
        import lmoc

        self.name, self.dae = name.split("/")[1], lmoc.compile(ROOT / "models" / f"{name}.lmo")
        self.problem = problem_of(self.dae)
        self.exact = self.end(self.dae.simulate(points=2, energy=False, rtol=1e-12))
        self.evaluations = 0

    def end(self, run) -> np.ndarray:
        return np.array([run[name][-1] for name in self.dae.states])

    def rhs(self, t: float, x: np.ndarray) -> np.ndarray:
        self.evaluations += 1
        if self.evaluations > MOST:
            raise TooManyEvaluations
        out = np.empty(len(x))
        self.problem.system.rhs(t, x, out)
        return out

    def radius(self, t: float, x: np.ndarray) -> float:
        """Spectral radius of the Jacobian, not counted."""
        return float(np.abs(np.linalg.eigvals(self.problem.system.jacobian(t, x))).max())

    def error(self, x: np.ndarray) -> float:
        return float((np.abs(x - self.exact) / np.maximum(np.abs(self.exact), 1e-3)).max())

    def tolerances(self, rtol: float, x: np.ndarray) -> np.ndarray:
        return rtol * (np.abs(x) + 1e-3)


def problem_of(dae):
    """The initial value problem that a run hands to its integrator."""
    from lmoc.numerics.steps import choice

    seen, integrate = [], choice.integrate

    def keep(problem, name):
        seen.append(problem)
        return integrate(problem, name)

    choice.integrate = keep
    try:
        dae.simulate(points=2, energy=False)
    finally:
        choice.integrate = integrate
    return seen[0]


def rkc(scene: Scene, rtol: float) -> np.ndarray:
    """The state at the end by RKC of order 2, with as many stages as the spectral radius asks for."""
    problem = scene.problem
    t, x = problem.t, problem.x.copy()
    f, h = scene.rhs(t, x), 1e-3 * (problem.end - problem.t)
    while t < problem.end:
        h = min(h, problem.end - t)
        stages = max(2, 1 + math.isqrt(1 + int(1.54 * h * scene.radius(t, x))))
        new = _chebyshev(scene.rhs, t, x, f, h, stages)
        slope = scene.rhs(t + h, new)
        error = np.sqrt(np.mean(((0.8 * (x - new) + 0.4 * h * (f + slope)) / scene.tolerances(rtol, x)) ** 2))
        factor = min(5.0, max(0.1, 0.8 * max(float(error), 1e-12) ** (-1 / 3))) if np.isfinite(error) else 0.1
        if error <= 1:
            t, x, f = t + h, new, slope
        h *= factor
    return x


def _chebyshev(rhs: Rhs, t: float, x: np.ndarray, f: np.ndarray, h: float, stages: int) -> np.ndarray:
    """One step of RKC."""
    w0 = 1 + 2 / (13 * stages**2)
    k = np.arange(stages + 1)
    value = np.polynomial.chebyshev.Chebyshev.basis
    polynomials = [value(int(j)) for j in k]
    first = np.array([p.deriv()(w0) for p in polynomials])
    second = np.array([p.deriv(2)(w0) for p in polynomials])
    t0 = np.array([p(w0) for p in polynomials])
    w1 = first[-1] / second[-1]
    b = np.ones(stages + 1)
    b[2:] = second[2:] / first[2:] ** 2
    b[:2] = b[2]
    c = w1 * second / np.where(first == 0, 1, first)
    c[0], c[1] = 0.0, c[2] / first[2] if stages > 1 else w1
    before, here = x, x + b[1] * w1 * h * f
    for j in range(2, stages + 1):
        mu, nu, slope = 2 * b[j] * w0 / b[j - 1], -b[j] / b[j - 2], 2 * b[j] * w1 / b[j - 1]
        gamma = -(1 - b[j - 1] * t0[j - 1]) * slope
        there = (1 - mu - nu) * x + mu * here + nu * before
        before, here = here, there + h * (slope * rhs(t + c[j - 1] * h, here) + gamma * f)
    return here


def odex(scene: Scene, rtol: float) -> np.ndarray:
    """The state at the end by extrapolation of the midpoint rule, of the order with the least work a step."""
    problem = scene.problem
    t, x, h = problem.t, problem.x.copy(), 1e-3 * (problem.end - problem.t)
    target = max(3, min(9, round(-0.6 * math.log10(rtol) + 1.5)))  # columns
    while t < problem.end:
        h = min(h, problem.end - t)
        f, table = scene.rhs(t, x), []
        for j in range(target):
            row = [_midpoint(scene.rhs, t, x, f, h, 2 * (j + 1))]
            for k in range(1, j + 1):
                row.append(row[k - 1] + (row[k - 1] - table[j - 1][k - 1]) / (((j + 1) / (j - k + 1)) ** 2 - 1))
            table.append(row)
        scale = scene.tolerances(rtol, np.maximum(np.abs(x), np.abs(table[-1][-1])))
        error = float(np.sqrt(np.mean(((table[-1][-1] - table[-1][-2]) / scale) ** 2)))
        if error <= 1:
            t, x = t + h, table[-1][-1]
        h *= min(4.0, max(0.1, 0.9 * max(error, 1e-12) ** (-1 / (2 * target - 1)))) if np.isfinite(error) else 0.1
    return x


def _midpoint(rhs: Rhs, t: float, x: np.ndarray, f: np.ndarray, h: float, steps: int) -> np.ndarray:
    """The explicit midpoint rule over so many steps."""
    h /= steps
    before, here = x, x + h * f
    for k in range(1, steps):
        before, here = here, before + 2 * h * rhs(t + k * h, here)
    return here


def curve(scene: Scene, run: Run) -> list[tuple[float, int]]:
    """Errors and evaluations over the tolerances."""
    found = []
    for rtol in TOLERANCES:
        scene.evaluations = 0
        try:
            x = run(scene, rtol)
        except TooManyEvaluations:
            break
        found.append((scene.error(x), scene.evaluations))
    return found


def of_lmoc(solver: str) -> Run:
    """A run by lmoc, with its evaluations."""

    def run(scene: Scene, rtol: float) -> np.ndarray:
        done = scene.dae.simulate(points=2, energy=False, rtol=rtol, solver=solver)
        scene.evaluations = int(done.stats["evaluations"])
        return scene.end(done)

    return run


def needed(points: list[tuple[float, int]], error: float) -> int | None:
    return min((count for reached, count in points if reached <= error), default=None)


def compare(names: tuple[str, ...], own: str, other: str, run: Run) -> Iterator[dict]:
    """Evaluations at equal error, one row a scene and error; None where no tolerance reaches it."""
    for name in names:
        scene = Scene(name)
        ours, theirs = curve(scene, of_lmoc(own)), curve(scene, run)
        for error in (1e-4, 1e-6, 1e-9):
            yield {"scene": scene.name, "error": error, "own": own, "ours": needed(ours, error), "other": other,
                   "theirs": needed(theirs, error)}  # fmt: skip


def measure() -> list[dict]:
    """Return all rows."""
    return [*compare(STIFF, "cvode", "RKC", rkc), *compare(SMOOTH, "dop853", "ODEX", odex)]


def page(rows: list[dict]) -> str:
    """Return the section of `docs/accuracy.md`."""
    ratios = {
        name: [r["theirs"] / r["ours"] for r in rows if r["other"] == name and r["theirs"] and r["ours"]]
        for name in ("RKC", "ODEX")
    }
    lines = ["| " + " | ".join(HEAD) + " |", "|" + " --- |" * len(HEAD)]
    for row in rows:
        cells = (row["scene"], f"{row['error']:.0e}", row["own"], row["ours"], row["other"], row["theirs"])
        lines.append("| " + " | ".join("–" if cell is None else str(cell) for cell in cells) + " |")
    least = {f"least_{name}": min(found) for name, found in ratios.items()}
    most = {f"most_{name}": max(found) for name, found in ratios.items()}
    return SECTION.format(table="\n".join(lines), most=MOST, **least, **most)


def main() -> None:
    rows = measure()
    table("evaluations at equal error", HEAD, [list(row.values()) for row in rows])
    save("other_methods", rows)


if __name__ == "__main__":
    main()
