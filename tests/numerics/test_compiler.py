"""The C compiler and its cache: whatever is wrong with them, a run gives the same values or says what ran instead."""

import stat
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from oracles.by_hand import Scene, oscillator

import lmoc
from lmoc.engine import compiler
from lmoc.expression import dag
from lmoc.ir.program import Apply, Solve
from lmoc.messages.diagnostics import ModelError, SimulationError
from lmoc.numerics.options.options import ADAPTIVE, RunOptions
from lmoc.numerics.run.simulate import Simulator, simulate

TEXT = "int answer(void) { return 42; }\n"
CHAIN = Path(__file__).parents[2] / "models/bench/chain.lmo"

needs_compiler = pytest.mark.skipif(compiler.find_compiler() is None, reason="no C compiler")


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("LMOC_CACHE", str(tmp_path / "cache"))
    yield
    monkeypatch.undo()
    compiler.find_compiler.cache_clear()


def use_compiler(monkeypatch, path: object) -> None:
    monkeypatch.setenv("LMOC_CC", str(path))
    compiler.find_compiler.cache_clear()


def script(path: Path, text: str) -> Path:
    """An executable file."""
    path.write_text(f"#!{sys.executable}\nimport sys\n{text}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path


def kept() -> list[Path]:
    return sorted(compiler.cache_folder().iterdir())


def answer() -> int | None:
    library = compiler.load_library(TEXT)
    return None if library is None else library.answer()


@needs_compiler
def test_a_kernel_is_kept_and_found_again(monkeypatch):
    assert answer() == 42 and len(kept()) == 1

    def fail(*_):
        raise AssertionError("compiled again")

    monkeypatch.setattr(compiler, "_compile", fail)
    assert answer() == 42


@needs_compiler
@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_a_damaged_kernel_is_made_again(share):
    answer()
    (path,) = kept()
    content = path.read_bytes()
    path.unlink()  # the old file is still loaded here
    path.write_bytes(content[: int(share * len(content))])
    assert answer() == 42
    assert kept() == [path] and len(path.read_bytes()) == len(content)


@needs_compiler
@pytest.mark.parametrize("place", ["a file", "forbidden"])
def test_a_cache_that_cannot_be_written(place, tmp_path, monkeypatch):
    blocked = tmp_path / "blocked"
    if place == "a file":
        blocked.write_text("not a folder")
    else:
        blocked.mkdir(mode=0o500)
    monkeypatch.setenv("LMOC_CACHE", str(blocked))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert answer() == 42
    assert not list(tmp_path.glob("lmoc-*"))


@needs_compiler
def test_several_at_once():
    found = []
    threads = [threading.Thread(target=lambda: found.append(answer())) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [42] * 4
    assert all(path.suffix == ".so" for path in kept())


@pytest.mark.parametrize("text", ["sys.exit(1)", "open(sys.argv[-2], 'w').write('no library')"], ids=["fails", "lies"])
def test_a_compiler_that_is_of_no_use(text, tmp_path, monkeypatch):
    use_compiler(monkeypatch, script(tmp_path / "cc", text))
    assert answer() is None


@pytest.mark.parametrize("path", ["", "/nowhere/cc", __file__])
def test_no_compiler(path, monkeypatch):
    use_compiler(monkeypatch, path)
    assert answer() is None


def test_ida_with_open_blocks_says_so():
    run = lmoc.compile(CHAIN.with_name("network.lmo")).simulate(solver="ida", stop=1e-3, points=2)
    assert run.stats["evaluation"] == "engine, index 1" and run.stats["algebraic"] > 0


@pytest.mark.parametrize("solver", ADAPTIVE)
def test_the_clock_is_watched_while_c_runs(solver, monkeypatch):
    """Few output times, and right-hand sides that no Python comes by."""
    options = RunOptions(solver=solver, stop=1e5, points=2, max_seconds=0.02)
    with pytest.raises(SimulationError, match="the time limit of the run was reached") as failure:
        simulate(oscillator().reduced(), options=options)
    assert "engine" in failure.value.partial.stats["evaluation"] or solver == "taylor"


def test_a_constant_block_that_is_singular():
    """k·a = -x with k = 2, 0: the second has no solution, which is told and not raised."""
    s = Scene()
    k, x, a = s.parameter("k", 2.0), s.state("x", 1.0), s.variable("a")
    s.rate(x, a)
    column = np.array([[k.value[0], a.value[0], x.value[0]]])
    residual = len(s.names) + 1
    inner = Apply(dag.slot(0) * dag.slot(1) + dag.slot(2), column, np.array([residual]))
    block = Solve((inner,), np.array([[a.value[0]]]), np.array([[residual]]), True, True)
    simulator = Simulator(s.reduced(steps=(block,), more_registers=1))
    run = simulator.run()
    assert run["x"] == pytest.approx(np.exp(-run.time / 2), abs=1e-5)
    values = simulator.reduced.values.copy()
    values[k.value[0]] = 0.0
    with pytest.raises(ModelError, match=r"E0535.*a has no finite value"):
        simulator.run(values)
