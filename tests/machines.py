"""The same scenes on many machines: ``make test-machines``, ``python tests/machines.py [WORD …] [--again] [--on …]``.

A hundred scenes (laws, loops, singular places, stiff ones, charts, pages; those alone whose names contain a word, where
one is given) are run in processes that see another machine each: another kernel of OpenBLAS, an engine built with other
options, no compiler, two threads, another seed of hashes, a machine that four processes keep busy, a cold and a warm
cache.

Where the arithmetic is the same, all bits are. Where it is not, a run succeeds or fails in the same way, the same
events happen in the same order, and values and instants agree within `NEAR` times the tolerance, of the size of a
signal and of the span.

With ``--again`` the cases are all models at three tolerances, on one machine with a cold cache, with a warm one, and
busy; a first, a second and a later run of each have the same bits.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from oracles.models import PARALLELOGRAM, STIFF  # noqa: E402
from oracles.outcomes import Answer, Case  # noqa: E402

ROOT = Path(__file__).parents[1]
NEAR = 100.0  # tolerances: each of two runs may miss the truth by 30 or so, in mechanisms that stretch errors more
TOLERANCE = 1e-6  # of a run where the case says nothing
KERNELS = ("Prescott", "Nehalem", "Sandybridge", "Haswell", "Zen", "SkylakeX")
FLAGS = {  # of a kernel's processor in /proc/cpuinfo
    "Nehalem": {"sse4_2"}, "Sandybridge": {"avx"}, "Haswell": {"avx2", "fma"}, "Zen": {"avx2", "fma"},
    "SkylakeX": {"avx512f", "avx512dq", "avx512bw", "avx512vl"},
}  # fmt: skip
BUSY = 4  # processes
AGAIN = (1e-4, 1e-6, 1e-9)

TOGETHER = """model Together "A state event at each tick of a clock"
  Real x(start = 0, fixed = true);
  Integer n(start = 0, fixed = true), k(start = 0, fixed = true), c;
equation
  der(x) = 2;
  c = integer(4*x);
  when sample(0.25, 0.25) then n = pre(n) + 1; end when;
  when change(c) then k = pre(k) + n; end when;
  annotation(experiment(StopTime = 1.1));
end Together;"""
UNEVEN = {  # chaotic ones, and others whose time on a machine would be for little: how long they are run
    "classic/pleiades": 0.5, "planar/double_pendulum": 2.0, "failures/drift": 1.0, "hard/h13_stiffness_ratio": 0.05,
    "hard/h28b_stiff_mount": 0.5, "hard/h14_plucked_string": 0.1, "failures/sign_friction": None,
    "planar/wheel_with_pendulum": 2.0, "hard/h02_double_pendulum": 1.0, "planar/pendulum_on_a_rod": 3.0,
}  # fmt: skip


@dataclass(frozen=True)
class Machine:
    """What the processes of one machine find around them.

    Attributes
    ----------
    environment : variables in addition
    built : options of the C compiler with which the engine is built, after its own; none for the engine that is there
    same : whether its arithmetic is that of the first machine, so that all bits are the same
    busy : how many processes keep it busy
    warm : whether it finds the cache that the first machine has left
    """

    name: str
    environment: tuple[tuple[str, str], ...] = ()
    built: str = ""
    same: bool = False
    busy: int = 0
    warm: bool = False


def machines() -> list[Machine]:
    """The machines of the table, the one that the others are compared with first."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        flags = set(next(line for line in lines if line.startswith("flags")).split())
    except (OSError, StopIteration):
        flags = set()
    kernels = [k for k in KERNELS if FLAGS.get(k, set()) <= flags]
    return [
        Machine("this one, cold cache", same=True),
        Machine("warm cache", same=True, warm=True),
        Machine("busy, cold cache", same=True, busy=BUSY),
        Machine("2 threads", (("OPENBLAS_NUM_THREADS", "2"),), same=True, warm=True),
        *(Machine(f"hash seed {k}", (("PYTHONHASHSEED", str(k)),), same=True, warm=True) for k in (1, 2)),
        *(Machine(k, (("OPENBLAS_CORETYPE", k),), warm=True) for k in kernels),
        Machine("no compiler", (("LMOC_CC", ""), ("PATH", "")), same=True, warm=True),
        *(Machine(f"engine {flag}", built=flag, same=True, warm=True) for flag in ("-O0", "-march=native")),
    ]


def scenes() -> list[Case]:
    """The hundred."""
    found = []
    for folder in ("laws", "hard", "classic", "planar", "failures"):
        for path in sorted((ROOT / "models" / folder).glob("*.lmo")):
            name = f"{folder}/{path.stem}"
            if name not in UNEVEN or UNEVEN[name] is not None:
                found.append(Case(str(path), stop=UNEVEN.get(name)))
    found += [Case(str(p)) for p in sorted((ROOT / "models" / "notes").glob("ex*.lmo"))]
    found += [Case(str(ROOT / "models" / "planar" / f"{name}.lmo"), rtol=rtol, solver=solver)
              for name in ("four_bar", "crane", "pendulum_cartesian")
              for rtol, solver in ((1e-4, "auto"), (1e-8, "taylor"), (1e-5, "cvode"))]  # fmt: skip
    found += [Case(PARALLELOGRAM, stop=4.0, rtol=rtol, solver=solver)
              for rtol, solver in ((1e-3, "dop853"), (1e-5, "auto"), (1e-8, "dop853"))]  # fmt: skip
    found += [Case(TOGETHER), Case(STIFF), Case(STIFF, rtol=1e-4), Case(STIFF, rtol=1e-9)]
    found += [Case(STIFF, "chart"), Case(str(ROOT / "models/hard/h14_plucked_string.lmo"), "chart")]
    pages = ("laws/h06_bungee", "laws/clutch_lock", "planar/crane", "notes/ex05_suspension")
    return found + [Case(str(ROOT / f"models/{name}.lmo"), "page") for name in pages]


def models() -> list[Case]:
    """All models at three tolerances, three times each."""
    return [Case(str(p), "again", rtol) for p in sorted((ROOT / "models").glob("*/*.lmo")) for rtol in AGAIN]


def answers(machine: Machine, cases: Sequence[Case], place: Path) -> list[Answer]:
    """What the cases give on a machine.

    Parameters
    ----------
    place : a folder in which the first machine has its cache
    """
    with tempfile.TemporaryDirectory() as folder:
        own, cache = Path(folder), place if machine.warm or machine == machines()[0] else Path(folder)
        (own / "cases").write_text(json.dumps([asdict(case) for case in cases]))
        environment = {k: v for k, v in os.environ.items() if k not in ("OPENBLAS_L2_SIZE", "OPENBLAS_CORETYPE")}
        environment |= {"OPENBLAS_NUM_THREADS": "1", "PYTHONHASHSEED": "0", "XDG_CACHE_HOME": str(cache)}
        environment.pop("LMOC_CACHE", None)
        if machine.built:
            environment["PYTHONPATH"] = str(_built(own / "built", machine.built))
        environment |= dict(machine.environment)
        command = [sys.executable, str(ROOT / "tests/oracles/outcomes.py"), str(own / "cases"), str(own / "answers")]
        with _kept_busy(machine.busy):
            done = subprocess.run(command, env=environment, capture_output=True, text=True)
        lines = (own / "answers").read_text().splitlines() if (own / "answers").exists() else []
        if done.returncode or len(lines) != len(cases):
            raise RuntimeError(f"{machine.name}: ended after {len(lines)} cases: {done.stderr[-500:]}")
        return [Answer(**json.loads(line)) for line in lines]


def _built(place: Path, options: str) -> Path:
    """The package as pip installs it, its engine built with further options, which count most as they come last."""
    source = place / "source"
    ignored = shutil.ignore_patterns("*.so", "__pycache__", "*.egg-info")
    for folder in ("compiler", "stdlib", "grammar"):
        shutil.copytree(ROOT / folder, source / folder, ignore=ignored)
    for file in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / file, source)
    compiler = place / "cc"
    compiler.write_text(f'#!/bin/sh\nexec cc "$@" {options}\n')
    compiler.chmod(0o755)
    command = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--target", place / "installed", source]
    environment = os.environ | {"CC": str(compiler)}
    subprocess.run([str(word) for word in command], env=environment, check=True, capture_output=True)
    assert list((place / "installed" / "lmoc" / "engine").glob("_engine*"))
    return place / "installed"


@contextmanager
def _kept_busy(count: int) -> Iterator[None]:
    others = [multiprocessing.Process(target=_burn, daemon=True) for _ in range(count)]
    for process in others:
        process.start()
    try:
        yield
    finally:
        for process in others:
            process.terminate()
            process.join()


def _burn() -> None:
    while True:
        sum(range(10_000))


def differs(case: Case, one: Answer, other: Answer, same: bool) -> str:
    """Return how an answer differs from the first machine's beyond what it may; empty where it does not."""
    if one.outcome != other.outcome:
        return f"{other.outcome} in place of {one.outcome}"
    if one.events != other.events:
        k = next((k for k, (a, b) in enumerate(zip(one.events, other.events, strict=False)) if a != b), -1)
        return f"{len(other.events)} events in place of {len(one.events)}; different from number {k} on"
    if same:
        return "" if one.bits == other.bits else f"other bits, values by {deviation(one, other):.0e}"
    allowed = NEAR * (TOLERANCE if case.rtol is None else case.rtol)
    apart = deviation(one, other)
    return "" if apart <= allowed else f"values differ by {apart:.0e}, {allowed:.0e} are allowed"


def deviation(one: Answer, other: Answer) -> float:
    """Return the largest difference of two answers: of signals by their size, of instants by the last of them."""
    worst = 0.0
    for name, values in one.signals.items():
        size = one.sizes[name] or 1.0
        for a, b in zip(values, other.signals[name], strict=True):
            if a == a or b == b:
                worst = max(worst, abs(a - b) / size if a == a and b == b else float("inf"))
    last = max(map(abs, one.instants), default=0.0) or 1.0
    return max([worst, *(abs(a - b) / last for a, b in zip(one.instants, other.instants, strict=True))])


def repeats(case: Case, found: Answer) -> str:
    """Return how the runs of one process differ; empty where they do not."""
    if case.verb != "again":
        return ""
    third = len(found.bits) // 3
    runs = [found.bits[k * third : (k + 1) * third] for k in range(3)]
    return "" if runs[0] == runs[1] == runs[2] else "first, second and later run differ"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("words", nargs="*", help="parts of the names of scenes")
    parser.add_argument("--again", action="store_true", help="bits of all models at three tolerances")
    parser.add_argument("--on", nargs="*", default=[], help="parts of the names of machines")
    given = parser.parse_args()
    cases = [c for c in (models() if given.again else scenes()) if not given.words or _is_named(c.name, given.words)]
    first, *others = machines()[:3] if given.again else machines()
    others = [m for m in others if not given.on or _is_named(m.name, given.on)]
    print(f"{len(cases)} cases", flush=True)
    bad = 0
    with tempfile.TemporaryDirectory() as folder:
        truth: list[Answer] = []
        for machine in (first, *others):
            began = time.monotonic()
            found = answers(machine, cases, Path(folder))
            truth = truth or found
            pairs = list(zip(cases, truth, found, strict=True))
            said = {c.name: differs(c, a, b, machine.same) or repeats(c, b) for c, a, b in pairs}
            said = {name: text for name, text in said.items() if text}
            equal, worst = sum(a.bits == b.bits for _, a, b in pairs), _worst(pairs)
            print(f"{machine.name:22} {len(cases) - len(said):4} as they must be, {equal:4} with the same bits, values "
                  f"within {worst:.1g} tolerances, {time.monotonic() - began:.0f} s", flush=True)  # fmt: skip
            for name, text in said.items():
                print(f"    {name}: {text}", flush=True)
            bad += len(said)
    return min(bad, 99)


def _worst(pairs: Sequence[tuple[Case, Answer, Answer]]) -> float:
    """Return the largest deviation in tolerances, of what has the same outcome and events."""
    return max(
        (deviation(a, b) / (case.rtol or TOLERANCE) for case, a, b in pairs
         if (a.outcome, a.events) == (b.outcome, b.events)), default=0.0,
    )  # fmt: skip


def _is_named(name: str, words: Sequence[str]) -> bool:
    return any(word.lower() in name.lower() for word in words)


if __name__ == "__main__":
    sys.exit(main())
