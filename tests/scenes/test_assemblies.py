"""Which way a closed loop is put together at the start: nearest to the guesses, told where nothing chooses."""

import numpy as np
import pytest
from oracles.assemblies import check

import lmoc

FOURBAR = """model Fourbar
  import Planar.*;
  inner World world(g = 0);
  Ground g1, g2(x = 1);
  Revolute A(phi(start = 1, fixed = true), omega(start = 2, fixed = true)), B{B}, C{C}, D{D};
  Bar a(l = 0.5, m = 1), b(l = 1.2, m = 1), c(l = 0.9, m = 1);
equation
  connect(g1.frame, A.a); connect(A.b, a.a); connect(a.b, B.a); connect(B.b, b.a); connect(b.b, C.a);
  connect(C.b, c.b); connect(c.a, D.b); connect(D.a, g2.frame);
end Fourbar;"""
# the rocker stands above the ground, or below it: the circles about its foot and about the crank's end meet twice
CRANK = 0.5 * np.array([np.cos(1), np.sin(1)])
DISTANCE = np.hypot(1 - CRANK[0], CRANK[1])
TOWARDS = np.arctan2(CRANK[1], CRANK[0] - 1)
HALF = np.arccos((DISTANCE**2 + 0.9**2 - 1.2**2) / (2 * DISTANCE * 0.9))
ABOVE, BELOW = TOWARDS - HALF, TOWARDS + HALF - 2 * np.pi


def fourbar(**guesses: float) -> str:
    return FOURBAR.format(**{k: f"(phi(start = {guesses[k]}))" if k in guesses else "" for k in "BCD"})


def notes(run) -> list[str]:
    return [d.code for d in run.notes if d.code in ("N0533", "W0533", "N0539")]


@pytest.mark.parametrize("seed", [3, 8, 11, 841, 1096])
def test_a_random_linkage_starts_where_it_closes_nearest_to_its_guesses(seed):
    """`tests/many_assemblies.py` tries hundreds."""
    check(seed)


def test_with_nothing_fixed_it_starts_nearest_to_all_guesses():
    """Gauss–Newton steps overshoot here, to 7.49, -6.89, 1.16, 1.76; in `check` the crank is moved through a turn."""
    text = fourbar(B=0.0, C=0.0, D=0.1).replace("start = 1, fixed = true), omega(start = 2, fixed = true", "start = 3")
    text = text.replace("l = 0.5", "l = 0.3").replace("l = 0.9", "l = 0.8").replace("l = 1.2", "l = 0.9")
    run = lmoc.compile_text(text).simulate(times=[0.0])
    missed = sum((run[f"{k}.phi"][0] - guess) ** 2 for k, guess in zip("ABCD", (3.0, 0.0, 0.0, 0.1), strict=True))
    assert notes(run) == ["N0533"]
    assert missed == pytest.approx(7.673153105682, abs=1e-9)  # the least of 20,001 angles of the crank, refined
    check(27, free=True)


def test_states_without_a_guess_do_not_take_one_from_what_has_it():
    """Each of two states could be at zero, but not both: C.phi was 1e-5 for that, or nothing closed (E0535)."""
    text = fourbar(C=0.7).replace("(phi(start = 1, fixed = true), omega(start = 2, fixed = true))", "")
    text = text.replace("l = 0.9, m = 1)", "l = 0.8, m = 1), d(l = 0.5, m = 1)").replace("l = 1.2", "l = 0.8")
    further = "connect(D.a, d.b); connect(d.a, E.b); connect(E.a, g2.frame)"
    text = text.replace(" D;", " D, E;").replace("connect(D.a, g2.frame)", further)
    run = lmoc.compile_text(text).simulate(times=[0.0])
    a, b, c, d = np.cumsum([run[f"{k}.phi"][0] for k in "ABCD"]) - [0, 0, 0, 2 * run["D.phi"][0]]
    assert (run["C.phi"][0], notes(run)) == (pytest.approx(0.7, abs=1e-12), [])
    assert np.dot([0.5, 0.8, -0.8, -0.5], np.exp(1j * np.array([a, b, c, d]))) == pytest.approx(1, abs=1e-9)


FIVE = """model Five
      import Planar.*;
      inner World world(g = 0);
      Ground l, r(x = 1);
      Revolute A{A}, B{B}, C{C}, D{D}, E{E};
      Bar a(l = 0.5, m = 1), b(l = 0.8, m = 1), c(l = 0.8, m = 1), d(l = 0.5, m = 1);
    equation
      connect(l.frame, A.a); connect(A.b, a.a); connect(a.b, B.a); connect(B.b, b.a); connect(b.b, C.a);
      connect(C.b, c.a); connect(c.b, D.a); connect(D.b, d.a); connect(d.b, E.a); connect(E.b, r.frame);
    {equation}
    end Five;"""


def five(equation: str = "", fixed: str = "", **guesses: float) -> str:
    held = {k: ", fixed = true" if k == fixed else "" for k in "ABCDE"}
    pins = {k: f"(phi(start = {guesses[k]}{held[k]}))" if k in guesses else "" for k in "ABCDE"}
    return FIVE.format(equation=equation, **pins)


def test_what_a_guess_leaves_open_is_nearest_to_zero():
    run = lmoc.compile_text(five(D=-1.2)).simulate(times=[0.0])
    assert run["D.phi"][0] == pytest.approx(-1.2, abs=1e-12)
    squares = sum(run[f"{k}.phi"][0] ** 2 for k in "ABCE")
    assert squares == pytest.approx(8.555636, abs=1e-5)  # the least of 20,001 angles of A, by circles


def test_beside_an_initial_equation_guesses_are_met_as_beside_a_fixed_value():
    """The start went on from the nearest place by Gauss–Newton steps, and ended elsewhere or nowhere (E0535)."""
    guesses = dict(B=0.3, C=0.2, D=-0.1, E=0.4)
    one = lmoc.compile_text(five("initial equation A.phi = 0.5;", A=2.5, **guesses)).simulate(times=[0.0])
    other = lmoc.compile_text(five(fixed="A", A=0.5, **guesses)).simulate(times=[0.0])
    assert [one[f"{k}.phi"][0] for k in "ABCDE"] == pytest.approx([other[f"{k}.phi"][0] for k in "ABCDE"], abs=1e-8)


def test_a_parallelogram_of_three_cranks_starts_nearest_to_its_guesses():
    """It was kept where the redundant loop was found to close: at 1.005."""
    text = fourbar(D=0.9).replace("start = 1, fixed = true), omega(start = 2, fixed = true", "start = 1.2")
    bars = "l = 0.5, m = 1), d(l = 1, m = 1), e(l = 0.5, m = 1)"
    text = text.replace("l = 1.2", "l = 1").replace("l = 0.9, m = 1)", bars)
    text = text.replace("g2(x = 1)", "g2(x = 1), g3(x = 2)").replace(" D(", " E, F, D(")
    further = "connect(b.b, d.a); connect(d.b, E.a); connect(E.b, e.b); connect(e.a, F.b); connect(F.a, g3.frame);"
    run = lmoc.compile_text(text.replace("end Fourbar", f"{further}\nend Fourbar")).simulate(times=[0.0])
    assert [run[f"{pin}.phi"][0] for pin in "ACDEF"] == pytest.approx([1.05] * 5, abs=1e-8)


def test_without_a_guess_the_smallest_angles_are_taken_and_told():
    run = lmoc.compile_text(fourbar()).simulate(times=[0.0])
    assert run["D.phi"][0] == pytest.approx(ABOVE, abs=1e-9)
    assert notes(run) == ["N0539"]
    (note,) = [d for d in run.notes if d.code == "N0539"]
    assert f"D.phi = {ABOVE:.4g}" in note.message and f"D.phi = {BELOW:.4g}" in note.found
    assert "B.phi (start = " in note.hint


@pytest.mark.parametrize(("guess", "place"), [(1.5, ABOVE), (-2.0, BELOW), (4.0, BELOW + 2 * np.pi)])
def test_a_guess_chooses_and_is_explained(guess, place):
    run = lmoc.compile_text(fourbar(D=guess)).simulate(times=[0.0])
    assert run["D.phi"][0] == pytest.approx(place, abs=1e-9)
    assert notes(run) == ["N0533"]


def test_a_guess_that_is_met_needs_no_word():
    run = lmoc.compile_text(fourbar(D=float(BELOW))).simulate(times=[0.0])
    assert run["D.phi"][0] == pytest.approx(BELOW, abs=1e-9) and notes(run) == []


@pytest.mark.parametrize("turns", [-1, 0, 2])
def test_a_guess_of_whole_turns_is_met(turns):
    run = lmoc.compile_text(fourbar(D=float(ABOVE + 2 * np.pi * turns), B=0.0)).simulate(times=[0.0])
    assert run["D.phi"][0] == pytest.approx(ABOVE + 2 * np.pi * turns, abs=1e-9)
    assert abs(run["B.phi"][0]) < np.pi


@pytest.mark.parametrize("angle", [0.3, 2.0, -2.5])
def test_another_start_of_one_run_is_put_together_as_if_the_model_said_so(angle):
    dae = lmoc.compile_text(fourbar(D=-2.0))
    other = lmoc.compile_text(fourbar(D=-2.0).replace("start = 1,", f"start = {angle},"))
    for k in "ABCD":
        given = dae.simulate(times=[0.0], initial={"A.phi": angle})[f"{k}.phi"][0]
        assert given == pytest.approx(other.simulate(times=[0.0])[f"{k}.phi"][0], abs=1e-9)


def test_other_lengths_are_put_together_as_if_the_model_had_them():
    dae = lmoc.compile_text(fourbar(D=-2.0))
    other = lmoc.compile_text(fourbar(D=-2.0).replace("b(l = 1.2", "b(l = 1.35"))
    run, own = dae.simulate(times=[0.0], parameters={"b.l": 1.35}), other.simulate(times=[0.0])
    assert [run[f"{k}.phi"][0] for k in "BCD"] == pytest.approx([own[f"{k}.phi"][0] for k in "BCD"], abs=1e-9)


@pytest.mark.parametrize(("guess", "sign"), [(1.2, 1), (-0.5, -1), (-3.0, -1)])
def test_the_place_of_a_slider_chooses_its_side(guess, sign):
    text = f"""model Slider
      import Planar.*;
      inner World world(g = 0);
      Ground g;
      Revolute A(phi(start = 0.7, fixed = true), omega(start = 1, fixed = true)), B, C;
      Bar crank(l = 0.3, m = 1), rod(l = 0.8, m = 1);
      Prismatic line(s(start = {guess}));
      Body slider(m = 1, J = 1);
    equation
      connect(g.frame, A.a); connect(A.b, crank.a); connect(crank.b, B.a); connect(B.b, rod.a);
      connect(rod.b, C.a); connect(C.b, line.b); connect(line.a, g.frame); connect(line.b, slider.frame);
    end Slider;"""
    run = lmoc.compile_text(text).simulate(times=[0.0])
    place = 0.3 * np.cos(0.7) + sign * np.sqrt(0.8**2 - (0.3 * np.sin(0.7)) ** 2)
    assert run["line.s"][0] == pytest.approx(place, abs=1e-9)
    assert "W0533" not in notes(run) and "N0539" not in notes(run)
