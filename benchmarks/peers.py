"""The same chain in lmoc and elsewhere: same model, same tolerance, one run; building and running apart.

    python -m benchmarks.peers [--quick]
    python -m benchmarks.peers --scenes [NAME …] [--repeat 7] [--packages FOLDER]    scenes at equal error (`frontier`)

The chain starts in a fast mode, so that there is work at every length; every tool's end value is held against the
closed form.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable

from benchmarks import chain_peers as peers
from benchmarks.common import save, table
from benchmarks.frontier.race import compare_all

Measured = tuple[float, float, float]  # seconds to build, seconds to run, end value


def lmoc_chain(n: int, solver: str, compiler: bool = True) -> Measured:
    """Text to result, in a process that has lmoc loaded; the C compiler's cache is warm where one is used."""
    import lmoc
    from lmoc.engine import compiler as native

    had = os.environ.get("LMOC_CC")
    if not compiler:
        os.environ["LMOC_CC"] = ""
    native.find_compiler.cache_clear()
    try:
        begin = time.perf_counter()
        dae = lmoc.compile("models/bench/chain.lmo", parameters={"N": n, "mode": peers.mode(n)})
        built = time.perf_counter() - begin
        first = dae.simulate(solver=solver, energy=False, keep=["first"], rtol=peers.RTOL, atol=peers.ATOL, points=501)
        built += first.stats["lower_seconds"]
        begin = time.perf_counter()  # the second run: lowering is done
        run = dae.simulate(solver=solver, energy=False, keep=["first"], rtol=peers.RTOL, atol=peers.ATOL, points=501)
        ran = time.perf_counter() - begin
        return built, ran, float(run["first"][-1])
    finally:
        if had is None:
            os.environ.pop("LMOC_CC", None)
        else:
            os.environ["LMOC_CC"] = had
        native.find_compiler.cache_clear()


def tools(n: int, quick: bool) -> dict[str, Callable[[], Measured]]:
    chosen: dict[str, Callable[[], Measured]] = {
        "lmoc auto": lambda: lmoc_chain(n, "auto"),
        "lmoc cvode": lambda: lmoc_chain(n, "cvode"),
        "lmoc adams": lambda: lmoc_chain(n, "adams"),
        "lmoc auto, no C": lambda: lmoc_chain(n, "auto", compiler=False),
        "lmoc cvode, no C": lambda: lmoc_chain(n, "cvode", compiler=False),
        "casadi cvodes": lambda: peers.casadi_cvodes(n),
        "C with CVODE": lambda: peers.sundials_c(n),
        "scipy DOP853": lambda: peers.scipy_ivp(n),
    }
    if n <= (10 if quick else 400):
        chosen["rumoca"] = lambda: peers.rumoca(n)
    if n <= 10:
        chosen["sympy.mechanics"] = lambda: peers.sympy_lagrange(n)
    return chosen


def tries(n: int) -> int:
    """How often each tool builds and runs: the best of each counts, which other work on the machine disturbs least."""
    return 10 if n <= 100 else 3 if n <= 1000 else 1


def compare(n: int, quick: bool) -> list[dict]:
    exact = peers.exact_first(n)
    figures = []
    for name, call in tools(n, quick).items():
        try:
            built, ran, ends = zip(*(call() for _ in range(tries(n))), strict=True)
        except Exception as error:  # a rival's failure, or absence, is a result too
            if name.startswith("lmoc"):
                raise
            figures.append({"N": n, "tool": name, "failure": f"{type(error).__name__}: {error}"})
            print(f"  {name} at N = {n}: {type(error).__name__}: {str(error)[:100]}")
            continue
        error = abs(ends[0] - exact) / peers.AMPLITUDE
        figures.append({"N": n, "tool": name, "build": min(built), "run": min(ran), "error": error})
    own = figures[0]
    by_hand = next((f for f in figures if f["tool"] == "casadi cvodes" and "run" in f), None)
    rows = []
    for f in figures:
        if "failure" in f:
            continue
        f["total_ratio"] = (f["build"] + f["run"]) / (own["build"] + own["run"])
        f["run_ratio"] = f["run"] / by_hand["run"] if by_hand else None
        rows.append([f["tool"], f["build"], f["run"], f["error"], f["total_ratio"], f["run_ratio"]])
    head = ["tool", "build s", "run s", "error", "total / lmoc auto", "run / casadi by hand"]
    table(f"chain of {n}", head, rows)
    return figures


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="short chains only")
    parser.add_argument("--scenes", nargs="*", metavar="NAME", help="scenes at equal error, all or those named")
    parser.add_argument("--repeat", type=int, default=7, help="turns of each tool, with --scenes")
    parser.add_argument("--packages", nargs="*", default=[], metavar="FOLDER",
                        help="site-packages of other environments in which tools are installed")  # fmt: skip
    arguments = parser.parse_args()
    if arguments.scenes is not None:
        compare_all(arguments.repeat, arguments.scenes, arguments.packages)
        return
    sizes = (10, 100) if arguments.quick else (10, 100, 400, 1000, 10_000)
    save("peers", [f for n in sizes for f in compare(n, arguments.quick)])


if __name__ == "__main__":
    main()
