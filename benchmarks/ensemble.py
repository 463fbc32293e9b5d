"""What a run of an ensemble costs beside heyoka's batch mode and beside a loop over `simulate`, interleaved.

`python -m benchmarks.ensemble [rounds] [runs]`: microseconds of the processor a run, the least of some rounds, and the
largest deviation from a run at 1e-12 in units of the largest value. heyoka (`pip install heyoka`) goes eight runs at a
time and compiles its steps beforehand; lmoc begins with what it interprets, and compiles where an ensemble is long.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import lmoc
from benchmarks.common import ROOT

TOLERANCES = (1e-6, 1e-9)
_ALONE = 20  # runs of a loop in one round
_TRUE = 4  # runs that are compared with a finer one


@dataclass(frozen=True)
class Case:
    """A scene, the parameter or start value that varies, its states by name, and the same equations for heyoka."""

    name: str
    scene: str
    varied: str
    initial: bool
    states: tuple[str, ...]
    stop: float
    equations: Callable[[], tuple[list, np.ndarray]]


def suspension() -> tuple[list, np.ndarray]:
    """Return a quarter car; the parameter is the tyre's stiffness."""
    import heyoka as hy

    q1, q2, v1, v2 = hy.make_vars("q1", "q2", "v1", "v2")
    road, slope = 0.05 * hy.sin(6.0 * hy.time), 0.3 * hy.cos(6.0 * hy.time)
    tyre = hy.par[0] * (road - q1) + 100.0 * (slope - v1)
    strut = 16000.0 * (q1 - q2) + 1200.0 * (v1 - v2)
    return [(q1, v1), (q2, v2), (v1, (tyre - strut) / 50.0 - 9.81), (v2, strut / 300.0 - 9.81)], np.zeros(4)


def double_pendulum() -> tuple[list, np.ndarray]:
    """Return two uniform bars; the parameter is the length of the upper one."""
    import heyoka as hy

    a, c, u, w = hy.make_vars("a", "c", "u", "w")  # the angle of the first, the one between them, and their rates
    l1, l2, m1, m2, g = hy.par[0], 0.7, 1.0, 0.5, 9.81
    b, rate = a + c, u + w
    first, second, mixed = (m1 / 3.0 + m2) * l1 * l1, m2 * l2 * l2 / 3.0, 0.5 * m2 * l2 * l1
    cosine, sine = hy.cos(c), hy.sin(c)
    force1 = mixed * sine * rate * rate - g * (0.5 * m1 + m2) * l1 * hy.cos(a)
    force2 = -mixed * sine * u * u - 0.5 * m2 * g * l2 * hy.cos(b)
    determinant = first * second - (mixed * cosine) ** 2.0
    du = (second * force1 - mixed * cosine * force2) / determinant
    db = (first * force2 - mixed * cosine * force1) / determinant
    return [(a, u), (c, w), (u, du), (w, db - du)], np.array([0.0, 1.0, 0.0, 0.0])


def pleiades() -> tuple[list, np.ndarray]:
    """Return seven stars; what varies is where the first one begins."""
    import heyoka as hy

    names = [f"{kind}{i}" for kind in ("x", "y", "vx", "vy") for i in range(7)]
    v = np.array(hy.make_vars(*names)).reshape(4, 7)
    rates = [[hy.expression(0.0)] * 7 for _ in range(2)]
    for i in range(7):
        for j in range(7):
            if i != j:
                dx, dy = v[0, j] - v[0, i], v[1, j] - v[1, i]
                pull = (j + 1.0) * (dx * dx + dy * dy) ** -1.5
                rates[0][i], rates[1][i] = rates[0][i] + pull * dx, rates[1][i] + pull * dy
    system = [(v[k, i], v[k + 2, i]) for k in range(2) for i in range(7)]
    system += [(v[k + 2, i], rates[k][i]) for k in range(2) for i in range(7)]
    start = [[3, 3, -1, -3, 2, -2, 2], [3, -3, 2, 0, 0, -4, 4], [0, 0, 0, 0, 0, 1.75, -1.5], [0, 0, 0, -1.25, 1, 0, 0]]
    return system, np.array(start, float).ravel()


_STARS = tuple(f"star[{i}].{kind}" for kind in ("x", "y", "vx", "vy") for i in range(1, 8))
CASES = (
    Case("quarter car", "notes/ex05_suspension", "k1", False,
         ("wheel.q", "body.q", "wheel.v", "body.v"), 2.0, suspension),
    Case("double pendulum", "planar/double_pendulum", "upper.l", False,
         ("shoulder.phi", "elbow.phi", "shoulder.omega", "elbow.omega"), 2.0, double_pendulum),
    Case("Pleiades", "classic/pleiades", "star[1].x", True, _STARS, 3.0, pleiades),
)  # fmt: skip


class Heyoka:
    """heyoka's batches of as many runs as suit the processor."""

    def __init__(self, case: Case, rtol: float, points: int) -> None:
        import heyoka as hy

        system, self.start = case.equations()
        self.case, self.lanes, self.points = case, hy.recommended_simd_size(), points
        state = np.repeat(self.start[:, None], self.lanes, axis=1)
        parameters = {} if case.initial else {"pars": np.ones((1, self.lanes))}
        self.steps = hy.taylor_adaptive_batch(system, state, tol=rtol, compact_mode=len(system) > 20, **parameters)
        self.grid = np.repeat(np.linspace(0.0, case.stop, points)[:, None], self.lanes, axis=1)

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """Return the states (runs, times, n); as few as two times are the beginning and the end."""
        steps, lanes = self.steps, self.lanes
        found = np.empty((len(values), self.points, len(self.start)))
        for first in range(0, len(values), lanes):
            own = values[first : first + lanes]
            steps.set_time(0.0)
            steps.state[:] = self.start[:, None]
            (steps.state if self.case.initial else steps.pars)[0, : len(own)] = own
            if self.points > 2:
                found[first : first + lanes] = steps.propagate_grid(self.grid)[1].transpose(2, 0, 1)[: len(own)]
            else:
                found[first : first + lanes, 0] = steps.state.T[: len(own)]
                steps.propagate_until(np.full(lanes, self.case.stop))
                found[first : first + lanes, 1] = steps.state.T[: len(own)]
        return found


class Lmoc:
    """An ensemble that keeps the states."""

    def __init__(self, case: Case, rtol: float, points: int, energy: bool) -> None:
        self.case, self.dae = case, lmoc.compile(ROOT / f"models/{case.scene}.lmo")
        self.options = {"stop": case.stop, "points": points, "rtol": rtol, "energy": energy}

    def __call__(self, values: np.ndarray) -> list[np.ndarray]:
        """Return the states, each (runs, times)."""
        varied = {("initial" if self.case.initial else "parameters"): {self.case.varied: values}}
        many = self.dae.ensemble(**varied, keep=self.case.states, workers=1, **self.options)
        return [many[name] for name in self.case.states]

    def alone(self, value: float) -> np.ndarray:
        """Return the states (times, n) of a single run."""
        varied = {("initial" if self.case.initial else "parameters"): {self.case.varied: value}}
        run = self.dae.simulate(**varied, **self.options)
        return np.stack([run[name] for name in self.case.states], axis=1)


def measure(case: Case, rtol: float, points: int, rounds: int, count: int) -> dict[str, tuple[float, float]]:
    """Return seconds a run and the error of each."""
    nominal = 3.0 if case.initial else lmoc.compile(ROOT / f"models/{case.scene}.lmo").parameters[case.varied]
    spread = 1e-3 if case.initial else 0.1
    values = nominal * np.random.default_rng(1).uniform(1 - spread, 1 + spread, count)
    true = np.stack([Lmoc(case, 1e-12, points, False).alone(v) for v in values[:_TRUE].tolist()])
    ledger = Lmoc(case, rtol, points, True)
    makers: dict[str, Callable[[np.ndarray], np.ndarray | list[np.ndarray]]] = {
        "lmoc": ledger, "without ledger": Lmoc(case, rtol, points, False),
        "heyoka": Heyoka(case, rtol, points),
        "simulate": lambda own: np.stack([ledger.alone(v) for v in own[:_ALONE].tolist()]),
    }  # fmt: skip
    taken = {name: np.inf for name in makers}
    errors = {}
    for _ in range(rounds + 1):  # the first one warms up
        for name, make in makers.items():
            begin = time.process_time()
            made = make(values)
            spent = time.process_time() - begin
            found = np.stack([own[:_TRUE] for own in made], axis=2) if isinstance(made, list) else made[:_TRUE]
            taken[name] = min(taken[name], spent / (_ALONE if name == "simulate" else count))
            errors[name] = float(np.abs(found - true).max() / np.abs(true).max())
    return {name: (taken[name], errors[name]) for name in makers}


def main() -> None:
    """Print the table."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    count = int(sys.argv[2]) if len(sys.argv) > 2 else 2000
    print(f"{'':16} {'rtol':>6} {'times':>5}" + "".join(
        f" {name + ', µs':>19} {'error':>7}" for name in ("lmoc", "without ledger", "heyoka", "simulate")
    ) + f" {'lmoc/heyoka':>12}")  # fmt: skip
    for case in CASES:
        for rtol in TOLERANCES:
            for points in (201, 2):
                found = measure(case, rtol, points, rounds, count if case.name != "Pleiades" else count // 20)
                figures = "".join(f" {1e6 * taken:19.1f} {error:7.0e}" for taken, error in found.values())
                ratio = found["lmoc"][0] / found["heyoka"][0]
                print(f"{case.name:16} {rtol:6.0e} {points:5}{figures} {ratio:12.2f}", flush=True)


if __name__ == "__main__":
    main()
