"""Random balls and stops of any restitution up to 1, against their impacts in closed form.

``python tests/many_bounces.py --count 300``. A scene ends at its stop time, or says why not, or is stopped here after
``--seconds`` of work: what goes on for so long has to have said so by then.
"""

from __future__ import annotations

import argparse
import logging
import signal
import sys
import time
import traceback
from collections import Counter
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parent / "scenes")]

from test_bouncing import compare  # noqa: E402

import lmoc  # noqa: E402

STILL = 10.0  # s without moving on


class Warned(logging.Handler):
    """When a run says that it will take long, in seconds of work since `begin`; None as long as it has not."""

    def begin(self) -> None:
        self.began, self.at = time.process_time(), None

    def emit(self, record: logging.LogRecord) -> None:
        if self.at is None and ("W0556" in record.getMessage() or "W0563" in record.getMessage()):
            self.at = time.process_time() - self.began


def watched(seed: int, seconds: float, warned: Warned) -> tuple[str, str]:
    """Return how a scene ends ("ends", "ends early", "goes on", "goes on in silence", "wrong"), and the particulars."""
    warned.begin()
    signal.setitimer(signal.ITIMER_VIRTUAL, seconds)
    try:
        with lmoc.budget(STILL):
            run, reason = compare(np.random.default_rng(seed))
    except Exception:  # noqa: BLE001, each scene is told
        return "wrong", traceback.format_exc(limit=-1)
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
    rests = any(e.kind == "accumulation" for e in run.events)
    text = f"{len(run.events)} events until {run.time[-1]:.4g} s{', bounces that end' if rests else ''}"
    if reason:
        return "ends early", f"{text}: {reason}"
    if reason is None:
        said = "without a word" if warned.at is None else f"which it said after {warned.at:.1f} s"
        return "goes on in silence" if warned.at is None else "goes on", f"{text}, {said}"
    return "ends", text


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=20.0, help="of work for one scene (20)")
    options = parser.parse_args()
    warned, log = Warned(), logging.getLogger("lmoc")
    log.addHandler(warned)
    log.propagate = False
    signal.signal(signal.SIGVTALRM, signal.default_int_handler)  # as Ctrl-C: what has been computed is kept
    ways: Counter[str] = Counter()
    longest = (0.0, 0)
    for done, seed in enumerate(range(options.seed, options.seed + options.count), 1):
        way, text = watched(seed, options.seconds, warned)
        ways[way] += 1
        longest = max(longest, (time.process_time() - warned.began, seed))
        if way != "ends":
            print(f"seed {seed} {way}: {text}", flush=True)
        if done % 10 == 0:
            counts = ", ".join(f"{n} {way}" for way, n in ways.most_common())
            print(f"{done} of {options.count}: {counts}; at most {longest[0]:.1f} s (seed {longest[1]})", flush=True)
    return int(ways["wrong"] + ways["goes on in silence"] > 0)


if __name__ == "__main__":
    sys.exit(main())
