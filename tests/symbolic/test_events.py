"""Derivations of models with events: equations as they are written, discrete variables at their start."""

import pytest
import sympy

import lmoc

SPRING = """model Two parameter Real k = 4; Real q(start = 0, fixed = true), v(start = 1, fixed = true);
  discrete Real level(start = 3); equation der(q) = v; der(v) = if q > 1 then -k*q else -level*q;
  when time > 1 then level = 5; end when; end Two;"""


def test_equations_are_those_that_are_written() -> None:
    text = str(lmoc.compile_text(SPRING).equations())
    assert "q > 1" in text and "active" not in text and "pre(" not in text


def test_a_linear_model_holds_discrete_variables() -> None:
    model = lmoc.compile_text(SPRING)
    assert sorted(abs(z) for z in model.linearize(at={"q": 0, "v": 0}).eigenvalues) == pytest.approx([3**0.5] * 2)
    assert sorted(abs(z) for z in model.linearize(at=2.0).eigenvalues) == pytest.approx([5**0.5] * 2)


def test_the_right_hand_side_in_symbols() -> None:
    ode = lmoc.compile_text(SPRING).symbolic_ode()
    q, k = sympy.Symbol("q"), sympy.Symbol("k")
    assert ode["v"].subs({q: 2}) == -2 * k
