"""Open chains of bars, released horizontally: what a mechanism costs as it grows, and how right it is.

    python -m benchmarks.chains [--sizes 2,5,10,20,40,100,1000] [--repeat 3]

`models/planar/chain.lmo` with n bars, 2 s at rtol 1e-8 under gravity: compiling, an evaluation, a warm run, and the
error of all joint positions at the end against a banded solve by hand (`tests/oracles/open_chain.py`), integrated at
1e-11. The same equations by hand with SciPy's DOP853 at 1e-8 stand beside it, in turns in the same process.
"""

from __future__ import annotations

import argparse
import sys
import time

import numpy as np

from benchmarks.common import ROOT, best, save, table

MODEL = ROOT / "models/planar/chain.lmo"
STOP, RTOL = 2.0, 1e-8
SIZES = (2, 5, 10, 20, 40, 100, 1000)


def places(angles: np.ndarray) -> np.ndarray:
    """(2, n) the ends of the bars from their directions."""
    return np.cumsum(np.stack([np.cos(angles), np.sin(angles)]), axis=1)


def by_hand(n: int, rtol: float):
    """The angles at the end, and how many evaluations they took."""
    from scipy.integrate import solve_ivp

    sys.path.insert(0, str(ROOT / "tests"))
    from oracles.open_chain import OpenChain

    done = solve_ivp(OpenChain(n).rate, (0, STOP), np.zeros(2 * n), "DOP853", rtol=rtol, atol=1e-3 * rtol)
    return done.y[:n, -1], done.nfev


def one_size(n: int, repeat: int) -> dict[str, float]:
    """Times in seconds and the error in metres for one length of the chain."""
    import lmoc

    begin = time.perf_counter()
    dae = lmoc.compile(MODEL, parameters={"n": n})
    compiling = time.perf_counter() - begin

    def run():
        return dae.simulate(stop=STOP, points=2, rtol=RTOL, energy=False)

    begin = time.perf_counter()
    run()
    first = time.perf_counter() - begin
    warm, hand, found = [], [], None
    for _ in range(repeat):
        begin = time.perf_counter()
        found = run()
        warm.append(time.perf_counter() - begin)
        hand.append(best(lambda: by_hand(n, RTOL), repeat=1))
    exact, _ = by_hand(n, 1e-11)
    angles = np.array([found[f"bar[{i}].theta"][-1] for i in range(1, n + 1)])
    ours, theirs = places(angles), places(by_hand(n, RTOL)[0])
    spent = found.stats["seconds"] - found.stats["lower_seconds"] - found.stats["start_seconds"]
    return {
        "bars": n,
        "states": len(dae.states),
        "compile": compiling,
        "first run": first,
        "run": min(warm),
        "evaluations": found.stats["evaluations"],
        "µs each": 1e6 * spent / found.stats["evaluations"],
        "error": float(np.abs(ours - places(exact)).max()),
        "by hand": min(hand),
        "its error": float(np.abs(theirs - places(exact)).max()),
        "ratio": min(warm) / min(hand),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", default=",".join(map(str, SIZES)), help="numbers of bars")
    parser.add_argument("--repeat", type=int, default=3, help="warm runs of each")
    arguments = parser.parse_args()
    figures = [one_size(int(n), arguments.repeat) for n in arguments.sizes.split(",")]
    title = f"open chains, {STOP:g} s at rtol {RTOL:g}: seconds, metres"
    table(title, list(figures[0]), [list(f.values()) for f in figures])
    save("chains", figures)


if __name__ == "__main__":
    main()
