"""How long a person waits for `lmoc run` on a small scene, against merely importing what it stands on.

Whole processes, alternating, medians of one session:

    python benchmarks/startup.py [RUNS]

Then where the time goes: the heaviest imports, and the stages as the run itself reports them.
"""

from __future__ import annotations

import json
import re
import statistics
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
SCENE = ROOT / "models/notes/ex02_spring_mass_damper.lmo"
RUN = [sys.executable, "-m", "lmoc.cli.main", "run", str(SCENE)]
BASE = [sys.executable, "-c", "import numpy, casadi"]
BARE = [sys.executable, "-c", "pass"]


def wall(command: list[str]) -> float:
    begin = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    return time.perf_counter() - begin


def compare(runs: int) -> None:
    """Medians of alternating runs, and their ratio."""
    times: dict[str, list[float]] = {"bare": [], "base": [], "run": []}
    for command in (RUN, BASE):  # files in the system's cache, parsed library in ours
        wall(command)
    for _ in range(runs):
        for name, command in (("bare", BARE), ("base", BASE), ("run", RUN)):
            times[name].append(wall(command))
    median = {name: statistics.median(values) for name, values in times.items()}
    print(f"python alone                     {1e3 * median['bare']:7.0f} ms")
    print(f"import numpy, casadi             {1e3 * median['base']:7.0f} ms")
    print(f"lmoc run {SCENE.name:<24}{1e3 * median['run']:7.0f} ms   (fastest {1e3 * min(times['run']):.0f} ms)")
    print(f"ratio                            {median['run'] / median['base']:7.2f}      ({runs} alternating runs each)")


def imports(most: int = 12) -> None:
    """The modules whose own loading takes longest, by package."""
    command = [sys.executable, "-X", "importtime", *RUN[1:]]
    lines = subprocess.run(command, check=True, capture_output=True, text=True).stderr.splitlines()
    packages: dict[str, float] = {}
    for line in lines:
        found = re.match(r"import time:\s+(\d+) \|\s+\d+ \|\s*(\S+)", line)
        if found:
            package = found[2].split(".")[0]
            packages[package] = packages.get(package, 0.0) + int(found[1]) / 1e3
    print("\nimports (own time of all modules of a package, with the profiler's overhead)")
    for package, ms in sorted(packages.items(), key=lambda item: -item[1])[:most]:
        print(f"  {package:<24}{ms:7.1f} ms")


def stages() -> None:
    """What the stages of the compiler take."""
    output = subprocess.run([*RUN, "--json"], check=True, capture_output=True, text=True).stdout
    print("\nstages (imports that a stage is the first to need included)")
    for stage, seconds in json.loads(output)["timings"].items():
        print(f"  {stage:<24}{1e3 * seconds:7.1f} ms")


if __name__ == "__main__":
    compare(int(sys.argv[1]) if len(sys.argv) > 1 else 11)
    imports()
    stages()
