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


def test_a_stiff_state_is_known_as_well_late_in_a_long_run() -> None:
    """v follows a square wave within 1e-10 s and crosses 0.5 at each edge, 1e-3 on either side.

    Its rate is a difference of terms of 5e9, known to 5e-7 alone: over 1990 s that would add up to 2e-3.
    """
    run = lmoc.compile_text(
        """model M Real v(start = 0.499, fixed = true); Integer n(start = 0, fixed = true);
        equation der(v) = 1e10*(0.5 + (if mod(time, 200) < 100 then 1e-3 else -1e-3) - v);
        when v > 0.5 then n = pre(n) + 1; end when; end M;"""
    ).simulate(times=[50, 350, 1150, 1990])
    assert run["n"] == pytest.approx([1, 2, 6, 10])
    assert run["v"] == pytest.approx([0.501, 0.499, 0.499, 0.499], abs=1e-6)


@pytest.mark.parametrize(
    "solver, rate, drive, rtol, crossings",
    [
        ("auto", 1e6, "0.3*time", 1e-4, 1),
        ("cvode", 1e10, "1.5 + 1e-3*cos(time)", 1e-9, 1),
        ("auto", 1e8, "if time < 9.999 then 1.4 else 1.5 + 0.1*sin(62831.853071795865*(time - 9.999))", 1e-6, 10),
    ],
)
def test_a_stiff_state_crosses_a_level_as_often_as_what_it_follows(solver, rate, drive, rtol, crossings) -> None:
    """What a step may be off by is no crossing; what the drive does within a moment is one."""
    run = lmoc.compile_text(
        f"""model M Real v; Integer n(start = 0, fixed = true); initial equation v = {drive};
        equation der(v) = {rate}*(({drive}) - v); when v > 1.5 then n = pre(n) + 1; end when; end M;"""
    ).simulate(stop=10, points=2, rtol=rtol, solver=solver)
    assert run["n"][-1] == crossings
