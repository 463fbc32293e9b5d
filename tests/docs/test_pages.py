"""What README.md and docs/use.md show is what the program does today."""

import re
import shlex
import shutil

import numpy as np
import pytest
from conftest import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")
USE = (ROOT / "docs" / "use.md").read_text(encoding="utf-8")
FIRST = re.search(r"```modelica\n(.*?)```", README, re.DOTALL)[1]
PYTHON = re.search(r"```python\n(.*?)```", README, re.DOTALL)[1]
COMMANDS = re.findall(r"^lmoc (.*?)(?: +#.*)?$", README, re.MULTILINE)
OUTPUTS = [
    pytest.param(*shown, id=shown[0])
    for shown in (
        ("run first.lmo --stop 10", re.search(r"```\n(First: .*?)```", README, re.DOTALL)[1]),
        ("equations first.lmo", re.search(r"```\n(m·ẍ.*?)```", README, re.DOTALL)[1]),
        ("run road.lmo", re.search(r"```\n(Suspension: .*?)```", USE, re.DOTALL)[1]),
    )
]


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """A folder with the scene that the README writes, and a road with an input u."""
    (tmp_path / "first.lmo").write_text(FIRST, encoding="utf-8")
    (tmp_path / "stiff.lmo").write_text(FIRST.replace("k = 50", "k = 80"), encoding="utf-8")
    shutil.copy(ROOT / "models" / "notes" / "ex05_suspension.lmo", tmp_path / "road.lmo")
    (tmp_path / "road.csv").write_text("time,u\n0,0\n1,0.05\n2,0\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    "command", [*COMMANDS, "run road.lmo --input u='0.05*sin(6*time)'", "run road.lmo --input u=road.csv"]
)
def test_the_commands_work(lmoc, command):
    answer = lmoc(*shlex.split(command))
    assert answer.code == 0, answer.err


@pytest.mark.parametrize(("command", "shown"), OUTPUTS)
def test_the_outputs_are_what_is_printed(lmoc, command, shown):
    """Times of this machine apart: they stand after the semicolon in the line of the cost, on one line or two."""
    printed = _without_times(lmoc(*shlex.split(command)).out)
    assert _without_times(shown).strip() in printed


def _without_times(text: str) -> str:
    return re.sub(r"( cost [^;]*);.*?(\n +energy)", r"\1\2", text, flags=re.DOTALL)


def test_the_lines_of_python_work(folder):
    exec(PYTHON, {})
    assert (folder / "first.csv").exists() and (folder / "first.png").exists()


def test_the_optimal_control_swings_the_pole_up(monkeypatch, capfd):
    """The optimum of 40 intervals, run by an integrator: upright and at rest to the accuracy of the rule."""
    monkeypatch.chdir(ROOT)
    found: dict = {}
    exec(re.search(r"```python\n(import casadi, lmoc\n.*?)```", USE, re.DOTALL)[1], found)
    end = {name: found["run"][name][-1] for name in found["f"].states}
    assert end["pin.phi"] == pytest.approx(np.pi / 2, abs=0.1) and end["rail.s"] == pytest.approx(0, abs=0.05)
    assert found["run"]["pin.phi"][0] == pytest.approx(-np.pi / 2)


def test_all_verbs_are_shown():
    from lmoc.cli.main import VERBS

    assert {command.split()[0] for command in COMMANDS} == set(VERBS)
