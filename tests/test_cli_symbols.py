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
    equations = [line for line in out.splitlines() if " = " in line]
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
        (["-o", "model.txt"], ".mat, .npz"),
        (["--output", "body.w"], "no variable 'body.w'"),
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
