"""FMUs of many models under any calls, and their states to the bit: ``python tests/many_fmus.py [--seeds N] [FILE …]``.

Each model of notes, hard, laws, planar and textbook, as FMI 3.0 and 2.0: random calls of Model Exchange and
Co-Simulation with values that are no numbers among them (a status, never a crash), then a state that is saved,
restored, restored elsewhere from bytes, a reset, and two instances in turns (the same bits). Each in a process apart.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

from oracles.fmu import exported

ROOT = Path(__file__).parents[1]
KINDS = "notes", "hard", "laws", "planar", "textbook"
_ONE = """
import sys
sys.path.insert(0, sys.argv[1])
import fmpy
from oracles.fmu_calls import anything_goes, goes_on_to_the_bit
path, seeds = sys.argv[2], int(sys.argv[3])
description, folder = fmpy.read_model_description(path), fmpy.extract(path)
for kind in ("ModelExchange", "CoSimulation"):
    print(kind, *anything_goes(description, folder, kind, range(seeds)), flush=True)
stop = float(description.defaultExperiment.stopTime)
for wrong in goes_on_to_the_bit(description, folder, min(stop, 5.0)):
    print("WRONG", wrong, flush=True)
"""


def checked(path: Path, fmi: int, seeds: int) -> str:
    """What is to be said of one model, beginning with WRONG where something is."""
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "scene.fmu"
        if refused := exported(path, target, fmi):
            return refused
        words = [sys.executable, "-c", _ONE, str(Path(__file__).parent), str(target), str(seeds)]
        done = subprocess.run(words, capture_output=True, text=True, timeout=600)
    said = "; ".join(line for line in done.stdout.splitlines() if not line.startswith("[")).strip("; ")
    crashed = f"WRONG exit {done.returncode}: {done.stderr.strip()[-200:]}; " if done.returncode else ""
    return f"{crashed}{said}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--seeds", type=int, default=20, help="random sequences of 60 calls for each kind (20)")
    arguments = parser.parse_args()
    every = [path for kind in KINDS for path in sorted((ROOT / "models" / kind).glob("*.lmo"))]
    wrong = 0
    for path in arguments.files or every:
        for fmi in (3, 2):
            try:
                said = checked(path, fmi, arguments.seeds)
            except subprocess.TimeoutExpired:
                said = "WRONG no end in ten minutes"
            wrong += "WRONG" in said
            print(f"{path.stem:32} {fmi}: {said}", flush=True)
    print(f"{wrong} wrong")
    return min(wrong, 99)


if __name__ == "__main__":
    sys.exit(main())
