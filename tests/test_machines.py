"""The same scenes wherever they run: the quick part of ``make test-machines`` (`machines.py`)."""

from pathlib import Path

import machines
import pytest
from machines import Machine
from oracles.outcomes import Answer, Case, answer

QUICK = [
    Case(machines.TOGETHER),
    Case(machines.STIFF, rtol=1e-4, stop=1.0),
    *(Case(str(machines.ROOT / f"models/{name}.lmo"), stop=stop)
      for name, stop in (("laws/h06_bungee", None), ("laws/clutch_lock", None), ("hard/h01_cartesian_pendulum", 1.0),
                         ("hard/h28_prothero_robinson", None), ("notes/ex05_suspension", None))),
]  # fmt: skip
OTHERS = (Machine("busy, warm cache", same=True, busy=1, warm=True),
          *(m for m in machines.machines() if m.name in ("Prescott", "SkylakeX")))  # fmt: skip


@pytest.fixture(scope="module")
def first(tmp_path_factory) -> tuple[list[Answer], Path]:
    """What the first machine has given, and its cache."""
    place = tmp_path_factory.mktemp("cache")
    return machines.answers(machines.machines()[0], QUICK, place), place


@pytest.mark.parametrize("machine", OTHERS, ids=lambda machine: machine.name)
def test_another_machine_gives_the_same(machine, first):
    truth, place = first
    found = machines.answers(machine, QUICK, place)
    said = {c.name: machines.differs(c, a, b, machine.same) for c, a, b in zip(QUICK, truth, found, strict=True)}
    assert not any(said.values()), said
    assert any(a.events for a in truth) and all(a.outcome == "ok" and a.signals for a in truth)


@pytest.mark.parametrize(
    ("name", "rtol", "stop"),
    [("laws/h06_bungee", 1e-4, None), ("hard/h03_four_bar", 1e-4, 0.5), ("hard/h28b_stiff_mount", 1e-9, 0.1)],
)
def test_runs_before_change_no_bit(name, rtol, stop):
    """A first, a second run, and one after runs of the same scene by other methods."""
    case = Case(str(machines.ROOT / f"models/{name}.lmo"), "again", rtol, stop=stop)
    found = answer(case)
    assert found.outcome == "ok" and len(found.bits) == 3 and machines.repeats(case, found) == ""


def test_what_differs_is_noticed():
    case, own = Case("model M end M;"), Answer("ok", [["when", "c"]], [1.0], {"x": [1.0, 2.0]}, {"x": 2.0}, ["a"])

    def said(**changed) -> list[str]:
        other = Answer(**(vars(own) | changed))
        return [machines.differs(case, own, other, same) for same in (True, False)]

    assert said() == ["", ""]
    assert said(bits=["b"], signals={"x": [1.0, 2.0 + 1e-5]}) == ["other bits, values by 5e-06", ""]
    assert "values differ" in said(signals={"x": [1.0, 2.001]}, bits=["b"])[1]
    assert "values differ" in said(signals={"x": [1.0, float("nan")]}, bits=["b"])[1]
    assert "values differ" in said(instants=[1.01], bits=["b"])[1]
    assert all("events" in text for text in said(events=[["time", "c"]]))
    assert all("in place of ok" in text for text in said(outcome="SimulationError"))
    again = Case("model M end M;", "again")
    assert machines.repeats(again, Answer("ok", [], [], {}, {}, ["a", "b", "a", "b", "a", "c"]))
    assert not machines.repeats(again, Answer("ok", [], [], {}, {}, ["a", "b", "a", "b", "a", "b"]))
