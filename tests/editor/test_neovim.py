"""Neovim, where there is one of 0.11 or newer, with the configuration of the manual as it stands."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("pygls")

MANUAL = Path(__file__).parents[2] / "docs" / "editors.md"
TEXT = """model First "α"
  Fixed wall;
  Spring spring(k = 50, d0 = 0.2) "𝑥"; Dampr damper(c = 1);
  Mass mass(m = 2);
equation
  connect(spring.b, mass.flange);
end First;
"""
SESSION = """
local said = {}
xpcall(function()
  vim.cmd.edit("first.lmo")
  vim.wait(60000, function() return #vim.diagnostic.get(0) > 0 end)
  for _, d in ipairs(vim.diagnostic.get(0)) do
    local line = vim.api.nvim_buf_get_lines(0, d.lnum, d.lnum + 1, true)[1]
    table.insert(said, { d.code, line:sub(d.col + 1, d.end_col) })
  end
  vim.api.nvim_win_set_cursor(0, { 4, 8 })
  vim.lsp.buf.rename("body")
  vim.wait(60000, function() return vim.fn.search("body.flange", "n") > 0 end)
end, function(e) table.insert(said, { e }) end)
vim.fn.writefile({ vim.json.encode({ said, vim.api.nvim_buf_get_lines(0, 0, -1, true) }) }, "said.json")
vim.cmd("qa!")
"""


def version() -> tuple[int, ...]:
    if shutil.which("nvim") is None:
        return (0,)
    said = subprocess.run(["nvim", "--version"], capture_output=True, text=True).stdout
    return tuple(map(int, re.findall(r"\d+", said.split("\n")[0])[:2]))


@pytest.mark.skipif(version() < (0, 11), reason="needs Neovim 0.11")
def test_neovim_marks_a_slip_and_renames(tmp_path):
    manual = MANUAL.read_text(encoding="utf-8")
    section = manual[manual.index("## Neovim") :]
    (tmp_path / "init.lua").write_text(re.search(r"```lua\n(.*?)```", section, re.S)[1], encoding="utf-8")
    (tmp_path / "session.lua").write_text(SESSION, encoding="utf-8")
    (tmp_path / "first.lmo").write_text(TEXT, encoding="utf-8")
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    environment |= {f"XDG_{kind}_HOME": str(tmp_path / kind) for kind in ("CONFIG", "STATE", "DATA", "CACHE")}
    subprocess.run(["nvim", "--headless", "-n", "-u", "init.lua", "-c", "luafile session.lua"],
                   cwd=tmp_path, env=environment, timeout=200, capture_output=True)  # fmt: skip
    marks, lines = json.loads((tmp_path / "said.json").read_text(encoding="utf-8"))
    assert ["E0202", "Dampr"] in marks
    assert lines == TEXT.replace("mass", "body").splitlines()
