"""The engine of pages, built with ziglang: ``make wasm`` after a change of what it is made of.

The built file stands in the package, since whoever installs it has no compiler for WebAssembly; a test compares it with
the sources.
"""

from __future__ import annotations

import hashlib
import re
import subprocess
import sys
from pathlib import Path

ENGINE = Path(__file__).parents[1] / "lmoc" / "engine" / "c"
ASSETS = Path(__file__).parents[1] / "lmoc" / "view" / "page" / "assets"
BUILT, DIGEST = ASSETS / "engine.wasm", ASSETS / "engine.sha256"
SOURCES = (
    "page", "page_steps", "page_memory", "bytes", "tape", "blocks", "dense", "newton", "copies", "lu", "lu_order",
    "tables", "evaluate", "dop853", "walk", "radau", "first_step", "roots", "crossing", "page_events", "beside",
    "instant", "relations", "trials", "hops", "happen", "stiff_states", "page_laws", "law_run", "free_dynamics",
    "transition", "strike", "jenkins", "project", "switching", "manifold", "mode", "impact", "impact_order",
    "complementarity", "cones", "coordinates", "coordinate_watch", "passage", "page_coordinates", "page_instants",
    "jump", "page_jumps",
)  # fmt: skip
FLAGS = ("-Os", "-std=c11", "-ffp-contract=off", "-fno-math-errno", "-fno-strict-aliasing")  # equal bits everywhere
_INCLUDE = re.compile(r'^#include "(\w+\.h)"', re.MULTILINE)
_EXPORTED = re.compile(r"\b(lmoc_page_\w+)\(")


def files() -> list[Path]:
    """Return the sources, and the headers that they include."""
    found = [ENGINE / f"{name}.c" for name in SOURCES]
    for file in found:
        found += [h for n in _INCLUDE.findall(file.read_text("utf-8")) if (h := ENGINE / n) not in found]
    return found


def digest() -> str:
    """Return what stands for the sources and the options."""
    h = hashlib.sha256(" ".join(FLAGS).encode())
    for file in sorted(files()):
        h.update(f"\0{file.name}\0".encode() + file.read_bytes())
    return h.hexdigest()


def build(target: Path) -> None:
    """Build it; without the libraries of a system, so that it asks nothing of its host."""
    exported = sorted(set(_EXPORTED.findall((ENGINE / "page.h").read_text("utf-8"))))
    command = [sys.executable, "-m", "ziglang", "cc", "--target=wasm32-wasi", "-mexec-model=reactor", "-s", *FLAGS]
    command.append("-Wl,-z,stack-size=1048576")
    command += [f"-Wl,--export={name}" for name in exported]
    subprocess.run([*command, *(str(ENGINE / f"{name}.c") for name in SOURCES), "-o", str(target)], check=True)


if __name__ == "__main__":
    build(BUILT)
    DIGEST.write_text(digest() + "\n")
