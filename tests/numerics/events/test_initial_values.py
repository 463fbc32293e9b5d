"""Initial equations of discrete variables: in the order in which they need each other, also of continuous variables."""

from __future__ import annotations

import pytest

import lmoc

HELD = """model M
  Real u = 0.5 + sin(time);
  Real x(start = 2, fixed = true);
  Real y = a + x;
  Real past;
  {declared}
initial equation
  {initial}
equation
  der(x) = -x;
  when sample(0.05, 0.1) then
    a = u;
    past = time;
  end when;
end M;"""


def text(initial: str, declared: str = "Real a;") -> str:
    return HELD.format(initial=initial, declared=declared)


@pytest.mark.parametrize(
    ("initial", "a", "past"),
    [
        ("pre(a) = past; pre(past) = 0.5;", 0.5, 0.5),
        ("a = pre(past); 0.3 = past;", 0.3, 0.3),
        ("pre(a) = u;", 0.5, 0.0),
        ("a = 2*x + time;", 4.0, 0.0),
        ("pre(a) = x + pre(past); past = x;", 4.0, 2.0),
        ("pre(a) = min(y + 1, 3) - x;", 1.0, 0.0),  # y = a + x: found in turns
        ("pre(a) = if x > 1 and u < 1 then 7 else 8;", 7.0, 0.0),
        ("pre(a) = der(x) - 1;", -3.0, 0.0),
        ("pre(a) = 2*der(u) + x;", 4.0, 0.0),
    ],
)
def test_what_is_held_begins_with_its_initial_equation(initial: str, a: float, past: float) -> None:
    run = lmoc.compile_text(text(initial)).simulate(stop=0.04)
    assert (run["a"][0], run["past"][0], run["x"][0]) == (a, past, 2)
    assert run["y"][0] == pytest.approx(a + 2)
    assert run["a"][-1] == a


def test_a_state_follows_what_is_held() -> None:
    run = lmoc.compile_text(text("x = a;", "Real a(start = 3);").replace(", fixed = true", "")).simulate(stop=0.04)
    assert (run["a"][0], run["x"][0]) == (3, 3)


@pytest.mark.parametrize(
    ("initial", "declared", "code"),
    [
        ("2*pre(a) = 1;", "Real a;", "E0423"),
        ("pre(a) = 1; a = 2;", "Real a;", "E0254"),
        ("a = 3;", "Real a(start = 2, fixed = true);", "E0254"),
        ("pre(a) = x;", "Real a(start = 3, fixed = true);", "E0531"),
        ("high = true;", "Real a; Boolean high = x > 3;", "E0254"),
        ("pre(a) = past; past = a;", "Real a;", "E0422"),
        ("pre(a) = y + 1;", "Real a;", "E0535"),
        ("2*pre(a) = der(x);", "Real a;", "E0531"),
    ],
)
def test_what_contradicts_is_told(initial: str, declared: str, code: str) -> None:
    with pytest.raises((lmoc.ModelError, lmoc.SimulationError)) as raised:
        lmoc.compile_text(text(initial, declared)).simulate(stop=0.04)
    assert [d.code for d in raised.value.diagnostics if d.severity == "error"] == [code]


def test_who_runs_it_cannot_give_what_an_initial_equation_gives() -> None:
    with pytest.raises(lmoc.ModelError, match="has an initial equation"):
        lmoc.compile_text(text("pre(a) = u;")).simulate(stop=0.04, initial={"a": 1})
