"""What `lmoc run` imports: the engine, no older one, and neither casadi nor scipy, in smooth and hybrid scenes."""

from __future__ import annotations

import subprocess
import sys

import pytest
from conftest import ROOT

import lmoc.engine.library as library_module

SCENES = {
    "smooth": "notes/ex02_spring_mass_damper",
    "mechanism": "hard/h03_four_bar",
    "laws": "notes/ex08_slack_cable",
}
SCRIPT = """
import sys
from lmoc.__main__ import main
sys.argv = ["lmoc", "run", sys.argv[1]]
try:
    main()
except SystemExit as end:
    assert not end.code, end.code
print("HEAVY", *(m for m in ("casadi", "scipy", "sympy", "matplotlib") if m in sys.modules))
"""


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
def test_a_run_imports_neither_casadi_nor_scipy(scene):
    command = [sys.executable, "-c", SCRIPT, str(ROOT / f"models/{scene}.lmo")]
    found = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert found.splitlines()[-1] == "HEAVY"


def test_an_engine_built_from_other_sources_is_refused(monkeypatch):
    """Not only the function is missing: what the others work on has another layout."""
    monkeypatch.setitem(library_module._FUNCTIONS, "lmoc_of_tomorrow", (None, []))
    with pytest.raises(ImportError, match="built from other sources, install lmoc again"):
        library_module.library.__wrapped__()
