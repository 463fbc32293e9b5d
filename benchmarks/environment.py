"""A step of a cart-pole as an environment of Gymnasium, beside a step of Gymnasium's own cart-pole, in one run.

    python benchmarks/environment.py

Gymnasium's is one explicit Euler step of formulas by hand, in Python; ours holds a tolerance of 1e-6 over the run.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import gymnasium
import numpy as np

import lmoc

CART = Path(__file__).parents[1] / "models/planar/cart_pole.lmo"
STEPS, ROUNDS = 2000, 15


def fastest(*steps: Callable[[], object]) -> list[float]:
    """Return the processor time of each, s: the least of some rounds, in turns."""
    least = [np.inf] * len(steps)
    for _ in range(ROUNDS):
        for k, step in enumerate(steps):
            start = time.process_time()
            for _ in range(STEPS):
                step()
            least[k] = min(least[k], (time.process_time() - start) / STEPS)
    return least


def main() -> None:
    ours = lmoc.Environment(lmoc.compile(CART), {"F": (-10, 10)}, horizon=1e9)
    theirs = gymnasium.make("CartPole-v1").unwrapped
    for env in (ours, theirs):
        env.reset(seed=0)
    action = np.array([0.1])

    def euler() -> None:
        theirs.step(1)
        theirs.steps_beyond_terminated = None  # it may have fallen

    own, other = fastest(lambda: ours.step(action), euler)
    print(f"{own * 1e6:.1f} µs a step, Gymnasium's own cart-pole {other * 1e6:.1f} µs: {own / other:.2f} times")


if __name__ == "__main__":
    main()
