"""What travels in the wheel, and what a start must not load."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import lmoc

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
PINNED = dict(line.split("==") for line in (ROOT / "constraints.txt").read_text().split())

HEAVY = ("scipy", "sympy", "matplotlib", "pandas", "sksundae", "rich", "hypothesis")


def _name(requirement: str) -> str:
    return re.match(r"[\w-]+", requirement)[0].lower()


def test_every_folder_of_the_compiler_is_a_package_of_the_wheel():
    folders = {p.parent.relative_to(ROOT / "compiler") for p in (ROOT / "compiler").rglob("__init__.py")}
    names = {".".join(folder.parts) for folder in folders}
    assert names | {"lmoc.stdlib", "lmoc.grammar"} == set(PROJECT["tool"]["setuptools"]["packages"])


def test_every_module_stands_in_a_package():
    for path in (ROOT / "compiler" / "lmoc").rglob("*.py"):
        assert (path.parent / "__init__.py").exists(), path


def test_what_is_needed_is_pinned():
    extras = PROJECT["project"]["optional-dependencies"]["test"]
    pinned = {name.lower() for name in PINNED}
    assert {_name(r) for r in (*PROJECT["project"]["dependencies"], *extras)} <= pinned


def test_data_is_found_where_the_package_is():
    import lmoc.grammar
    import lmoc.stdlib

    assert (Path(lmoc.grammar.__file__).parent / "lmo.lark").is_file()
    assert len(list(Path(lmoc.stdlib.__file__).parent.glob("*.lmo"))) >= 3


def test_names_are_exported_lazily():
    program = "import sys, lmoc; print(sorted(m for m in sys.modules if m.startswith('lmoc.'))); lmoc.compile"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
    assert set(lmoc.__all__) <= set(dir(lmoc))


def test_running_a_small_scene_loads_nothing_heavy(scene):
    program = (
        "import sys; from lmoc.cli.main import main; code = main(['run', sys.argv[1], '--quiet']);"
        f"print(code, [m for m in {HEAVY!r} if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", program, str(scene)], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "0 []", done.stderr


def test_the_package_is_the_command():
    done = subprocess.run([sys.executable, "-m", "lmoc", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout == f"lmoc {lmoc.__version__}\n"
