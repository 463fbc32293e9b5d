"""A note says, once, where the law of simultaneous impacts decides between several possible answers."""

import pytest

import lmoc

CRADLE = """
model Cradle
  parameter Real gap = 0, e = 1, first = 1, last = 0;
  Mass m[3](each m = 1, q(start = {0.1*i + gap*i for i in 1:3}, each fixed = true),
    v(start = {if i == 1 then first elseif i == 3 then last else 0 for i in 1:3}, each fixed = true));
  Stop s[2](each L = 0.1, each e = e);
equation
  for i in 1:2 loop
    connect(m[i].flange, s[i].a);
    connect(s[i].b, m[i + 1].flange);
  end for;
end Cradle;
"""
APART = """
model Apart
  Mass m[2](each m = 1, each g = -10, each q(start = 5, fixed = true), each v(start = 0, fixed = true));
  Fixed w[2];
  Stop s[2](each L = 0, each e = 0.5);
equation
  for i in 1:2 loop
    connect(w[i].flange, s[i].a);
    connect(s[i].b, m[i].flange);
  end for;
end Apart;
"""


def notes(run):
    return [d.message for d in run.notes if d.code == "N0558"]


def test_touching_balls():
    run = lmoc.compile_text(CRADLE).simulate(stop=1.0)
    assert [run[f"m[{i}].v"][-1] for i in (1, 2, 3)] == pytest.approx([-1 / 3, 2 / 3, 2 / 3])
    (note,) = notes(run)
    assert note.startswith("'s[1]', 's[2]' are hit at once at t = 0 s")


def test_a_gap_gives_an_order():
    for gap in (1e-12, 1e-3):
        run = lmoc.compile_text(CRADLE).simulate(stop=1.0, parameters={"gap": gap})
        assert [run[f"m[{i}].v"][-1] for i in (1, 2, 3)] == pytest.approx([0, 0, 1]) and not notes(run)


def test_balls_from_both_sides():
    """They reach the one in the middle together: what follows is the same in any order only where nothing is lost."""
    values = {"gap": 0.1, "first": 1.0, "last": -1.0}
    without = lmoc.compile_text(CRADLE).simulate(stop=1.0, parameters=values)
    assert [without[f"m[{i}].v"][-1] for i in (1, 2, 3)] == pytest.approx([-1, 0, 1]) and not notes(without)
    with_loss = lmoc.compile_text(CRADLE).simulate(stop=1.0, parameters=values | {"e": 0.5})
    assert len(notes(with_loss)) == 1


def test_impacts_that_do_not_concern_each_other():
    run = lmoc.compile_text(APART).simulate(stop=1.5)
    assert run.events[0].time == run.events[1].time == pytest.approx(1.0) and not notes(run)


def test_a_plastic_impact_of_touching_bodies():
    """One after the other, again and again, tends to the same as all at once."""
    run = lmoc.compile_text(CRADLE).simulate(stop=1.0, parameters={"e": 0.0})
    assert [run[f"m[{i}].v"][-1] for i in (1, 2, 3)] == pytest.approx([1 / 3] * 3) and not notes(run)
