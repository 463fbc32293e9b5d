"""Compiled scenes kept between processes: used again while nothing has changed, and only then."""

import pytest

from lmoc import ModelError, compilation, pipeline
from lmoc.sources import compiled

SCENE = """model M
  parameter Real k = 4;
  Mass m(m = 1, q(start = 1, fixed = true)); Spring s(k = k); Fixed f;
equation
  connect(f.flange, s.a); connect(s.b, m.flange);
end M;
"""


@pytest.fixture
def scene(tmp_path, monkeypatch):
    monkeypatch.setenv("LMOC_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("LMOC_CHECK", raising=False)
    folder = tmp_path / "work"
    folder.mkdir()
    monkeypatch.chdir(folder)
    path = folder / "m.lmo"
    path.write_text(SCENE)
    return path


@pytest.fixture
def flattened(monkeypatch):
    """The scenes flattened so far, by number of their files."""
    calls = []
    own = pipeline.flatten
    monkeypatch.setattr(pipeline, "flatten", lambda *a: calls.append(1) or own(*a))
    return calls


def period(k: float) -> float:
    """The position after half a period of k = 4, m = 1."""
    import math

    return math.cos(math.sqrt(k) * math.pi / 2)


def recalled(path, /, **options):
    return compilation.recalled_or_compiled(str(path), compilation.scene_of(**options))


def position(path, /, **options) -> float:
    run = recalled(path, **options).simulate(times=[1.5707963267948966], rtol=1e-9)
    return float(run["m.q"][-1])


def test_the_second_run_compiles_nothing(scene, flattened):
    assert position(scene) == pytest.approx(-1, abs=1e-7)
    assert len(flattened) == 1
    assert position(scene) == pytest.approx(-1, abs=1e-7)
    assert len(flattened) == 1


def test_parameters_can_still_be_changed(scene):
    position(scene)
    again = recalled(scene)
    run = again.simulate(parameters={"k": 9.0}, times=[1.5707963267948966], rtol=1e-9)
    assert run["m.q"][-1] == pytest.approx(period(9), abs=1e-7)
    run = again.simulate(parameters={"k": 0.0}, times=[1.0])  # another structure
    assert run["m.q"][-1] == pytest.approx(1.0)


def test_a_changed_text(scene, flattened):
    position(scene)
    scene.write_text(SCENE.replace("k = 4;", "k = 9;"))
    assert position(scene) == pytest.approx(period(9), abs=1e-7)
    assert len(flattened) == 2


def test_other_parameters_models_and_states(scene, flattened):
    position(scene)
    assert position(scene, parameters={"k": 9}) == pytest.approx(period(9), abs=1e-7)
    assert position(scene, parameters={"k": 16}) == pytest.approx(period(16), abs=1e-7)
    assert position(scene, model="M") == position(scene, states=["m.q"]) == pytest.approx(-1, abs=1e-7)
    assert len(flattened) == 5


def test_another_library(scene, flattened, monkeypatch):
    position(scene)
    changed = tuple((name, text + "\n") for name, text in compiled.library_texts())
    monkeypatch.setattr(compiled, "library_texts", lambda: changed)
    position(scene)
    assert len(flattened) == 2


def test_another_program(scene, flattened, monkeypatch):
    position(scene)
    monkeypatch.setattr(compiled, "_program", lambda: b"later")
    position(scene)
    assert len(flattened) == 2


def test_a_class_that_appears_in_the_folder(scene):
    position(scene)
    (scene.parent / "Mass.lmo").write_text("model Mass end Mass;")
    with pytest.raises(ModelError, match="'flange'"):  # it takes the place of the library's
        recalled(scene)


def test_a_folder_on_the_path_that_appears(scene, flattened, monkeypatch, tmp_path):
    monkeypatch.setenv("LMOPATH", str(tmp_path / "more"))
    position(scene)
    (tmp_path / "more").mkdir()
    (tmp_path / "more" / "Other.lmo").write_text("model Other end Other;")
    position(scene)
    assert len(flattened) == 2


def test_a_class_of_a_folder(scene, flattened):
    (scene.parent / "Heavy.lmo").write_text("model Heavy extends Mass(m = 1); end Heavy;")
    scene.write_text(SCENE.replace("Mass m(m = 1, ", "Heavy m("))
    assert position(scene) == position(scene) == pytest.approx(-1, abs=1e-7)
    assert len(flattened) == 1
    (scene.parent / "Heavy.lmo").write_text("model Heavy extends Mass(m = 4); end Heavy;")
    assert position(scene) == pytest.approx(0, abs=1e-7)
    assert len(flattened) == 2


def test_a_class_of_a_package_by_its_name(scene, flattened, tmp_path):
    package = tmp_path / "lib" / "P"
    package.mkdir(parents=True)
    (package / "package.mo").write_text("package P constant Real k = 4; end P;")
    (package / "M.mo").write_text("within P; " + SCENE.replace("k = 4", "k = P.k"))
    run = {"path": str(tmp_path / "lib")}
    assert position("P.M", **run) == position("P.M", **run) == pytest.approx(-1, abs=1e-7)
    assert len(flattened) == 1
    (package / "package.mo").write_text("package P constant Real k = 9; end P;")
    assert position("P.M", **run) == position("P.M", **run) == pytest.approx(period(9), abs=1e-7)
    assert len(flattened) == 2
    (package / "Mass.mo").write_text("within P; model Mass extends .Mass; end Mass;")  # hides the library's
    assert position("P.M", **run) == pytest.approx(period(9), abs=1e-7)
    assert len(flattened) == 3


def test_a_damaged_entry_is_made_again(scene, flattened, tmp_path):
    position(scene)
    (entry,) = (tmp_path / "cache").glob("scene-*")
    entry.write_bytes(entry.read_bytes()[:-20])
    assert position(scene) == pytest.approx(-1, abs=1e-7)
    assert len(flattened) == 2


def test_entries_do_not_pile_up(scene, tmp_path, monkeypatch):
    monkeypatch.setattr(compiled, "_MOST", 3)
    for k in range(6):
        position(scene, parameters={"k": 1 + k})
    assert len(list((tmp_path / "cache").glob("scene-*"))) == 3


def test_without_a_folder_for_it(scene, flattened, monkeypatch):
    monkeypatch.setenv("LMOC_CACHE", "")
    for _ in range(2):
        assert position(scene) == pytest.approx(-1, abs=1e-7)
    assert len(flattened) == 2


def test_checked_structures_are_made_anew(scene, flattened, monkeypatch):
    monkeypatch.setenv("LMOC_CHECK", "1")
    for _ in range(2):
        position(scene)
    assert len(flattened) == 2
