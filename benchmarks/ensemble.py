"""What a run of an ensemble costs beside a loop over `simulate`, interleaved: microseconds of the processor a run.

`python -m benchmarks.ensemble [rounds]`. heyoka's batch mode of eight lanes takes 24 µs for a quarter car with 201
output times at 1e-9, and 5 µs without output times.
"""

from __future__ import annotations

import sys
import time

import numpy as np

import lmoc
from benchmarks.common import ROOT

# scene, parameter, solver, relative tolerance; 201 output times over 2 s
CASES = [
    (scene, name, solver, rtol)
    for scene, name in (
        ("notes/ex05_suspension", "k1"),
        ("planar/pendulum", "bar.l"),
        ("planar/double_pendulum", "upper.l"),
        ("planar/chain", "l"),
    )
    for solver, rtol in (("auto", 1e-6), ("auto", 1e-9), ("taylor", 1e-9))
]
_AT_ONCE, _ALONE = 500, 20  # runs of an ensemble, and of a loop, in one round


def measure(scene: str, name: str, solver: str, rtol: float, rounds: int) -> tuple[float, float]:
    """Return the least time of a run, s: of an ensemble, and of a loop over `simulate`."""
    parameters = {"n": 10} if scene.endswith("chain") else None
    dae = lmoc.compile(ROOT / f"models/{scene}.lmo", parameters=parameters)
    values = dae.parameters[name] * np.random.default_rng(1).uniform(0.9, 1.1, _AT_ONCE)
    options = {"stop": 2.0, "points": 201, "rtol": rtol, "solver": solver}
    dae.ensemble({name: values[:4]}, workers=1, **options)
    many, alone = [], []
    for _ in range(rounds):
        begin = time.process_time()
        dae.ensemble({name: values}, workers=1, **options)
        many.append((time.process_time() - begin) / _AT_ONCE)
        begin = time.process_time()
        for value in values[:_ALONE].tolist():
            run = dae.simulate(parameters={name: value}, **options)
            for kept in dae.outputs or dae.states:
                run[kept]
        alone.append((time.process_time() - begin) / _ALONE)
    return min(many), min(alone)


def main() -> None:
    """Print the table."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    print(f"{'scene':24} {'solver':7} {'rtol':>6} {'ensemble, µs':>13} {'simulate, µs':>13} {'ratio':>6}")
    for scene, name, solver, rtol in CASES:
        many, alone = measure(scene, name, solver, rtol, rounds)
        figures = f"{1e6 * many:13.0f} {1e6 * alone:13.0f} {alone / many:6.1f}"
        print(f"{scene:24} {solver:7} {rtol:6.0e} {figures}", flush=True)


if __name__ == "__main__":
    main()
