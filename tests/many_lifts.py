"""Random scenes of ropes that lift loads, against a computation from event to event by hand.

``python tests/many_lifts.py --count 200``
"""

from __future__ import annotations

import argparse
import sys
import traceback
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parent / "scenes")]

from test_lifting import compare, compare_winch  # noqa: E402


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1000)
    options = parser.parse_args()
    failed = events = 0
    for done, seed in enumerate(range(options.seed, options.seed + options.count), 1):
        try:
            events += (compare_winch if seed % 4 == 3 else compare)(np.random.default_rng(seed))
        except Exception:  # noqa: BLE001, each scene is told
            failed += 1
            print(f"seed {seed}: {traceback.format_exc(limit=-1)}", flush=True)
        if done % 20 == 0:
            print(f"{done} of {options.count}: {events} events, {failed} failed", flush=True)
    print(f"{options.count} scenes, {events} events of ropes, {failed} failed")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
