"""What the benchmarks share: the machine, repeated timing, tables and files."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "out" / "benchmarks"


def machine() -> dict[str, str]:
    """Processor, cores, system and versions: what a figure means without."""
    from importlib.metadata import version

    from lmoc import __version__

    processor = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        processor = next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        pass
    packages = {name: version(name) for name in ("numpy", "casadi", "scipy", "scikit-sundae")}
    return {
        "processor": processor,
        "cores": str(os.cpu_count()),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "lmoc": __version__,
        **packages,
    }


def best(function: Callable[[], object], repeat: int = 3, enough: float = 5.0) -> float:
    """Shortest wall time of a few calls, in seconds; stops early once `enough` seconds are spent."""
    times, spent = [], 0.0
    for _ in range(repeat):
        begin = time.perf_counter()
        function()
        times.append(time.perf_counter() - begin)
        spent += times[-1]
        if spent > enough:
            break
    return min(times)


def buffered(function, n: int) -> Callable[[float, np.ndarray], np.ndarray]:
    """A casadi function ``f(t, x)`` of n states as a Python function, called through its buffer."""
    buffer, evaluate = function.buffer()
    t, x, out = np.zeros(1), np.zeros(n), np.zeros(n)
    buffer.set_arg(0, memoryview(t))
    buffer.set_arg(1, memoryview(x))
    buffer.set_res(0, memoryview(out))

    def rhs(time: float, state: np.ndarray) -> np.ndarray:
        t[0] = time
        x[:] = state
        evaluate()
        return out.copy()

    rhs.kept = function, buffer  # which the call works on
    return rhs


def native(dae):
    """The system of a scene in C, ready to be evaluated, and the seconds that took."""
    from lmoc.messages.diagnostics import Report
    from lmoc.numerics.evaluate.engine_system import EngineSystem
    from lmoc.numerics.plan.plan import build_plan
    from lmoc.numerics.signals.signals import bind_signals

    report = Report()
    signals = bind_signals(dae.flat, None, report)
    plan = build_plan(dae.reduced, signals, False, report)
    begin = time.perf_counter()
    system = EngineSystem(plan)
    system.prepare(plan.base(dae.values, signals), signals)
    return system, time.perf_counter() - begin


def in_process(module: str, *arguments: str, timeout: float = 1200) -> dict:
    """Run ``python -m module arguments`` and read the JSON of its last line, with its peak memory in MB added."""
    wrapper = (
        "import resource, runpy, sys; sys.argv = sys.argv[1:]; runpy.run_module(sys.argv[0], run_name='__main__'); "
        "print('\\n' + str(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024))"
    )
    done = subprocess.run(
        [sys.executable, "-c", wrapper, module, *arguments], capture_output=True, text=True, timeout=timeout, cwd=ROOT
    )
    if done.returncode != 0:
        raise RuntimeError(done.stderr.strip().splitlines()[-1] if done.stderr.strip() else "failed without a word")
    *_, result, memory = (line for line in done.stdout.splitlines() if line.strip())
    return {**json.loads(result), "memory": float(memory)}


def table(title: str, head: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Print an aligned table."""
    text = [[_cell(c) for c in row] for row in rows]
    widths = [max(len(r[k]) for r in [list(head), *text]) for k in range(len(head))]
    print(f"\n{title}")
    for row in [list(head), ["-" * w for w in widths], *text]:
        print("  " + "  ".join(c.rjust(w) for c, w in zip(row, widths, strict=True)))


def _cell(value: object) -> str:
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.3g}" if value < 1000 else f"{value:.0f}"
    return str(value)


def save(name: str, data: object) -> Path:
    """Write figures and the machine's description to ``out/benchmarks/name.json``."""
    RESULTS.mkdir(parents=True, exist_ok=True)
    path = RESULTS / f"{name}.json"
    path.write_text(json.dumps({"machine": machine(), "figures": data}, indent=1))
    print(f"\nsaved to {path.relative_to(ROOT)}")
    return path
