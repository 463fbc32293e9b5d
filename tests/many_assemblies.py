"""Start many random linkages with guesses: ``python tests/many_assemblies.py [FIRST] [COUNT] [free]``, 300 by default.

With ``free`` nothing is fixed: the cranks have guesses, too.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent)]


def main() -> int:
    """Print the seeds that do not start at the nearest closure; the number of them is the exit code, 99 at most."""
    from oracles.assemblies import check

    free = sys.argv[-1] == "free"
    numbers = [int(argument) for argument in sys.argv[1 : len(sys.argv) - free]]
    first, count = (*numbers, *(0, 300)[len(numbers) :])
    failed = 0
    for seed in range(first, first + count):
        try:
            check(seed, free)
        except Exception as error:
            failed += 1
            print(f"seed {seed}: {type(error).__name__}: {(str(error).splitlines() or [''])[0]}", flush=True)
    print(f"{count - failed} of {count} linkages start at the closure nearest to their guesses")
    return min(failed, 99)


if __name__ == "__main__":
    sys.exit(main())
