"""Events of scenes with relations and with variables whose derivatives follow from discrete values."""

import pytest

import lmoc


def test_relations_are_no_part_of_the_motion_that_a_step_is_asked_of() -> None:
    """Forty relations, and a variable that a discrete value scales and whose derivative is in use."""
    run = lmoc.compile_text(
        """model M Real x(start = 0, fixed = true), y, v; Boolean passed[40], late; Integer n(start = 0, fixed = true);
        equation der(x) = 1; y = (if late then 2 else 1)*x; v = der(y); late = time >= 5.5;
        for i in 1:40 loop passed[i] = x > i; end for;
        when {passed[1], passed[2], passed[3], late} then n = pre(n) + 1; end when; end M;"""
    ).simulate(times=[0.5, 2.5, 5, 6])
    assert run["n"] == pytest.approx([0, 2, 3, 4])
    assert run["y"] == pytest.approx([0.5, 2.5, 5, 12])
    assert run["v"] == pytest.approx([1, 1, 1, 2])
