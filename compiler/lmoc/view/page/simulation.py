"""The page's own simulation: the run as data, its sliders, and what can be pulled in it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, field, replace
from typing import Any

from lmoc.report.result import Result
from lmoc.support.records import dataclass
from lmoc.symbolic.styles import unit_text
from lmoc.view.javascript.script import NotWritten, Script, write_script
from lmoc.view.javascript.sliders import sliders
from lmoc.view.page.hands import hands_data, of_origin, run_with_hands

MOST_SLIDERS = 60
MOST_SCRIPT = 1_000_000  # characters of the page's own simulation


@dataclass(frozen=True, eq=False)
class OwnRun:
    """What the page simulates.

    Attributes
    ----------
    run : with a hand at each node of the picture that moves, where that can be had
    script : None where the page has no simulation
    reason : why it has none
    hands : {"hands": what the page reads of them, "handOf": {variable: index of the hand that moves it}}
    """

    run: Result
    script: Script | None = None
    reason: str = ""
    hands: Mapping[str, Any] = field(default_factory=lambda: {"hands": [], "handOf": {}})


def write_run(run: Result, moving: Sequence[str]) -> OwnRun:
    """Return what the page needs to simulate, or why it cannot; `moving` are the variables that move the picture."""
    if len(run.time) < 2 or not len(run.trajectory.segments[0].time):
        return OwnRun(run, reason="the run has fewer than two output times")
    try:
        script = write_script(run.trajectory)
    except NotWritten as error:
        return OwnRun(run, reason=str(error))
    if _size(script) > MOST_SCRIPT:
        size = f"{_size(script) / 1e6:.1f} MB"
        return OwnRun(run, reason=f"the scene is too large to be simulated in a page (its equations take {size})")
    return _with_hands(run, moving) or OwnRun(run, script)


def _with_hands(run: Result, moving: Sequence[str]) -> OwnRun | None:
    """Return the run in which nodes of the picture can be pulled; None where that cannot be had."""
    found = run_with_hands(run, moving)
    if found is None:
        return None
    held, hands, places = found
    try:
        script = write_script(held.trajectory)
    except NotWritten:
        return None  # the scene runs in a page, but not with springs at its nodes
    if _size(script) > MOST_SCRIPT:
        return None
    data = {"hands": hands_data(hands, script.registers), "handOf": places}
    slots, registers = (of_origin(numbers, run, held) for numbers in (script.slots, script.registers))
    return OwnRun(held, replace(script, slots=slots, registers=registers), hands=data)


def _size(script: Script) -> int:
    return len(json.dumps(script.data))


def script_data(run: Result, own: OwnRun) -> dict[str, Any]:
    """Return what the page reads of its own simulation, or the reason why there is none."""
    if own.script is None:
        return {"reason": own.reason, "parameters": [], "held": [], "names": [], **own.hands}
    found = sliders(run.trajectory.observer, own.script.slots, MOST_SLIDERS)
    order = sorted(found, key=lambda s: bool(s.fixed))
    parameters = [asdict(s) | {"unit": unit_shown(s.unit)} for s in order]
    return own.script.data | {"reason": "", "parameters": parameters, **own.hands}


def unit_shown(unit: str) -> str:
    """Return a unit as it is shown: nothing for a number."""
    return unit_text(unit) if unit not in ("", "1") else ""
