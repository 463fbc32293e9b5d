"""How long a person waits for `lmoc run` on a small scene, against merely importing what it stands on.

    python -m benchmarks.startup [--runs 11]

Whole processes, alternating, medians of one session. Then where the time goes: the heaviest imports, and the stages as
the run itself reports them.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import statistics
import subprocess
import sys
import time

from benchmarks.common import ROOT, save, table

SCENE = ROOT / "models/notes/ex02_spring_mass_damper.lmo"
RUN = [sys.executable, "-m", "lmoc", "run", str(SCENE)]
BASE = [sys.executable, "-c", "import numpy, casadi"]
BARE = [sys.executable, "-c", "pass"]
# an installed package has its bytecode; a working tree may be told not to keep any
ENVIRONMENT = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}


def _call(command: list[str]) -> subprocess.CompletedProcess:
    return subprocess.run(command, check=True, capture_output=True, text=True, env=ENVIRONMENT)


def wall(command: list[str]) -> float:
    begin = time.perf_counter()
    _call(command)
    return time.perf_counter() - begin


def compare(runs: int) -> dict[str, float]:
    """Medians of alternating runs in ms, and the ratio of `lmoc run` to the bare imports."""
    commands = {"python alone": BARE, "import numpy, casadi": BASE, "lmoc run": RUN}
    times: dict[str, list[float]] = {name: [] for name in commands}
    for command in (RUN, BASE):  # files in the system's cache, parsed library in ours
        wall(command)
    for _ in range(runs):
        for name, command in commands.items():
            times[name].append(1e3 * wall(command))
    rows = [(name, statistics.median(values), min(values)) for name, values in times.items()]
    table(f"whole processes in ms ({SCENE.name})", ("", "median", "least"), rows)
    median = {name: value for name, value, _ in rows}
    ratio = median["lmoc run"] / median["import numpy, casadi"]
    print(f"\n  ratio {ratio:.2f} of {runs} alternating runs")
    return {**median, "ratio": ratio}


def imports(most: int = 12) -> dict[str, float]:
    """Own loading time of all modules of a package in ms, with the profiler's overhead."""
    command = [sys.executable, "-X", "importtime", *RUN[1:]]
    lines = _call(command).stderr.splitlines()
    packages: dict[str, float] = {}
    for line in lines:
        found = re.match(r"import time:\s+(\d+) \|\s+\d+ \|\s*(\S+)", line)
        if found:
            package = found[2].split(".")[0]
            packages[package] = packages.get(package, 0.0) + int(found[1]) / 1e3
    heaviest = sorted(packages.items(), key=lambda item: -item[1])[:most]
    table("imports in ms, by package, with the profiler's overhead", ("package", "own"), heaviest)
    return dict(heaviest)


def stages() -> dict[str, float]:
    """Stages of the compiler in ms; what a stage is the first to import is counted with it."""
    output = _call([*RUN, "--json"]).stdout
    timings = {stage: 1e3 * seconds for stage, seconds in json.loads(output)["timings"].items()}
    table("stages in ms, with the imports that each is the first to need", ("stage", "time"), list(timings.items()))
    return timings


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=11, help="runs of each command")
    arguments = parser.parse_args()
    save("startup", {"wall": compare(arguments.runs), "imports": imports(), "stages": stages()})


if __name__ == "__main__":
    main()
