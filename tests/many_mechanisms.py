"""Try many random mechanisms of the plane: ``python tests/many_mechanisms.py [FIRST] [COUNT]``; 1000 by default."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parent / "scenes")]


def main() -> int:
    """Print the seeds that fail with what they say; the number of them is the exit code, 99 at most."""
    from oracles.planar import Mechanism
    from test_random_mechanisms import check

    first, count = (*map(int, sys.argv[1:]), *(0, 1000)[len(sys.argv) - 1 :])
    failed = 0
    for seed in range(first, first + count):
        try:
            check(Mechanism(seed))
        except Exception as error:
            failed += 1
            said = str(error).splitlines() or [""]
            print(f"seed {seed}: {type(error).__name__}: {said[0]}", flush=True)
    print(f"{count - failed} of {count} mechanisms agree")
    return min(failed, 99)


if __name__ == "__main__":
    sys.exit(main())
