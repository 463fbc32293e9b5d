"""Run pendulums in Cartesian coordinates on many output grids: ``python tests/many_grids.py [FIRST] [COUNT]``; 200.

Every grid is tried at one tolerance with one solver; the error is compared with that of the same solver and tolerance
on the same pendulum in an angle.
"""

from __future__ import annotations

import sys

import numpy as np
from scipy.integrate import solve_ivp

import lmoc

G = 9.81
ALLOWED = 30  # times the error in an angle
SOLVERS = ("dop853", "taylor", "cvode", "adams", "ida", "cvodes", "radau", "auto")
PENDULUM = """model Pendulum
  Real x(start = 0, fixed = true), y(start = -1), vx(start = 7.1, fixed = true), vy, T;
equation
  der(x) = vx; der(y) = vy; der(vx) = -T*x; der(vy) = -T*y - 9.81; x^2 + y^2 = 1;
end Pendulum;"""
SWING = """model Swing
  Real theta(start = 0, fixed = true), omega(start = 7.1, fixed = true);
equation
  der(theta) = omega; der(omega) = -9.81*sin(theta);
end Swing;"""
ARM = """model Arm_
  Bar b(m = 1, l = 1, theta(start = 0, fixed = true), omega(start = 4, fixed = true));
  Arm arm(l = 0.5); Mass w(m = 1, g = -9.81); Fixed ground; MovingFrame frame;
equation
  connect(b.shaft, arm.shaft); connect(arm.flange, w.flange);
  connect(ground.flange, frame.base); connect(frame.flange, w.flange);
end Arm_;"""
TURN = """model Turn
  Real theta(start = 0, fixed = true), omega(start = 4, fixed = true);
equation
  der(theta) = omega;
  (1/12 + cos(theta)^2/4)*der(omega) = sin(theta)*cos(theta)*omega^2/4 - 9.81*cos(theta)/2;
end Turn;"""


def exact(text: str, times: np.ndarray) -> np.ndarray:
    """Return the angle by SciPy."""

    def swing(t, z):
        return [z[1], -G * np.sin(z[0])]

    def turn(t, z):
        s, c = np.sin(z[0]), np.cos(z[0])
        return [z[1], (s * c * z[1] ** 2 / 4 - G * c / 2) / (1 / 12 + c * c / 4)]

    slope, start = (swing, [0, 7.1]) if text == SWING else (turn, [0, 4.0])
    return solve_ivp(slope, (0, times[-1]), start, "DOP853", times, rtol=1e-13, atol=1e-14).y[0]


def grid(random: np.random.Generator) -> np.ndarray:
    """Return output times from 0 on: even or uneven, few or many."""
    stop, count = random.uniform(0.5, 10), int(random.integers(2, 600))
    times = np.linspace(0, stop, count)
    return times if random.random() < 0.5 else np.append(0.0, np.sort(random.uniform(0, stop, count)))


def check(seed: int, scenes: dict[str, lmoc.DAE]) -> tuple[float, str]:
    """Return by what factor one run is less accurate than in an angle, and how it was made."""
    random = np.random.default_rng(seed)
    times, rtol = grid(random), 10.0 ** random.uniform(-12, -3)
    solver = SOLVERS[seed % len(SOLVERS)]
    cartesian, angular, name = ((PENDULUM, SWING, "x"), (ARM, TURN, "w.q"))[seed // len(SOLVERS) % 2]
    radius = 1.0 if name == "x" else 0.5
    angle = exact(angular, times)
    options = {"times": times, "rtol": rtol, "solver": solver}
    own = np.abs(scenes[cartesian].simulate(**options)[name] - radius * np.sin(angle)).max()
    other = np.abs(radius * np.sin(scenes[angular].simulate(**options)["theta"]) - radius * np.sin(angle)).max()
    how = f"{name}: {len(times)} times to {times[-1]:.3g} s, rtol {rtol:.1e}, {solver}"
    return own / max(other, rtol / 10, 1e-12), f"{how}: error {own:.2e}, in an angle {other:.2e}"


def main() -> int:
    """Print the runs that fail and the least accurate one; the number of failures is the exit code, 99 at most."""
    first, count = (*map(int, sys.argv[1:]), *(0, 200)[len(sys.argv) - 1 :])
    scenes = {text: lmoc.compile_text(text) for text in (PENDULUM, SWING, ARM, TURN)}
    failed, worst = 0, (0.0, "")
    for seed in range(first, first + count):
        try:
            found = check(seed, scenes)
        except lmoc.SimulationError as error:
            found = np.inf, f"refused: {error}"
        worst = max(worst, found)
        if found[0] > ALLOWED:
            failed += 1
            print(f"seed {seed}: {found[1]}", flush=True)
    print(f"{count - failed} of {count} runs agree; the least accurate by a factor of {worst[0]:.2g}: {worst[1]}")
    return min(failed, 99)


if __name__ == "__main__":
    sys.exit(main())
