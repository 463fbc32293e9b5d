"""Radau IIA in C: closed forms for matrices of each kind, functions of Python, and what these raise."""

import numpy as np
import pytest

import lmoc

ROW = """model Row
  Fixed wall;
  Spring s[{n}](k = {{{k}}});
  Damper d[{n}](each c = 0.02);
  Mass m[{n}](each m = 1, each q(start = 1, fixed = true), each v(start = 0, fixed = true));
equation
  for i in 1:{n} loop
    connect(wall.flange, s[i].a);
    connect(s[i].b, m[i].flange);
    connect(wall.flange, d[i].a);
    connect(d[i].b, m[i].flange);
  end for;
  annotation(experiment(StopTime = 2));
end Row;
"""


@pytest.mark.parametrize("n", [3, 13, 41, 101])
def test_oscillators_beside_each_other_swing_as_they_must(n):
    """By a matrix in C, the inverse, LAPACK's factors and sparse ones."""
    k = np.linspace(1.0, 60.0, n)
    run = lmoc.compile_text(ROW.format(n=n, k=", ".join(map(str, k)))).simulate(solver="radau", rtol=1e-7, points=21)
    damping, omega = 0.01, np.sqrt(k - 0.01**2)
    for i in (0, n // 2, n - 1):
        t = run.time
        expected = np.exp(-damping * t) * (np.cos(omega[i] * t) + damping / omega[i] * np.sin(omega[i] * t))
        assert run[f"m[{i + 1}].q"] == pytest.approx(expected, abs=2e-5)


PUSHED = """model Pushed
  input Real f;
  Force push(f = f);
  Damper d(c = 1e4);
  Fixed wall;
  Mass m(m = 1, q(start = 0, fixed = true), v(start = 0, fixed = true));
equation
  connect(push.flange, m.flange);
  connect(wall.flange, d.a);
  connect(d.b, m.flange);
  annotation(experiment(StopTime = 1));
end Pushed;
"""


def test_an_input_that_python_gives_is_asked_for_at_each_stage():
    run = lmoc.compile_text(PUSHED).simulate(solver="radau", rtol=1e-8, inputs={"f": lambda t: 1e4 * t})
    t, rate = run.time, 1e4
    expected = t**2 / 2 - t / rate + (1 - np.exp(-rate * t)) / rate**2  # q' + q''/rate = t
    assert run["m.q"] == pytest.approx(expected, abs=1e-8)


def test_what_an_input_raises_comes_through():
    def push(t: float) -> float:
        if t > 0.5:
            raise ZeroDivisionError("no more push")
        return 1.0

    with pytest.raises(Exception, match="no more push"):
        lmoc.compile_text(PUSHED).simulate(solver="radau", inputs={"f": push})
