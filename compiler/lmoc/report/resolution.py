"""Choice of the number of output times that resolve a motion."""

from __future__ import annotations

from collections.abc import Mapping

from lmoc.messages.diagnostics import Diagnostic

# Points that draw a step; methods of lower order make shorter steps. A Taylor series makes 3.4 steps a period of a
# harmonic motion at any tolerance, Gauss collocation 8 at 1e-6.
_PER_STEP = {"dop853": 6.0, "gauss": 3.0, "radau": 4.0, "taylor": 7.0}
_OTHERS = 1.0
_FEW = 50  # output times up to which somebody wants samples and no curve
_DRAWN = 1 / 3  # of the points that draw the motion: with fewer, a table shows another one
_MOST, _NUMBERS = 20_000, 5_000_000  # points of a picture, and numbers held for it


def needed_points(stats: Mapping[str, object]) -> int:
    """Return the number of even points that draw the motion of a run."""
    last = str(stats.get("solver", "")).split(", ")[-1]
    return int(_PER_STEP.get(last, _OTHERS) * int(stats.get("steps", 0))) + 1


def fine_count(stats: Mapping[str, object], count: int, states: int) -> int:
    """Return the number of points for a picture of a run with `count` output times."""
    most = min(_MOST, _NUMBERS // max(1, states))
    return max(count, min(needed_points(stats), most))


def coarse_points(stats: Mapping[str, object], count: int, complete: bool) -> list[Diagnostic]:
    """Return a note where the output times are too few for the motion (N0528)."""
    needed = needed_points(stats)
    if not complete or count <= _FEW or count >= _DRAWN * needed:
        return []
    message = f"{count} output times are too coarse for this motion, which took {stats['steps']} steps"
    hint = f"the table does not show what happens between them: --points {needed} (points={needed})"
    return [Diagnostic("N0528", message, hint=hint)]
