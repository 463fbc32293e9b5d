"""The way to the start from a simplified model (Modelica specification, 3.7.4.4)."""

import numpy as np
import pytest

import lmoc
from lmoc.numerics.run import simulate
from lmoc.numerics.start.constant_way import stays

SCHMITT = """model Schmitt
  parameter Real side = 1;
  output Real y;
  Real c(start = 0, fixed = true);
equation
  der(c) = y;
  y = homotopy(if 50*(y - c) > 1 then 1 elseif 50*(y - c) < -1 then -1 else 50*(y - c), side);
end Schmitt;
"""


def start(text: str, **options: object) -> tuple[float, list[str]]:
    """Return y at the start, and the codes of the notes."""
    run = lmoc.compile_text(text).simulate(stop=0.1, **options)
    return float(run["y"][0]), [d.code for d in run.notes]


@pytest.mark.parametrize("side", [1, -1])
def test_the_simplified_model_follows_its_parameters(side: int) -> None:
    assert start(SCHMITT, parameters={"side": side})[0] == pytest.approx(side)


def test_a_run_that_is_repeated_begins_at_the_same_place() -> None:
    dae = lmoc.compile_text(SCHMITT)
    runs = [dae.simulate(stop=0.1, parameters={"side": side})["y"] for side in (1, -1, 1)]
    assert np.array_equal(runs[0], runs[2]) and runs[1][0] == pytest.approx(-1)


def test_a_way_that_ends_is_said() -> None:
    text = "model M output Real y(start = 1); equation y^3 - y = homotopy(0, 1e3 - y + log(-1 - abs(y))); end M;"
    y, codes = start(text)
    assert y in (pytest.approx(-1), pytest.approx(0), pytest.approx(1)) and "N0543" in codes


def test_the_weight_is_no_parameter() -> None:
    assert list(lmoc.compile_text(SCHMITT).parameters) == ["side"]


LIMITED = """model Limited
  parameter Real high = 2, k = 3;
  Real x(start = 1);
  output Real y;
equation
  der(x) = -k*x + y;
  y = homotopy(if 2 - x > high then high elseif 2 - x < -high then -high else 2 - x, 2 - x);
initial equation
  der(x) = 0;
end Limited;
"""


@pytest.mark.parametrize(("high", "first", "way"), [(2.0, 1.5, [True]), (0.9, 0.9, [False])])
def test_where_nothing_limits_the_way_is_not_walked(
    high: float, first: float, way: list[bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In rest k*x = y: x = 2/(k + 1) within the limits, high/k at them."""
    asked: list[bool] = []
    monkeypatch.setattr(simulate, "stays", lambda *given: asked.append(stays(*given)) or asked[-1])
    run = lmoc.compile_text(LIMITED).simulate(stop=0.1, parameters={"high": high})
    assert run["y"] == pytest.approx(first) and run["x"] == pytest.approx(first / 3) and asked == way
