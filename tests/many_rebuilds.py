"""FMUs of many models, built anew from what is in them alone: ``python tests/many_rebuilds.py [FILE …]``.

Each model of notes, hard, laws and planar, as FMI 3.0 and 2.0: the binary is thrown away, a C compiler ($CC, gcc)
makes another one as a stranger would who has nothing but the files of the FMU (of 3.0 with the options that
``buildDescription.xml`` names, of 2.0 with none), and FMPy runs both. Warnings of the compiler are told, and results
whose bits differ.
"""

from __future__ import annotations

import argparse
import os
import pickle
import shlex
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path
from xml.etree import ElementTree

from oracles.fmu import exported

ROOT = Path(__file__).parents[1]
KINDS = "notes", "hard", "laws", "planar"
_RUN = """
import pickle, sys, fmpy
found = []
for kind, steps in ("ModelExchange", 100), ("CoSimulation", 10):
    description = fmpy.read_model_description(sys.argv[1])
    begin, end = (float(getattr(description.defaultExperiment, at) or 0) for at in ("startTime", "stopTime"))
    lines = []
    try:
        result = fmpy.simulate_fmu(
            sys.argv[1], fmi_type=kind, output_interval=(end - begin) / steps, debug_logging=True,
            relative_tolerance=1e-6, output=[v.name for v in description.modelVariables if v.causality != "parameter"],
            logger=lambda *a: lines.append(a[-1]),
        )
        found.append((result.dtype.names, result.tobytes(), lines))
    except Exception as error:
        found.append((str(error), lines))
with open(sys.argv[2], "wb") as file:
    pickle.dump(found, file)
"""


def _build_orders(folder: Path) -> tuple[str, list[str], list[str]]:
    """Return the identifier of an FMU, its files in C and the options of the compiler, by its own description."""
    if (folder / "sources/buildDescription.xml").exists():
        configuration = ElementTree.parse(folder / "sources/buildDescription.xml").find("BuildConfiguration")
        files = configuration.find("SourceFileSet")
        options = shlex.split(files.get("compilerOptions", ""))
        options += [f"-I{d.get('name')}" for d in files.findall("IncludeDirectory")]
        return configuration.get("modelIdentifier"), [f.get("name") for f in files.findall("SourceFile")], options
    kind = ElementTree.parse(folder / "modelDescription.xml").find("ModelExchange")
    return kind.get("modelIdentifier"), [f.get("name") for f in kind.find("SourceFiles")], []


def rebuilt(path: Path, fmi: int, folder: Path) -> tuple[Path, str]:
    """Make an FMU without the binary of another one, and with one of its own; return it and what the compiler said."""
    with zipfile.ZipFile(path) as archive:
        archive.extractall(folder)
    for binary in [b for b in (folder / "binaries").rglob("*") if b.is_file()]:
        binary.unlink()
    name, files, options = _build_orders(folder)
    target = folder / "binaries" / ("x86_64-linux" if fmi == 3 else "linux64") / f"{name}.so"
    compiler = shlex.split(os.environ.get("CC", "gcc"))
    orders = [[*compiler, *options, "-Wall", "-fPIC", "-c", name, "-o", f"{name}.o"] for name in files]
    orders.append([*compiler, "-shared", *(f"{name}.o" for name in files), "-o", str(target), "-lm"])
    said = ""
    for order in orders:
        built = subprocess.run(order, cwd=folder / "sources", capture_output=True, text=True)
        if built.returncode:
            return path, f"WRONG it does not compile: {built.stderr.strip()[-300:]}"
        said += built.stderr.strip()
    other = folder.with_suffix(".fmu")
    with zipfile.ZipFile(other, "w") as archive:
        for file in sorted(p for p in folder.rglob("*") if p.is_file()):
            archive.write(file, file.relative_to(folder))
    return other, said


def _run(path: Path) -> list:
    answer = path.with_suffix(".pickle")
    words = [sys.executable, "-c", _RUN, str(path), str(answer)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=900)
    return pickle.loads(answer.read_bytes()) if not done.returncode else [(done.stderr.strip()[-300:],)]


def checked(path: Path, fmi: int) -> str:
    """What is to be said of one model, beginning with WRONG where something is."""
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "scene.fmu"
        if refused := exported(path, target, fmi):
            return refused
        other, said = rebuilt(target, fmi, Path(folder) / "rebuilt")
        if said:
            return said if said.startswith("WRONG") else f"WRONG the compiler says {said[:300]}"
        own, anew = _run(target), _run(other)
    if own != anew:
        return "WRONG other results"
    return "; ".join("the same" if len(found) == 3 else f"the same: {found[0][:90]}" for found in own)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="*", type=Path)
    every = [path for kind in KINDS for path in sorted((ROOT / "models" / kind).glob("*.lmo"))]
    wrong = 0
    for path in parser.parse_args().files or every:
        for fmi in (3, 2):
            said = checked(path, fmi)
            wrong += said.startswith("WRONG")
            print(f"{path.stem:36} {fmi}: {said}", flush=True)
    print(f"{wrong} wrong")
    return min(wrong, 99)


if __name__ == "__main__":
    sys.exit(main())
