"""Many mechanisms in one scene: what an evaluation costs, against C written by hand for it.

    python -m benchmarks.many [--count 10000] [--repeat 30]

Double pendulums made of bars and joints (a linear block of accelerations and reactions each), and masses on two cubic
springs in series (a nonlinear equation each). Every evaluation is at another place, a small way off the last one, so
that Newton's method has something to do. Times alternate in one process, the shortest of each count; the results are
compared. The hand-written C (`many.c`) is compiled with the same options as the generated one.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.common import native, save, table

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from oracles.copies import PAIRS, PENDULUMS  # noqa: E402

ALIKE = PENDULUMS.replace("l = {1 + 0.1*i for i in 1:n}", "each l = 1")  # as in the C by hand


def by_hand() -> ctypes.CDLL:
    """`many.c`, compiled."""
    from lmoc.engine.compiler import FLAGS

    folder = tempfile.mkdtemp()
    library = os.path.join(folder, "many.so")
    command = os.environ.get("CC", "cc")
    source = Path(__file__).with_name("many.c")
    subprocess.run([command, "-O2", "-march=native", *FLAGS, "-o", library, str(source), "-lm"], check=True)
    return ctypes.CDLL(library)


def made(text: str, n: int):
    """The compiled scene, its system ready to be evaluated, its start, and the seconds all that took."""
    import lmoc

    begin = time.perf_counter()
    dae = lmoc.compile_text(text, parameters={"n": n})
    compiled = time.perf_counter() - begin
    begin = time.perf_counter()
    system, _ = native(dae)
    run = dae.simulate(stop=1e-6, points=2, energy=False)
    return dae, system, run.trajectory.table[0].copy(), (compiled, time.perf_counter() - begin)


def alternating(ours, theirs, repeat: int) -> tuple[float, float]:
    """Shortest times of two functions, called in turns."""
    least = [np.inf, np.inf]
    for k in range(repeat):
        for which, call in enumerate((ours, theirs)):
            begin = time.perf_counter()
            call(k)
            least[which] = min(least[which], time.perf_counter() - begin)
    return least[0], least[1]


def compare(name: str, text: str, columns: list[str], hand, n: int, repeat: int) -> dict[str, object]:
    """One kind of scene.

    Parameters
    ----------
    columns : names of the states of one of them, with `{}` for its number
    hand : (states, rates) -> None, the C function
    """
    dae, system, start, (compiled, code) = made(text, n)
    order = np.array([dae.states.index(c.format(i)) for i in range(1, n + 1) for c in columns])
    states = [start + 1e-3 * np.sin(np.arange(len(start)) + k) for k in range(2)]
    theirs = [np.ascontiguousarray(x[order]) for x in states]
    out, rates = np.empty(len(start)), np.empty(len(start))
    ours_best, theirs_best = alternating(
        lambda k: system.rhs(0.0, states[k % 2], out), lambda k: hand(theirs[k % 2], rates), repeat
    )
    system.rhs(0.0, states[0], out)
    hand(theirs[0], rates)
    return {"scene": name, "count": n, "states": len(start), "compile s": compiled, "C s": code, "ms": 1e3 * ours_best,
            "by hand ms": 1e3 * theirs_best, "ratio": ours_best / theirs_best,
            "apart": float(np.abs(out[order] - rates).max())}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--repeat", type=int, default=30)
    arguments = parser.parse_args()
    n, library = arguments.count, by_hand()
    number, array = ctypes.c_long(n), np.ctypeslib.ndpointer(np.float64, flags="C")
    library.pendulums.argtypes = [ctypes.c_long, array, array]
    library.pairs.argtypes = [ctypes.c_long, array, array, array, array, array]
    i = np.arange(1, n + 1)
    k1, k2, between = 1 + 0.5 * np.sin(i), 2 + 0.5 * np.cos(i), np.full(n, 0.5)
    rows = [
        compare("double pendulums", ALIKE,
                ["shoulder[{}].phi", "shoulder[{}].omega", "elbow[{}].phi", "elbow[{}].omega"],
                lambda x, f: library.pendulums(number, x, f), n, arguments.repeat),
        compare("pairs of cubic springs", PAIRS, ["mass[{}].q", "mass[{}].v"],
                lambda x, f: library.pairs(number, x, f, between, k1, k2), n, arguments.repeat),
    ]  # fmt: skip
    table("An evaluation, against C by hand", list(rows[0]), [list(r.values()) for r in rows])
    save("many", {"rows": rows})


if __name__ == "__main__":
    main()
