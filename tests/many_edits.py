"""Edit models at random as a person types: ``python tests/many_edits.py [FIRST] [COUNT] [SECONDS]``; 10000 edits.

Each text, every third one that of a file in a package of several files, is edited 20 times in a row. After each edit
every question of an editor is asked, where only the piece around the change is read and where nothing has been read
before, and answers are compared, those about the whole text also with such that are not made of pieces; after every
tenth one the diagnostics are made, in this process, which has made many, in one that has made none, and model by model
of the whole text, and compared. Printed are exceptions and differences with their seeds, and the processor time that
the questions took.
"""

from __future__ import annotations

import os
import pickle
import random
import sys
import tempfile
import time
import traceback
from collections import Counter
from multiprocessing import Pipe
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "editor"))

from test_random_edits import MODELS, at_place, edited, from_the_whole, in_a_package, shown  # noqa: E402

from lmoc.compilation import compiled, scene_of  # noqa: E402
from lmoc.editor.analysis import folders_around  # noqa: E402
from lmoc.editor.answers import Answers  # noqa: E402
from lmoc.editor.checking import Checked, Checks, _finding, _Text  # noqa: E402
from lmoc.editor.pieces import read  # noqa: E402
from lmoc.messages.diagnostics import ModelError  # noqa: E402
from lmoc.messages.source import Source  # noqa: E402

EDITS = 20  # of one text
CHECKED = 10  # every so many of them
PACKAGED = 3  # every so many texts


class Fresh:
    """Checks, each in a process that has checked nothing before."""

    def __init__(self) -> None:
        self.near, far = Pipe()
        if os.fork() == 0:
            self.near.close()
            while True:
                try:
                    text, path = far.recv()
                except EOFError:
                    os._exit(0)
                child = os.fork()
                if child == 0:
                    far.send(_checked(text, path, Checks()))
                    os._exit(0)
                os.waitpid(child, 0)
        far.close()

    def check(self, text: str, path: str) -> Checked | str:
        self.near.send((text, path))
        return self.near.recv()


def _checked(text: str, path: str, checks: Checks) -> Checked | str:
    try:
        return pickle.loads(pickle.dumps(checks.check(text, path)))  # noqa: S301  as it passes between processes
    except Exception:
        return traceback.format_exc(limit=-3)


def _of_the_whole(text: str, path: str) -> set[tuple[str, object]]:
    """What `lmoc check` says of the models of a text that is parsed as a whole, but of classes left out."""
    said = set()
    for model in _Text(read(path, text)).models():
        try:
            folder = [str(f.path) for f in folders_around(text, path)]
            found = compiled(Source(path, text), scene_of(model.asked, path=folder)).check()
        except ModelError as error:
            found = error.diagnostics
        said |= {_finding(d) for d in found if d.code != "W0246"}
    return said


def packaged(rng: random.Random, folder: Path) -> Path:
    """Write some models as a package, one of them as a package in it; return one of the files."""
    chosen = {p.stem: p.read_text(encoding="utf-8") for p in rng.sample(MODELS, 4)}
    inner = folder / "Pack" / "Inner"
    inner.mkdir(parents=True)
    (folder / "Pack" / "package.lmo").write_text("package Pack\nend Pack;\n")
    (inner / "package.lmo").write_text("within Pack;\npackage Inner\n  constant Real c = 2;\nend Inner;\n")
    files = []
    for k, text in enumerate(chosen.values()):
        within, place = (("Pack", folder / "Pack"), ("Pack.Inner", inner))[k % 2]
        name = text[text.index("model ") + 6 :].split()[0] if "model " in text else f"File{k}"
        files.append(place / f"{name}.lmo")
        files[-1].write_text(f"within {within};\n{text}", encoding="utf-8")
    return rng.choice(files)


def session(seed: int, fresh: Fresh, spent: dict[str, list[float]], counted: Counter) -> None:
    """Edit one text, and count what differs."""
    rng = random.Random(seed)
    with tempfile.TemporaryDirectory() as folder:
        path = packaged(rng, Path(folder)) if seed % PACKAGED == 0 else rng.choice(MODELS)
        text = path.read_text(encoding="utf-8")
        if seed % PACKAGED == 1:  # several classes
            text = "\n".join([text, *(p.read_text(encoding="utf-8") for p in rng.sample(MODELS, 2))])
            text = in_a_package(rng, text) if seed % 2 else text
        reading = read(str(path), text)
        answers, checks = Answers(reading), Checks()
        checks.check(text, str(path))
        for k in range(EDITS):
            text = edited(rng, text)
            if not text:
                return
            place = rng.randrange(len(text) + 1)
            began = time.process_time()
            reading = read(str(path), text, reading.pieces)
            asked_here = at_place(reading, place)
            spent["at a place"].append(time.process_time() - began)
            answers = Answers(reading, answers)
            found = shown(answers)
            spent["about the whole text"].append(time.process_time() - began)
            fresh_one = read(str(path), text)
            same = found == shown(Answers(fresh_one)) and asked_here == at_place(fresh_one, place)
            counted["edits"] += 1
            if not same or [found[0], found[1], found[6]] != from_the_whole(text, str(path)):
                counted["answers differ"] += 1
                print(f"seed {seed}, edit {k}: answers differ{' from those of the whole text' * same}", flush=True)
            if k % CHECKED == CHECKED - 1:
                counted["checks"] += 1
                here, there = _checked(text, str(path), checks), fresh.check(text, str(path))
                if isinstance(here, Checked):
                    own = {f for f in here.findings if f.code != "W0246"}
                    if (other := _of_the_whole(text, str(path))) != own:
                        counted["diagnostics of the whole text differ"] += 1
                        print(f"seed {seed}, edit {k}: of the whole\n{own - other}\n{other - own}", flush=True)
                counted["exceptions"] += isinstance(here, str)
                if here != there or isinstance(here, str):
                    counted["diagnostics differ"] += here != there
                    print(f"seed {seed}, edit {k}: diagnostics\n{here}\n{there}", flush=True)


def main(first: int, count: int, seconds: float) -> None:
    fresh = Fresh()
    spent: dict[str, list[float]] = {"at a place": [], "about the whole text": []}
    counted: Counter = Counter({"exceptions": 0, "answers differ": 0, "diagnostics differ": 0,
                               "diagnostics of the whole text differ": 0})  # fmt: skip
    until = time.monotonic() + seconds
    seed = first
    for seed in range(first, first + -(-count // EDITS)):
        if time.monotonic() > until:
            break
        try:
            session(seed, fresh, spent, counted)
        except Exception:
            counted["exceptions"] += 1
            print(f"seed {seed}:")
            traceback.print_exc(limit=-3)
    print(f"until seed {seed}: {', '.join(f'{n} {what}' for what, n in counted.items())}")
    for what, times in spent.items():
        times.sort()
        share = [f"{1000 * times[int(q * (len(times) - 1))]:.0f} ms" for q in (0.5, 0.99, 1.0)]
        print(f"the questions {what} took {share[0]} of processor time, of 99 % at most {share[1]}, at most {share[2]}")


if __name__ == "__main__":
    given = [float(a) for a in sys.argv[1:]]
    main(int(given[0]) if given else 0, int(given[1]) if given[1:] else 10_000, given[2] if given[2:] else float("inf"))
