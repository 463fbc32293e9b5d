"""Pictures from the command line: what Python draws, the command line draws as well."""

from pathlib import Path

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
