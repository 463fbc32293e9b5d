"""`lmoc new`: the scenes to start from are sound, and no file is lost."""

import re

import numpy as np
import pytest

import lmoc as package
from lmoc.cli.new import FOLDER, starters
from lmoc.messages.source import Source
from lmoc.syntax.layout import formatted

NAMES = sorted(starters())


def test_the_list_tells_what_each_scene_is(lmoc):
    answer = lmoc("new")
    assert answer.code == 0 and len(NAMES) == 10
    for name, starter in starters().items():
        assert f"  {name:<12}  {starter.title}\n" in answer.out


@pytest.mark.parametrize("name", NAMES)
def test_a_scene_works_as_it_is(lmoc, name):
    """Written, checked (which starts it), derived and drawn without a warning."""
    assert lmoc("new", name).code == 0
    for verb, *more in (["check"], ["equations"], ["draw", "-o", f"{name}.svg"]):
        answer = lmoc(verb, f"{name}.lmo", *more)
        assert answer.code == 0 and "warning" not in answer.err + answer.out, (verb, answer.err)


def test_the_steps_that_are_told_work(lmoc, tmp_path):
    steps = re.findall(r"^  lmoc (.*)$", lmoc("new", "spring_mass").out, re.MULTILINE)
    assert {step.split()[0] for step in steps} == {"run", "draw", "view", "equations"}
    for step in steps:
        assert lmoc(*step.split()).code == 0
    assert {p.suffix for p in tmp_path.glob("spring_mass.*")} == {".lmo", ".png", ".svg", ".html"}


@pytest.mark.parametrize("name", NAMES)
def test_a_scene_is_written_for_a_beginner(name):
    text = starters()[name].text
    assert formatted(Source(name, text)) == text
    assert text.startswith("// ") and max(map(len, text.splitlines())) <= 120
    assert len(re.findall(r"^  (?:parameter|input|output) Real \w+\(unit = .*;$", text, re.MULTILINE)) >= 3
    for line in re.findall(r"^  (?:parameter|input|output) .*$", text, re.MULTILINE):
        assert re.search(r' "[^"]+";$', line), f"without a description: {line}"
    assert re.search(r"experiment\(StopTime = ", text)


def _run(name: str, **options):
    return package.compile(str(FOLDER / f"{name}.lmo")).simulate(**options)


def test_the_scenes_move_as_they_must():
    push = _run("spring_mass", stop=60)
    assert push["x"][-1] == pytest.approx(4 / 50, abs=1e-6)  # F/k, when it has come to rest
    gears = _run("gearbox", stop=60)
    assert gears["n1"][-1] == pytest.approx(3 * 2.5 * gears["n2"][-1], rel=1e-6)
    assert gears["n2"][-1] == pytest.approx(3 * 2.5 * 20 / 8, rel=1e-6)  # all torque goes into the load
    car = _run("quarter_car", initial="equilibrium", inputs={"u": 0})
    assert car["F"] == pytest.approx(np.full(car["F"].size, 340 * 9.81))
    crane = _run("crane", rtol=1e-9)
    carried = 1000 * crane["trolley.v"] + 4000 * crane["load.vx"]
    assert carried[-1] == pytest.approx(2000 * 2, rel=1e-6)  # the momentum that the drive gives in two seconds
    assert [e.kind for e in _run("hoist").events] == ["lock", "unlock", "taut", "lock"]
    slips = [e.time for e in _run("stick_slip").events if e.kind == "slip"]
    assert slips[0] == pytest.approx(4 / 50 / 0.2, abs=1e-9)  # Fstick/k, at the velocity of the belt
    rocker = _run("four_bar")["psi"]
    assert np.ptp(rocker) < np.pi  # it swings and does not turn through
    speed = _run("engine", stop=2)["n"]
    assert 80 < speed.min() and speed.max() < 120  # the load takes what the gas gives


def test_a_tuned_mass_calms_the_building():
    tuned, alone = _run("building"), _run("building", parameters={"hanger.k": 1e3})
    late = tuned.time > 5
    assert np.abs(tuned["roof"][late]).max() < 0.75 * np.abs(alone["roof"][late]).max()


def test_no_file_is_lost(lmoc, tmp_path):
    kept = tmp_path / "crane.lmo"
    kept.write_text("mine")
    answer = lmoc("new", "crane")
    assert answer.code == 2 and "error[E0623]: 'crane.lmo' exists already" in answer.err and kept.read_text() == "mine"
    assert lmoc("new", "crane", "-o", "other.lmo").code == 0
    assert kept.read_text() == "mine" and (tmp_path / "other.lmo").read_text() == starters()["crane"].text
    assert lmoc("new", "crane", "--force", "--quiet") == (0, "", "")
    assert kept.read_text() == starters()["crane"].text


@pytest.mark.parametrize("name", ["quarter-car", "Quarter Car", "quarter_car.lmo", " quarter_car"])
def test_a_name_may_be_written_in_other_ways(lmoc, tmp_path, name):
    assert lmoc("new", name, "-o", "a car.lmo").out.endswith("lmoc equations 'a car.lmo'\n")
    assert (tmp_path / "a car.lmo").exists()


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["crne"], "E0620", "did you mean 'crane'?"),
        (["bridge"], "E0620", "expected: building, crane"),
        (["scene.lmo"], "E0620", "lmoc new building -o scene.lmo"),
        (["-o", "scene.lmo"], "E0620", "which scene?"),
        (["crane", "-o", "no/where.lmo"], "E0623", "no folder 'no'"),
        (["crane", "-o", "crane.txt"], "E0624", ".lmo"),
    ],
)
def test_what_cannot_be_written_is_told(lmoc, tmp_path, words, code, said):
    answer = lmoc("new", *words)
    assert answer.code == 2 and f"error[{code}]" in answer.err and said in answer.err
    assert not list(tmp_path.iterdir())


def test_a_file_that_is_missing_leads_to_the_scenes(lmoc):
    assert "`lmoc new` lists scenes to start from" in lmoc("run", "first.lmo").err
    assert lmoc("new", "crane").code == 0
    answer = lmoc("run", "crane")
    assert answer.code == 1 and "The file itself is named with its ending: crane.lmo" in answer.err
