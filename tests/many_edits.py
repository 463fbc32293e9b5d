"""Edit models at random as a person types: ``python tests/many_edits.py [FIRST] [COUNT] [SECONDS]``; 10000 edits.

Each text is edited 20 times in a row. After each edit every question of an editor is asked, where only the class around
the change is read and where all of the text is, and the answers are compared (where two repairs of a text that is wrong
are as small, they may differ); after every tenth one the diagnostics are made. Printed are exceptions with their seeds,
answers that differ, and how long the questions took.
"""

from __future__ import annotations

import random
import sys
import time
import traceback
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "editor"))

from test_random_edits import MODELS, asked, edited  # noqa: E402

from lmoc.editor import colours, hints, outline  # noqa: E402
from lmoc.editor.analysis import analyse, with_change  # noqa: E402
from lmoc.editor.checking import check  # noqa: E402
from lmoc.editor.names import occurrences  # noqa: E402

EDITS = 20  # of one text
CHECKED = 10  # every so many of them


def everything(analysis) -> None:
    """Ask what an editor asks without a place."""
    names = occurrences(analysis)
    colours.encoded(analysis.source, names)
    list(hints.units(analysis, names))
    list(hints.runnable(analysis))
    outline.symbols(analysis)
    list(outline.folds(analysis))


def session(seed: int, spent: list[float]) -> int:
    """Edit one text; return how often the answers differed after a change that was read alone."""
    rng = random.Random(seed)
    path = rng.choice(MODELS)
    text, differ = path.read_text(encoding="utf-8"), 0
    before = analyse(text, str(path))
    for k in range(EDITS):
        text = edited(rng, text)
        if not text:
            return differ
        began = time.perf_counter()
        quick = with_change(before, text)
        own = analyse(text, str(path)) if quick is None else quick
        everything(own)
        offset = rng.randrange(len(text) + 1)
        answers = asked(own, offset)
        spent.append(time.perf_counter() - began)
        whole = analyse(text, str(path))
        if quick is not None and [c.name for c in whole.file.classes] == [c.name for c in quick.file.classes]:
            differ += answers != asked(whole, offset)
        if k % CHECKED == CHECKED - 1:
            check(text, str(path))
        before = own
    return differ


def main(first: int, count: int, seconds: float) -> None:
    spent: list[float] = []
    failed = differ = seed = 0
    until = time.monotonic() + seconds
    for seed in range(first, first + -(-count // EDITS)):
        if time.monotonic() > until:
            break
        try:
            found = session(seed, spent)
        except Exception:
            failed += 1
            print(f"seed {seed}:")
            traceback.print_exc(limit=-3)
            continue
        if found:
            print(f"seed {seed}: {found} answers differ")
        differ += found
    spent.sort()
    share = [f"{1000 * spent[int(q * (len(spent) - 1))]:.0f} ms" for q in (0.5, 0.99, 1.0)]
    print(f"{len(spent)} edits until seed {seed}: {failed} exceptions, {differ} answers differ; ", end="")
    print(f"all questions took {share[0]}, of 99 % at most {share[1]}, at most {share[2]}")


if __name__ == "__main__":
    given = [float(a) for a in sys.argv[1:]]
    main(int(given[0]) if given else 0, int(given[1]) if given[1:] else 10_000, given[2] if given[2:] else float("inf"))
