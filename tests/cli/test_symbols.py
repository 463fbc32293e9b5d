"""The verbs equations, equilibria, linearize and transfer."""

import json

import numpy as np
import pytest
from conftest import ROOT

NOTES = ROOT / "models/notes"


def test_equations(lmoc, scene):
    answer = lmoc("equations", scene)
    assert answer.code == 0
    assert "m·ẍ + k·x = f" in answer.out
    assert "x  body.q" in answer.out


def test_equations_in_ascii(lmoc, scene):
    out = lmoc("equations", scene, "--ascii").out
    assert "m*x'' + k*x = f" in out and out.isascii()
    out = lmoc("equations", scene, "--ascii", "--about-equilibrium").out
    assert "m*delta_x'' + k*delta_x = f" in out and out.isascii()


def test_equations_in_latex(lmoc, scene):
    out = lmoc("equations", scene, "--latex").out
    assert r"m \, \ddot{x} + k \, x &= f" in out


def test_equations_as_data(lmoc, scene):
    data = json.loads(lmoc("equations", scene, "--json").out)
    assert data["equations"][0]["coordinate"] == "body.q"
    assert data["abbreviations"]["x"] == "body.q"


def test_equations_as_a_page(lmoc, scene):
    out = lmoc("equations", scene, "--html").out
    assert out.startswith("<!DOCTYPE html>") and "<mover accent='true'>" in out and "where the body is" not in out[:200]


def test_equations_with_forces(lmoc):
    out = lmoc("equations", NOTES / "ex08_cable_around_cylinder.lmo", "--with-forces").out
    assert "T = f + g·m - m·r·θ̈" in out


def test_gravity_disappears_about_the_equilibrium(lmoc):
    out = lmoc("equations", NOTES / "ex05_suspension.lmo", "--about-equilibrium").out
    equations = [line for line in out.splitlines()[1:] if " = " in line]
    assert len(equations) == 2 and not any("g·" in line for line in equations)


def test_other_coordinates(lmoc):
    out = lmoc("equations", NOTES / "ex09_gear_pair_with_load.lmo", "--states", "gear2.theta").out
    assert "gear2.theta" in out.splitlines()[0]


def test_equilibria(lmoc, scene):
    out = lmoc("equilibria", scene).out
    assert "x = f/k" in out and "stability: stable" in out


def test_equilibria_with_an_input(lmoc, scene):
    data = json.loads(lmoc("equilibria", scene, "--input", "f=4", "--json").out)
    assert data[0]["values"]["body.q"] == "4/k" and data[0]["stability"] == "stable"


def test_family_of_equilibria(lmoc):
    out = lmoc("equilibria", NOTES / "s8_gears.lmo").out
    assert "family" in out and "only if N·τ1 + τ2 = 0" in out


def test_linearize(lmoc, scene):
    data = json.loads(lmoc("linearize", scene, "--json").out)
    assert np.allclose(data["A"], [[0, 1], [-4, 0]]) and np.allclose(data["frequencies"], 2)


def test_linearize_tells_the_modes(lmoc, scene):
    out = lmoc("linearize", scene).out
    assert "0.31831" in out and "rad/s" in out and "stable" in out


def test_linearize_in_symbols(lmoc, scene):
    out = lmoc("linearize", scene, "--symbolic").out
    assert "-k/" in out


def test_linearize_into_a_file(lmoc, scene, tmp_path):
    assert lmoc("linearize", scene, "-o", "model.npz").code == 0
    assert np.allclose(np.load(tmp_path / "model.npz")["A"], [[0, 1], [-4, 0]])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--at", "soon"], "neither a time"),
        (["--at", "body.x=1"], "neither a state nor an input"),
        (["--at", "position=1"], "neither a state nor an input\n  = hint: there are body.q, body.v"),
        (["-o", "model.txt"], ".mat, .npz"),
        (["--output", "body.w"], "no variable 'body.w'"),
        (["--output", "body.m"], "is a parameter"),
        (["-o", "nowhere/model.mat"], "there is no folder"),
        (["--plot", "nowhere/model.png"], "there is no folder"),
        (["--plot", "model.mat"], ".png, .svg, .pdf"),
        (["--symbolic", "-o", "model.mat"], "a file holds numbers"),
        (["--at", "-1"], "the run starts at 0 s"),
        (["--at", "1", "--input", "f=2"], "its own inputs"),
        (["--at", "1", "--equilibrium", "1"], "exclude each other"),
        (["--equilibrium", "2"], "no equilibrium 2: one was found"),
        (["--equilibrium", "0"], "at least 1"),
        (["--states", "body.w"], "no variable 'body.w' to be a state"),
    ],
)
def test_linearize_refuses(lmoc, scene, words, message):
    answer = lmoc("linearize", scene, *words)
    assert answer.code == 2 and message in answer.err


def test_transfer(lmoc, scene):
    out = lmoc("transfer", scene, "f", "x").out
    assert out.startswith("x/f = 1/(") and "s² + k)" in out and "poles: ±2i" in out


def test_transfer_with_pictures(lmoc, scene, tmp_path):
    assert lmoc("transfer", scene, "f", "x", "--bode", "bode.svg", "--step", "step.png").code == 0
    assert (tmp_path / "bode.svg").stat().st_size > 1000 and (tmp_path / "step.png").stat().st_size > 1000


def test_transfer_as_data(lmoc, scene):
    data = json.loads(lmoc("transfer", scene, "f", "x", "--json").out)
    assert data["cancelled"] == [] and np.allclose(np.abs(np.array(data["poles"])[:, 1]), 2)


def test_transfer_of_an_unknown_input(lmoc, scene):
    answer = lmoc("transfer", scene, "g", "x")
    assert answer.code == 2 and "no input 'g'" in answer.err


def test_too_large_for_symbols(lmoc):
    answer = lmoc("equations", ROOT / "models/bench/chain.lmo", "--set", "N=500")
    assert answer.code == 2 and "too many" in answer.err


def test_forms_of_output_exclude_each_other(lmoc, scene):
    answer = lmoc("equations", scene, "--latex", "--json")
    assert answer.code == 2 and "not allowed with" in answer.err


LEVER = NOTES / "s9_lever_large_angles.lmo"


def test_several_equilibria_are_listed_with_the_way_to_choose(lmoc):
    answer = lmoc("transfer", LEVER, "tau", "theta")
    assert answer.code == 2 and "(3) body.theta = pi/2" in answer.err and "--equilibrium 1" in answer.err
    assert "equilibrium 3\n  θ = π/2" in lmoc("equilibria", LEVER).out


def test_transfer_about_a_listed_equilibrium(lmoc):
    assert "linear about θ_body = 0" in lmoc("transfer", LEVER, "tau", "theta", "--equilibrium", "2").out
    standing = lmoc("transfer", LEVER, "tau", "theta", "--equilibrium", "3").out
    assert "θ/τ = 1/(J·s² - k·l2²)" in standing


def test_equilibria_tell_their_inputs_and_how_they_were_sought(lmoc, tmp_path):
    model = tmp_path / "tank.lmo"
    model.write_text("model Tank Real h(start = 1); input Real u = 1; equation der(h) = u - 0.5*sqrt(h); end Tank;")
    empty = lmoc("equilibria", model).out
    assert "none found by sign changes" in empty
    filled = lmoc("equilibria", model, "--input", "u=1").out
    assert "h = 4" in filled and "for u = 1" in filled


def test_equilibria_of_many_states_are_summed_up(lmoc):
    out = lmoc("equilibria", ROOT / "models/hard/h14_plucked_string.lmo").out
    assert "all 200 states = 0" in out and len(out.splitlines()) < 8


def test_a_scene_without_states_cannot_move_by_itself(lmoc):
    out = lmoc("equilibria", ROOT / "models/hard/h21_prescribed_rotation.lmo").out
    assert "nothing can move by itself" in out and "stable" not in out


def test_numbers_without_minus_zero(lmoc):
    out = lmoc("linearize", NOTES / "s3_1_cubic_spring.lmo").out
    assert "-0\n" not in out and " -0 " not in out


def test_an_undetermined_force_is_no_output(lmoc):
    loop = ROOT / "models/hard/h10_gear_loop.lmo"
    for words in (["linearize", loop, "--output", "mesh1.a.tau"], ["transfer", loop, "tau", "mesh1.a.tau"]):
        answer = lmoc(*words)
        assert answer.code == 2 and "redundant loop" in answer.err


def test_realization_tells_its_states(lmoc):
    assert "less B1·u" in lmoc("linearize", NOTES / "ex05_suspension.lmo", "--realization").out


def test_modes_as_a_picture(lmoc, scene, tmp_path):
    assert lmoc("linearize", scene, "--plot", "modes.png").code == 0
    assert (tmp_path / "modes.png").stat().st_size > 1000


def test_files_hold_the_point_and_what_higher_derivatives_do(lmoc, tmp_path):
    assert lmoc("linearize", ROOT / "models/hard/h21_prescribed_rotation.lmo", "-o", "model.npz").code == 0
    found = np.load(tmp_path / "model.npz")
    assert np.allclose(found["D2"], [[0.0], [0.12]]) and found["u0"].shape == (1,)


def test_deviations_from_one_of_several_equilibria(lmoc):
    assert "--equilibrium N" in lmoc("equations", LEVER, "--about-equilibrium").err
    standing = lmoc("equations", LEVER, "--equilibrium", "3").out
    assert "- k·l2²·" in standing and "δθ" in standing
    assert lmoc("equations", LEVER, "--equilibrium", "5").code == 2


WELL = """
model Well
  parameter Real m = 1, a = 2, b = 3;
  input Real u = 0; output Real y = mass.q;
  Mass mass(m = m); Spring s(k = -a); CubicSpring cs(k = b); Force f(f = u); Fixed w;
equation
  connect(w.flange, s.a); connect(w.flange, cs.a);
  connect(s.b, mass.flange); connect(cs.b, mass.flange); connect(f.flange, mass.flange);
end Well;
"""
HEAVY = """
model Heavy
  parameter Real k = 3, m = 2, g = 9;
  Fixed w; CubicSpring s(k = k); Mass b(m = m, g = g);
equation
  connect(w.flange, s.a); connect(s.b, b.flange);
end Heavy;
"""


def test_deviations_have_no_constants(lmoc, tmp_path):
    """(δ + e)³ with b·e² = a: the constants cancel, the linear term is that of the linear model."""
    (tmp_path / "well.lmo").write_text(WELL)
    lines = lmoc("equations", tmp_path / "well.lmo", "--equilibrium", "3").out.splitlines()
    assert lines[0] == "Well: 1 equation of motion in deviations from the equilibrium y = sqrt(a/b)"
    assert lines[2] == "m·δÿ + 2·a·δy + 3·b·sqrt(a/b)·δy² + b·δy³ = u"
    assert "δy  deviation of mass.q" in lines[-1]
    (tmp_path / "heavy.lmo").write_text(HEAVY)
    lines = lmoc("equations", tmp_path / "heavy.lmo", "--about-equilibrium").out.splitlines()
    assert lines[2].startswith("m·δq̈ + ") and lines[2].endswith("3·k·∛(g·m/k)·δq² + k·δq³ = 0")


def test_an_input_that_is_none_is_told_before_anything_else(lmoc, tmp_path):
    (tmp_path / "well.lmo").write_text(WELL)
    answer = lmoc("transfer", tmp_path / "well.lmo", "y", "u")
    assert answer.code != 0 and "there is no input 'y'" in answer.err and "equilibrium" not in answer.err
