"""Try many random scenes with laws: ``python tests/many_laws.py [FIRST] [COUNT] [steps]``; 1000 by default.

With ``steps`` scenes without restitution are compared with time stepping as its step becomes smaller, too.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parent / "scenes")]


def main() -> int:
    """Print the seeds that fail with what they say; the number of them is the exit code, 99 at most."""
    from test_random_laws import check, check_steps

    numbers = [int(argument) for argument in sys.argv[1:] if argument.isdigit()]
    first, count = (*numbers, *(0, 1000)[len(numbers) :])
    checks = (check, check_steps) if "steps" in sys.argv else (check,)
    failed = 0
    for seed in range(first, first + count):
        try:
            for one in checks:
                one(seed)
        except Exception as error:
            failed += 1
            said = str(error).splitlines() or [""]
            print(f"seed {seed}: {type(error).__name__}: {said[0]}", flush=True)
    print(f"{count - failed} of {count} scenes agree")
    return min(failed, 99)


if __name__ == "__main__":
    sys.exit(main())
