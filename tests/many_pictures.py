"""Draw many random scenes of 5 to 40 parts: ``python tests/many_pictures.py [FIRST] [COUNT]``, 500 by default.

Each is drawn with every connection, no label lies on another one, and it takes less than a second of the processor.
"""

from __future__ import annotations

import sys
import tempfile
from itertools import combinations
from pathlib import Path
from time import process_time

sys.path[:0] = [str(Path(__file__).parent)]

SECOND = 1.0
TOUCHING = 0.5  # px by which the boxes of labels may lie on each other


def scene(seed: int) -> str:
    """Return one of the random scenes: elements along lines, with wheels, with parts of machines, or in the plane."""
    from oracles.random_scenes import graph, plane

    count = 5 + seed * 7 % 36
    if seed % 5 == 4:
        return plane(seed, min(2 + count // 6, 7))
    return graph(seed, count, seed % 3 if seed % 2 else 0, seed % 4 if seed % 5 < 2 else 0)


def faults(path: Path) -> tuple[list[str], int, float]:
    """Return what is wrong with the picture of a scene, the number of its items, and the seconds it took."""
    from oracles.connections import lost, numbers_mean_one_thing, overlapping

    from lmoc.interface import DAE
    from lmoc.pipeline import Clock, Scene, flatten, open_scene
    from lmoc.view.scene.block import shape_corners
    from lmoc.view.scene.compose import picture_of
    from lmoc.view.scene.picture import Label

    opened = open_scene(path, Scene(), Clock())
    flat = flatten(opened, Clock())
    began = process_time()
    picture = picture_of(flat, flat.parameter_values(), lambda: DAE(opened, flat).at_start())
    spent = process_time() - began
    found = [f"lost: {one}" for one in lost(flat, picture)] + [f"on each other: {o}" for o in overlapping(picture)]
    if not numbers_mean_one_thing(picture):
        found.append("a number means two things")
    labels = [(s.text, shape_corners(s, f)) for _, s, f in picture.placed() if isinstance(s, Label) and s.text]
    for (a, x), (b, y) in combinations(labels, 2):
        if min(min(x[k + 2], y[k + 2]) - max(x[k], y[k]) for k in (0, 1)) > TOUCHING:
            found.append(f"labels {a!r} and {b!r}")
    if spent > SECOND:
        found.append(f"it takes {spent:.1f} s")
    return found, len(picture.items), spent


def main() -> int:
    """Print what is wrong; the number of scenes with faults is the exit code, 99 at most."""
    numbers = [int(argument) for argument in sys.argv[1:3]]
    first, count = (*numbers, *(0, 500)[len(numbers) :])
    failed, slowest = 0, 0.0
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.lmo"
        path.write_text(scene(4))
        faults(path)  # what is loaded once counts for none
        for seed in range(first, first + count):
            path.write_text(scene(seed))
            try:
                found, _, spent = faults(path)
            except Exception as error:
                found, spent = [f"{type(error).__name__}: {(str(error).splitlines() or [''])[0]}"], 0.0
            slowest = max(slowest, spent)
            failed += bool(found)
            if found:
                print(f"seed {seed}: {'; '.join(found)[:300]}", flush=True)
    print(f"{count - failed} of {count} scenes are drawn without a fault; the slowest took {slowest:.2f} s")
    return min(failed, 99)


if __name__ == "__main__":
    sys.exit(main())
