"""What `lmoc run` imports: the engine, and neither casadi nor scipy, in smooth and in hybrid scenes."""

from __future__ import annotations

import subprocess
import sys

import pytest
from conftest import ROOT

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
