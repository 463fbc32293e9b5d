"""Pull at every node of many scenes in their pages, and compare with Python: the same scene with the same force.

    python tests/many_pulls.py [FILE …]

A run of the page that takes longer than a page allows is told and is no failure, and likewise one that the page itself
does not rely on to the end.
"""

import sys
import warnings
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from oracles.pulls import pulled_everywhere  # noqa: E402

import lmoc  # noqa: E402

MODELS = Path(__file__).parents[1] / "models"


def main(files: list[str]) -> int:
    warnings.simplefilter("ignore")
    wrong = count = 0
    for file in files or sorted(p for p in MODELS.rglob("*.lmo") if "failures" not in p.parts):
        try:
            run = lmoc.compile(file).simulate(rtol=1e-9, points=101)
            found = pulled_everywhere(run)
        except (lmoc.ModelError, lmoc.SimulationError) as error:
            print(f"{file}: {str(error).splitlines()[0]}", flush=True)
            continue
        for one in found:
            bad = not one.reason and not one.is_right
            count, wrong = count + 1, wrong + bad
            if bad or one.reason or one.doubted:
                print(f"{file}: {'WRONG' if bad else ''} {one}", flush=True)
    print(f"{count} hands, {wrong} wrong")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
