"""Random balls and stops of any restitution up to 1, against their impacts in closed form.

``python tests/many_bounces.py --count 300``
"""

from __future__ import annotations

import argparse
import logging
import sys
import time
import traceback
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parent / "scenes")]

from test_bouncing import compare  # noqa: E402

import lmoc  # noqa: E402

SECONDS = 10.0  # without moving on


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1000)
    options = parser.parse_args()
    logging.getLogger("lmoc").setLevel(logging.ERROR)
    failed = events = rests = unended = 0
    longest = 0.0
    for seed in range(options.seed, options.seed + options.count):
        began = time.process_time()
        try:
            with lmoc.budget(SECONDS):
                run, reason = compare(np.random.default_rng(seed))
        except Exception:  # noqa: BLE001, each scene is told
            failed += 1
            print(f"seed {seed}: {traceback.format_exc(limit=-1)}", flush=True)
            continue
        longest = max(longest, time.process_time() - began)
        events += len(run.events)
        rests += any(e.kind == "accumulation" for e in run.events)
        if reason:
            unended += 1
            print(f"seed {seed}: {len(run.events)} events: {reason}", flush=True)
    print(f"{options.count} scenes: {failed} wrong, {unended} ended early with a reason, {rests} with bounces that end")
    print(f"{events} events, at most {longest:.1f} s of work for one")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
