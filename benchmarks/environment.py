"""A step of a cart-pole as an environment of Gymnasium, beside a step of Gymnasium's own cart-pole, in one run.

    python benchmarks/environment.py

Gymnasium's is one explicit Euler step of formulas by hand, in Python; ours holds a tolerance of 1e-6 over the run. Many
of them side by side are a `VectorEnvironment`, beside Gymnasium's own vectorized one, which is Euler's step of arrays.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import gymnasium
import numpy as np

import lmoc

CART = Path(__file__).parents[1] / "models/planar/cart_pole.lmo"
STEPS, ROUNDS, MANY = 1000, 15, 256


def fastest(*step: Callable[[], object], steps: int = STEPS) -> list[float]:
    """Return the processor time of each, s: the least of some rounds, in turns."""
    least = [np.inf] * len(step)
    for _ in range(ROUNDS):
        for k, own in enumerate(step):
            start = time.process_time()
            for _ in range(steps):
                own()
            least[k] = min(least[k], (time.process_time() - start) / steps)
    return least


def main() -> None:
    dae = lmoc.compile(CART)
    one = lmoc.Environment(dae, {"F": (-10, 10)}, horizon=1e9)
    many = lmoc.VectorEnvironment(dae, MANY, {"F": (-10, 10)}, horizon=1e9)
    theirs = gymnasium.make("CartPole-v1").unwrapped
    arrays = gymnasium.make_vec("CartPole-v1", MANY, vectorization_mode="vector_entry_point")
    for env in (one, many, theirs, arrays):
        env.reset(seed=0)
    action, actions, pushes = np.array([0.1]), np.full((MANY, 1), 0.1), np.ones(MANY, int)

    def euler() -> None:
        theirs.step(1)
        theirs.steps_beyond_terminated = None  # it may have fallen

    own, other = fastest(lambda: one.step(action), euler)
    print(f"{own * 1e6:.1f} µs a step, Gymnasium's own cart-pole {other * 1e6:.1f} µs: {own / other:.2f} times")
    own, other = (t / MANY for t in fastest(lambda: many.step(actions), lambda: arrays.step(pushes), steps=20))
    print(f"{MANY} side by side: {own * 1e6:.2f} µs a step, {1 / own:.0f} a second; Gymnasium's {other * 1e6:.2f} µs")


if __name__ == "__main__":
    main()
