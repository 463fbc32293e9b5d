"""Strips and films of a run, and dimension lines."""

from __future__ import annotations

import os
from math import cos, hypot, sin
from pathlib import Path

import numpy as np
import pytest
from oracles.models import compiled

import lmoc
from lmoc.cli.main import main
from lmoc.view.scene.moving import Moving
from lmoc.view.scene.picture import Label, Picture
from lmoc.view.scene.text import plain

MODELS = Path(__file__).parents[2] / "models"
SHORT = """model Short
  Fixed wall; Spring spring(k = 40); Mass mass(m = 1, q(start = 0.1, fixed = true));
equation
  connect(wall.flange, spring.a); connect(spring.b, mass.flange);
  annotation(experiment(StopTime = 1));
end Short;
"""
CRANK = MODELS / "planar" / "slider_crank.lmo"


def texts(picture: Picture) -> list[str]:
    return [plain(s.text) for _, s, _ in picture.placed() if isinstance(s, Label)]


def test_a_mechanism_is_where_the_run_has_it():
    dae = compiled(MODELS / "planar" / "four_bar.lmo")
    run = dae.simulate(points=31)
    picture = dae.draw().picture
    moving = Moving(picture, run)
    scale = next(m.dx for i in picture.items for e in i.ends for m in e.moves if m.dx)
    for k in (0, 7, 30):
        crank = next(i for i in moving.at(k) if i.part == "crank" and len(i.ends) == 2)
        a, b = crank.ends
        angle = float(run["crank.a.theta"][k])
        length = hypot(b.x - a.x, b.y - a.y)
        assert (b.x - a.x, a.y - b.y) == pytest.approx((length * cos(angle), length * sin(angle)), abs=1e-6)
        assert length == pytest.approx(0.3 * scale)


def test_in_a_schematic_the_largest_excursion_takes_the_room():
    dae = compiled(MODELS / "notes" / "ex05_suspension.lmo")
    run = dae.simulate(points=51)
    picture = dae.draw().picture
    moving = Moving(picture, run)
    frames = np.array([[i.ends[0].y for i in moving.at(k) if i.symbol == "mass"] for k in range(51)])
    ways = np.abs(frames - frames[0])
    others = np.abs(np.array([[e.y for i in moving.at(k) for e in i.ends] for k in range(51)]))
    assert ways.max() > 1 and np.abs(others - others[0]).max() == pytest.approx(picture.room["line"])
    motion = np.column_stack([run["q1"], run["q2"]]) - [run["q1"][0], run["q2"][0]]
    assert ways == pytest.approx(np.abs(motion) * ways.max() / np.abs(motion).max(), abs=1e-9)


def test_a_strip_has_the_instants_asked_for(tmp_path):
    path = tmp_path / "strip.svg"
    assert main(["draw", str(CRANK), "--frames", "5", "-o", str(path), "--quiet"]) == 0
    text = path.read_text()
    assert text.count("t = ") == 5 and text.count('data-part="crank"') >= 5
    run = compiled(CRANK).simulate(points=9)
    picture = compiled(CRANK).draw(frames=3, run=run).picture
    assert [t for t in texts(picture) if t.startswith("t = ")] == [f"t = {run.time[k]:.4g} s" for k in (0, 4, 8)]


@pytest.mark.parametrize("g", [-9.81, 9.81])
def test_a_load_on_a_drum_beside_a_belt_hangs_where_the_drum_takes_it_along(g):
    """Angles count counter-clockwise: a load whose coordinate points up hangs on the right, else on the left."""
    dae = lmoc.compile_text(
        "model S Inertia rotor(J = 1, theta(start = 0, fixed = true), omega(start = 1, fixed = true)), big(J = 1);"
        f"Belt belt(r1 = 0.1, r2 = 0.2); Drum drum(r = 0.1); Mass load(m = 1, g = {g}); equation"
        " connect(rotor.shaft, belt.a); connect(belt.b, big.shaft); connect(big.shaft, drum.shaft);"
        "connect(drum.flange, load.flange); annotation(experiment(StopTime = 1)); end S;"
    )
    moving = Moving(dae.draw().picture, dae.simulate(points=3))

    def seen(k: int) -> tuple[float, float]:
        rope = next(i for i in moving.at(k) if i.part == "drum" and i.symbol == "string")
        centre = next(i for i in moving.at(k) if i.part == "big").ends[0]
        mass = next(i for i in moving.at(k) if i.part == "load" and i.symbol == "mass")
        box = [v for s in mass.shapes for v in getattr(s, "vertices", ())]
        assert rope.ends[1].y == pytest.approx(mass.frame().place(min(box, key=lambda v: v[2]))[1], abs=1.5)
        return rope.ends[1].x - centre.x, rope.ends[1].y

    (x, before), (_, after) = seen(0), seen(2)
    assert x * g < 0 and (after - before) * g > 0


BESIDE_EACH_OTHER = (
    ["--frames", "0"], ["--frames", "100000"], ["--free-body", "--frames", "3"], ["--free-body", "--dimensions"],
)  # fmt: skip


@pytest.mark.parametrize("options", BESIDE_EACH_OTHER)
def test_options_that_do_not_belong_together_are_refused(tmp_path, capsys, options):
    assert main(["draw", str(CRANK), *options, "-o", str(tmp_path / "s.svg")]) == 2
    assert "E0620" in capsys.readouterr().err


def test_without_a_place_to_write_to(capsys):
    assert main(["draw", str(CRANK)]) == 2
    assert "where should the picture be written" in capsys.readouterr().err


def test_a_film_needs_ffmpeg(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert main(["draw", str(CRANK), "--gif", str(tmp_path / "s.gif")]) in (1, 2)
    assert "ffmpeg" in capsys.readouterr().err and not (tmp_path / "s.gif").exists()


@pytest.mark.skipif(os.name == "nt", reason="the stand-in is a shell script")
def test_a_film_is_what_ffmpeg_makes_of_the_frames(tmp_path, monkeypatch):
    """A stand-in counts the pictures that it is given, and writes them down."""
    stand_in = tmp_path / "bin" / "ffmpeg"
    stand_in.parent.mkdir()
    stand_in.write_text('#!/bin/sh\nfor last; do :; done\ncat > "$last"\n')
    stand_in.chmod(0o755)
    monkeypatch.setenv("PATH", f"{stand_in.parent}{os.pathsep}{os.environ['PATH']}")
    path = tmp_path / "film.gif"
    file = tmp_path / "short.lmo"
    file.write_text(SHORT)
    assert main(["draw", str(file), "--gif", str(path), "--quiet"]) == 0
    frames = path.read_bytes().split(b"\x89PNG")[1:]
    sizes = {frame[16:24] for frame in frames}
    assert len(frames) == 25 and len(sizes) == 1  # all of one size


def test_what_ffmpeg_says_is_told(tmp_path, monkeypatch, capsys):
    stand_in = tmp_path / "ffmpeg"
    stand_in.write_text("#!/bin/sh\necho no such codec >&2\nexit 1\n")
    stand_in.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    assert main(["draw", str(MODELS / "notes" / "s2_2_rotor.lmo"), "--mp4", str(tmp_path / "s.mp4")]) != 0
    assert "no such codec" in capsys.readouterr().err


def test_dimension_lines_are_as_long_as_what_they_measure():
    dae = compiled(MODELS / "planar" / "four_bar.lmo")
    assert not [i for i in dae.draw().picture.items if i.symbol == "dimension"]
    picture = dae.draw(dimensions=True).picture
    lines = {i.part: i for i in picture.items if i.symbol == "dimension"}
    assert set(lines) >= {"crank", "coupler", "rocker"}
    length = {part: hypot(i.ends[1].x - i.ends[0].x, i.ends[1].y - i.ends[0].y) for part, i in lines.items()}
    said = {p: next(s.text for s in i.shapes if isinstance(s, Label)) for p, i in lines.items()}
    ratios = [length[p] / float(said[p].split("=")[-1][:-2]) for p in ("crank", "coupler", "rocker")]
    assert ratios == pytest.approx([ratios[0]] * 3)


def test_lever_arms_have_dimensions():
    picture = compiled(MODELS / "notes" / "s9_lever_small_angles.lmo").draw(dimensions=True).picture
    lines = [i for i in picture.items if i.symbol == "dimension"]
    said = [plain(s.text) for i in lines for s in i.shapes if isinstance(s, Label)]
    assert len(said) == 2 and all(t.startswith("l") and t.endswith(" m") for t in said)


def test_the_falls_of_a_rope_end_at_the_pulley_that_they_carry():
    dae = compiled(MODELS / "textbook" / "hoist.lmo")
    moving = Moving(dae.draw().picture, dae.simulate(points=3))
    for k in (0, 2):
        items = moving.at(k)
        pulley = next(i for i in items if i.symbol == "pulley")
        falls = [i.ends[1].y for i in items if i.part == "rope" and i.symbol == "string" and len(i.ends) == 2]
        assert len(falls) == 2 and falls == pytest.approx([pulley.ends[0].y] * 2)


def test_the_pivot_of_a_beam_stays_on_it():
    dae = compiled(MODELS / "textbook" / "half_car.lmo")
    moving = Moving(dae.draw().picture, dae.simulate(points=31))
    at = {i.symbol: i.ends for i in moving.at(4) if i.part == "body"}
    (a, b), (pivot,) = at["beam"], at["pivot"]
    assert abs(a.y - b.y) > 5
    assert pivot.y == pytest.approx(a.y + (b.y - a.y) * (pivot.x - a.x) / (b.x - a.x), abs=1e-6)
