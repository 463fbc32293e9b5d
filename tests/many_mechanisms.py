"""Try many random mechanisms of the plane: ``python tests/many_mechanisms.py [FIRST] [COUNT] [formulations]``.

1000 by default. With the last word those with loops are run in all formulations.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parent / "scenes")]


def main() -> int:
    """Print the seeds that fail with what they say; the number of them is the exit code, 99 at most."""
    from oracles.planar import Mechanism
    from test_random_mechanisms import check, check_formulations

    numbers = [int(argument) for argument in sys.argv[1:3]]
    first, count = (*numbers, *(0, 1000)[len(numbers) :])
    tried = check_formulations if sys.argv[3:] == ["formulations"] else check
    failed, worst = 0, 0.0
    for seed in range(first, first + count):
        try:
            worst = max(worst, float(tried(Mechanism(seed))))
        except Exception as error:
            failed += 1
            said = str(error).splitlines() or [""]
            print(f"seed {seed}: {type(error).__name__}: {said[0]}", flush=True)
    print(f"{count - failed} of {count} mechanisms agree")
    if tried is check:
        print(f"the worst error of a force is {worst:.1e} of the forces' size and the condition of their equations")
    return min(failed, 99)


if __name__ == "__main__":
    sys.exit(main())
