"""Values that are lost between two events, and found again, are told."""

import warnings

import pytest

import lmoc

PULSE = "Real s = if time < 0.3 then 1 elseif time < 0.6 then -1 else 2;"


@pytest.mark.parametrize(
    ("text", "name"),
    [
        (f"{PULSE} output Real y = sqrt(s);", "y"),
        (f"{PULSE} output Real y = 1/(s + 1);", "y"),
        (f"{PULSE} output Real y = log(s);", "y"),
        (f"{PULSE} output Real y = acos(0.9 - 0.2*s);", "y"),
        (
            "discrete Real y(start = 0); equation when time > 0.3 then y = sqrt(-time);"
            " elsewhen time > 0.6 then y = 1; end when;",
            "y",
        ),
        (f"{PULSE} Real x(start = 0, fixed = true); output Real y = sqrt(s)*x; equation der(x) = 1;", "y"),
    ],
)  # fmt: skip
def test_a_value_that_is_lost_between_events(text: str, name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = lmoc.compile_text(f"model M {text} end M;").simulate(stop=1, points=101)
    said = [d for d in run.notes if d.code == "W0537"]
    assert len(said) == 1 and said[0].message.startswith(name)
    assert "t = 0.3" in said[0].message


def test_nothing_is_said_where_nothing_is_lost() -> None:
    run = lmoc.compile_text(f"model M {PULSE} output Real y = if s > 0 then sqrt(s) else 0; end M;").simulate(stop=1)
    assert not [d for d in run.notes if d.code == "W0537"]
