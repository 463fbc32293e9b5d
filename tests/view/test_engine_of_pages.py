"""The engine that pages carry is what its sources give."""

import sys
from importlib.util import find_spec

import pytest
from conftest import ROOT

sys.path.insert(0, str(ROOT / "compiler" / "building"))
import wasm  # noqa: E402


@pytest.mark.skipif(find_spec("ziglang") is None, reason="ziglang is not installed: the engine of pages stays")
def test_a_new_build_has_the_same_bytes(tmp_path):
    wasm.build(tmp_path / "engine.wasm")
    assert (tmp_path / "engine.wasm").read_bytes() == wasm.BUILT.read_bytes()
