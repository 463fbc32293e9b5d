"""What the pages show is what the program does today: every command and every block of Python, page by page.

Each page begins in an empty folder with nothing but `models/`: what else its commands use, the page makes before.
"""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from conftest import ROOT

from lmoc.cli.main import VERBS, main
from lmoc.export.fmu import find_compiler

HOW_TO = sorted((ROOT / "docs" / "how-to").glob("*.md"))
PAGES = [ROOT / "README.md", *(ROOT / "docs" / f"{name}.md" for name in ("use", "view", "pictures", "stability"))]
_BLOCK = re.compile(r"```(\w*)\n(.*?)```", re.DOTALL)
_FILE = re.compile(r"into `([-\w]+\.\w+)`[^`\n]*:\s*$")  # the words before a block that says what a file holds
_OTHER_PROGRAMS = {"make", "python3", ".venv/bin/pip", "source"}  # of the installation
# What takes long on a page is made short here: nothing else about it changes.
# (`test_stability.py` makes the runs of docs/stability.md as long as they are)
SHORTER = {
    "--stop 62832": "--stop 628.32",
    "oscillator.lmo --solver cvode": "oscillator.lmo --solver cvode --stop 314",
    "drift.lmo": "drift.lmo --stop 10",
    "cartesian_pendulum.lmo --stop 100": "cartesian_pendulum.lmo --stop 10",
    "--stop 20 --rtol 1e-4 --formulation index1": "--stop 2 --rtol 1e-4 --formulation index1",
    "creep.lmo": "creep.lmo --stop 10",
    "--stop 40 --quick": "--stop 4 --quick",
    "--quick": "--quick --seconds 1",
}
# Runs of docs/stability.md that must fail, for that is what the page is about.
FAIL = {
    "lmoc run models/planar/four_bar.lmo --stop 20 --rtol 1e-4 --formulation index3",
    "lmoc run models/failures/sign_friction.lmo",
}
# Pages whose FMUs other tools run: without a compiler they have sources only, as the page says.
COMPILED = {"co-simulation"}


class Step(NamedTuple):
    """Something that a reader does: write a file, type a command, run lines of Python, or compare what is printed."""

    kind: str  # file, command, python, shown
    text: str
    name: str = ""  # of a file


def steps(text: str) -> Iterator[Step]:
    """What a reader does from the top of a page to its end."""
    for block in _BLOCK.finditer(text):
        language, body = block[1], block[2]
        file = _FILE.search(text[: block.start()])
        if file:
            yield Step("file", body, file[1])
        elif language == "python":
            yield Step("python", body)
        elif language == "sh" or re.match(r"lmoc [a-z]", body):
            yield from (Step("command", line) for line in body.splitlines())
        elif not language:
            yield Step("shown", body)


def run_page(page: Path, folder: Path, capsys) -> tuple[dict, list[str]]:
    """Do what a page says; its variables of Python, and what its commands have printed."""
    (folder / "models").symlink_to(ROOT / "models")
    variables: dict = {}
    printed: list[str] = []
    for step in steps(page.read_text(encoding="utf-8")):
        if step.kind == "file":
            (folder / step.name).write_text(step.text, encoding="utf-8")
        elif step.kind == "python":
            exec(compile(step.text, str(page), "exec"), variables)  # noqa: S102
        elif step.kind == "command":
            printed.append(_typed(step.text, capsys))
        elif printed:
            assert any(_without_times(step.text).strip() in _without_times(out) for out in printed), step.text
    return variables, printed


def _typed(line: str, capsys) -> str:
    """What a command prints."""
    words = shlex.split(line, comments=True)
    if not words or words[0] in _OTHER_PROGRAMS:
        return ""
    assert words[0] in ("lmoc", ".venv/bin/lmoc"), line
    for long, short in SHORTER.items():
        line = line.replace(long, short)
    code = main(shlex.split(line, comments=True)[1:])
    answer = capsys.readouterr()
    assert code == (3 if " ".join(words) in FAIL else 0), (line, answer.err)
    return answer.out


def _without_times(text: str) -> str:
    """A summary without what depends on the machine: times, and how expressions are evaluated."""
    text = re.sub(r"\n +cost .*?(?=\n +(?:closures|energy))", "", text, flags=re.DOTALL)
    return re.sub(r"; evaluated by [^\n]*", "", text)


@pytest.mark.parametrize("page", [*PAGES, *HOW_TO], ids=lambda page: page.stem)
def test_everything_on_a_page_works(page, tmp_path, monkeypatch, capsys):
    if page.stem in COMPILED and find_compiler() is None:
        pytest.skip("there is no C compiler")
    monkeypatch.chdir(tmp_path)
    found, _ = run_page(page, tmp_path, capsys)
    made = set(re.findall(r"[-\w]+\.(?:png|svg|pdf|html)\b", "".join(s.text for s in steps(page.read_text()))))
    assert not [name for name in made if not (tmp_path / name).is_file()], "named in a command, but not made"
    if page.stem in RESULTS:
        RESULTS[page.stem](found)


def _the_pole_is_upright(found: dict) -> None:
    """The optimum of 40 intervals, run by an integrator: upright and at rest to the accuracy of the rule."""
    end = {name: found["run"][name][-1] for name in found["f"].states}
    assert end["pin.phi"] == pytest.approx(np.pi / 2, abs=0.1) and end["rail.s"] == pytest.approx(0, abs=0.05)
    assert found["run"]["pin.phi"][0] == pytest.approx(-np.pi / 2)


def _the_fit_is_good(found: dict) -> None:
    """What the data were made with."""
    assert found["k"] == pytest.approx(40, rel=0.05) and found["c"] == pytest.approx(1.2, rel=0.15)


def _the_optima_hold(found: dict) -> None:
    """The crane: bang-bang (Pontryagin), symmetric in time and nearly always at a bound; both end as they should."""
    force, run, turned = found["force"], found["run"], found["turned"]
    assert np.mean(np.abs(np.abs(force) - 2000) < 20) > 0.9 and force == pytest.approx(-force[::-1], abs=50)
    assert found["stop"] == 2.0 and run.time[-1] == pytest.approx(9.15, abs=0.05)
    assert run["x"][-1] == pytest.approx(8, abs=0.05) and abs(run["rope.omega"][-1]) < 0.03
    assert turned["theta"][-1] == pytest.approx(1 + 2 * np.pi, abs=0.1) and abs(turned["motor.omega"][-1]) < 0.3


RESULTS = {"use": _the_pole_is_upright, "fit": _the_fit_is_good, "optimal-control": _the_optima_hold}


def test_the_equations_at_the_top_are_those_of_the_picture(lmoc):
    shown = next(s.text for s in steps(PAGES[0].read_text(encoding="utf-8")) if s.kind == "shown")
    assert shown in lmoc("equations", ROOT / "models" / "notes" / "ex05_suspension.lmo").out


def test_outputs_are_among_what_is_compared():
    kinds = {page.stem: [s.kind for s in steps(page.read_text(encoding="utf-8"))] for page in PAGES}
    assert kinds["README"].count("shown") >= 3 and "shown" in kinds["use"]


def test_every_verb_is_on_the_pages():
    readme, use = (page.read_text(encoding="utf-8") for page in PAGES[:2])
    typed = {shlex.split(s.text)[1] for s in steps(readme) if s.kind == "command" and s.text.startswith("lmoc ")}
    rows = re.findall(r"^\| (`.*?`) \|", use[: use.index("`lmoc run` further takes")], re.MULTILINE)
    table = {verb for row in rows for verb in re.findall(r"`([a-z]+)", row)}
    assert typed == set(VERBS) - {"lsp"}, "which waits for an editor"
    assert table == set(VERBS)


def test_the_list_of_how_to_pages_names_every_one():
    text = (ROOT / "docs" / "how-to" / "README.md").read_text(encoding="utf-8")
    listed = set(re.findall(r"\]\(([-\w]+)\.md\)", text))
    assert listed == {p.stem for p in HOW_TO} - {"README"}
