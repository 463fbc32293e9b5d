"""Pictures from the command line: what Python draws, the command line draws as well."""

import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from lmoc.cli.main import main

MODELS = Path(__file__).parents[2] / "models"
SCENE = str(MODELS / "notes" / "ex02_spring_mass_damper.lmo")


def test_curves_portraits_and_spectra(tmp_path, capsys):
    curves, portrait, amplitudes = (tmp_path / name for name in ("curves.svg", "portrait.svg", "amplitudes.svg"))
    call = ["run", SCENE, "--stop", "1", "--show", "mass.q,mass.v", "--plot", str(curves)]
    assert main([*call, "--phase", str(portrait), "--spectrum", str(amplitudes)]) == 0
    told = capsys.readouterr().out
    for path, what in ((curves, "picture"), (portrait, "phase portrait"), (amplitudes, "spectrum")):
        assert f"{what} written to {path}" in told and path.read_text().lstrip().startswith("<?xml")


def test_the_root_locus_of_a_study(tmp_path, capsys):
    picture = tmp_path / "roots.svg"
    assert main(["run", SCENE, "--stop", "1", "--set", "k=10:10:30", "--root-locus", str(picture)]) == 0
    assert f"root locus written to {picture}" in capsys.readouterr().out and picture.stat().st_size > 1000


def test_forces_on_free_bodies_at_a_time(tmp_path):
    still, later = tmp_path / "still.svg", tmp_path / "later.svg"
    assert main(["draw", SCENE, "--free-body", "-o", str(still), "--quiet"]) == 0
    assert main(["draw", SCENE, "--free-body", "--at", "0.5", "-o", str(later), "--quiet"]) == 0
    assert still.read_text() != later.read_text()


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (["run", SCENE, "--root-locus", "roots.svg"], "several values"),
        (["run", SCENE, "--set", "k=10:10:30", "--phase", "p.svg"], "one value"),
        (["run", SCENE, "--phase", "p.svg", "--show", "mass.q"], "not 1"),
        (["run", SCENE, "--plot", "p.svg", "--show", "mass.qq"], "no variable 'mass.qq'"),
        (["run", SCENE, "--spectrum", "p.txt"], "E0624"),
        (["draw", SCENE, "-o", "p.svg", "--at", "1"], "free-body"),
    ],
)
def test_what_cannot_be_drawn_is_refused(options, word, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(options) == 2
    assert word in capsys.readouterr().err and not list(tmp_path.iterdir())


SPRING = """model {name} Fixed wall; Spring s(k = {k}); Mass m(m = 1, q(start = 1, fixed = true)); output Real x = m.q;
equation connect(wall.flange, s.a); connect(s.b, m.flange); {more} end {name};"""


def test_runs_of_several_scenes_over_each_other(tmp_path, capsys):
    """cos t and cos 2t differ by their largest value, 9/8 at cos t = 1/4, and 2 at t = π."""
    soft, hard = tmp_path / "soft.lmo", tmp_path / "hard.lmo"
    soft.write_text(SPRING.format(name="Soft", k=1, more=""))
    hard.write_text(SPRING.format(name="Hard", k=4, more=""))
    picture = tmp_path / "both.svg"
    options = ["--stop", "4", "--points", "4001", "--plot", str(picture), "--json"]
    assert main(["compare", str(soft), str(hard), *options]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert (row["run"], row["variable"]) == ("hard", "x")
    assert row["largest"] == pytest.approx(2, abs=1e-5) and row["time"] == pytest.approx(np.pi, abs=2e-3)
    assert "soft" in picture.read_text() and "hard" in picture.read_text()


def test_comparisons_that_cannot_be_made_are_refused(tmp_path, capsys):
    one, other = tmp_path / "one.lmo", tmp_path / "other.lmo"
    one.write_text(SPRING.format(name="One", k=1, more=""))
    other.write_text("model Other Real y(start = 1, fixed = true); equation der(y) = -y; end Other;")
    assert main(["compare", str(one)]) == 2
    assert main(["compare", str(one), str(other)]) == 2
    assert "have none of x" in capsys.readouterr().err
    assert main(["compare", str(one), str(other), "--show", "m.q"]) == 2
    assert "other.lmo has no variable 'm.q'" in capsys.readouterr().err


def test_a_run_that_breaks_off_is_compared_as_far_as_it_goes(tmp_path, capsys):
    whole, short = tmp_path / "whole.lmo", tmp_path / "short.lmo"
    whole.write_text("model Whole Real x(start = 1, fixed = true); equation der(x) = 0; end Whole;")
    short.write_text("model Short Real x(start = 1, fixed = true); equation der(x) = x^2; end Short;")
    assert main(["compare", str(whole), str(short), "--stop", "2"]) == 3
    told = capsys.readouterr()
    assert "short.lmo: the run stopped at t = 1 s" in told.err and "differences from whole" in told.out


def test_a_study_says_which_runs_broke_off_and_why(tmp_path, capsys):
    path = tmp_path / "short.lmo"
    path.write_text(
        "model Short parameter Real k = 1; Real x(start = 1, fixed = true); equation der(x) = k*x^2; end Short;"
    )
    assert main(["run", str(path), "--stop", "2", "--set", "k=0.25:0.5:1"]) == 3
    told = capsys.readouterr()
    assert "k = 0.75: the run stopped at t = 1.33" in told.err and "k = 0.25" not in told.err
    assert "False" in told.out


def test_names_with_markup_stay_text_in_the_pictures_of_several_runs(tmp_path):
    """XML of the pictures is read: a name is never an element of it."""
    hostile = """
model Hostile "A <b>scene</b> & \\"quotes\\" </svg><script>alert(1)</script>"
  parameter Real 'k<script>alert(1)</script>'(unit = "N/m") = 10;
  output Real 'q"<svg onload=alert(2)>&'(unit = "m") = mass.q;
  output Real root = sqrt(mass.q);
  Fixed wall;
  Mass mass(m = 1, q(start = 0.2, fixed = true), v(start = 0, fixed = true));
  Spring spring(k = 'k<script>alert(1)</script>');
equation
  connect(wall.flange, spring.a);
  connect(spring.b, mass.flange);
end Hostile;
"""
    one, other = tmp_path / "one.lmo", tmp_path / "<img src=x>&ü.lmo"
    one.write_text(hostile)
    other.write_text(hostile.replace("= 10;", "= 40;"))
    drawn = [tmp_path / "compared.svg", tmp_path / "study.svg"]
    assert main(["compare", str(one), str(other), "--stop", "1", "--quiet", "--plot", str(drawn[0])]) == 0
    varied = "'k<script>alert(1)</script>'=10:20:50"
    assert main(["run", str(one), "--stop", "1", "--quiet", "--set", varied, "--plot", str(drawn[1])]) == 0
    for path in drawn:
        names = {element.tag.rpartition("}")[2] for element in ElementTree.parse(path).iter()}
        assert "svg" in names and not names & {"script", "img", "b"}
