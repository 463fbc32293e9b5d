"""Classes in folders: where they are found, and what is said of files that are wrong."""

from pathlib import Path

import pytest

from lmoc import compile as compile_scene
from lmoc import compile_text
from lmoc.messages.diagnostics import ModelError
from lmoc.sources.packages import Folder

CAR = """within Garage.Examples;
model Car
  Wheel wheel[2](each r = 0.4);
  Mass body(m = 1);
  parameter Real y = g;
end Car;
"""
WHEEL = """within Garage;
model Wheel
  parameter Real r = 0.3;
  Rim rim(r = r);
end Wheel;
"""


@pytest.fixture
def garage(tmp_path: Path) -> Path:
    """A folder with the package `Garage`."""
    write(tmp_path, {
        "Garage/package.lmo": 'package Garage "of cars"\n  constant Real g = 9.81;\nend Garage;\n',
        "Garage/Wheel.lmo": WHEEL,
        "Garage/Rim.mo": "within Garage;\nmodel Rim\n  parameter Real r = 1;\nend Rim;\n",
        "Garage/Examples/package.mo": "within Garage;\npackage Examples\nend Examples;\n",
        "Garage/Examples/Car.lmo": CAR,
        "Garage/package.order": "g\nWheel\nRim\nExamples\n",
    })  # fmt: skip
    return tmp_path


def write(folder: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def mistakes(*args, **more) -> list:
    with pytest.raises(ModelError) as caught:
        compile_scene(*args, **more)
    return [d for d in caught.value.diagnostics if d.severity == "error"]


def test_a_class_is_run_by_its_name(garage, monkeypatch) -> None:
    dae = compile_scene("Garage.Examples.Car", path=str(garage))
    assert dae.parameters["wheel[1].rim.r"] == 0.4
    assert dae.parameters["y"] == 9.81
    assert dae.name == "Garage.Examples.Car"
    monkeypatch.chdir(garage)
    assert compile_scene("Garage.Examples.Car").name == dae.name
    monkeypatch.chdir("/")
    monkeypatch.setenv("LMOPATH", f"/nowhere:{garage}")
    assert compile_scene("Garage.Examples.Car").name == dae.name
    assert compile_text("model M Garage.Wheel w(r = 2); end M;").parameters["w.rim.r"] == 2


@pytest.mark.parametrize("named", ["Examples/Car.lmo", "package.lmo", "Examples/package.mo", "", "Examples"])
def test_a_file_of_a_package_finds_the_others(garage, named) -> None:
    dae = compile_scene(garage / "Garage" / named, "Garage.Examples.Car")
    assert dae.parameters["wheel[2].rim.r"] == 0.4


def test_classes_are_found_next_to_the_file_before_the_path(tmp_path) -> None:
    write(tmp_path, {
        "scenes/Scene.lmo": "model Scene\n  Part a;\n  Other b;\n  Mass c(m = 1);\nend Scene;\n",
        "scenes/Part.lmo": "model Part\n  parameter Real k = 1;\n  Helper h;\nend Part;\n"
                           "model Helper\n  parameter Real z = 5;\nend Helper;\n",
        "more/Part.lmo": "model Part\n  parameter Real k = 2;\nend Part;\n",
        "more/Other.mo": "model Other\n  parameter Real k = 3;\nend Other;\n",
        "more/broken.lmo": "model (((",
    })  # fmt: skip
    dae = compile_scene(tmp_path / "scenes/Scene.lmo", path=[tmp_path / "more"])
    assert [dae.parameters[n] for n in ("a.k", "a.h.z", "b.k", "c.m")] == [1, 5, 3, 1]
    named = [tmp_path / "scenes/Scene.lmo", tmp_path / "more/Part.lmo"]
    swapped = compile_scene(named, "Scene", path=tmp_path / "more")
    assert swapped.parameters["a.k"] == 2  # a file that is named goes before those that are found
    assert [d.code for d in mistakes(tmp_path / "scenes/Scene.lmo", "Helper")] == ["E0601"]


def test_files_are_read_when_first_needed(garage, monkeypatch) -> None:
    from lmoc.sources import packages

    read = []
    original = packages.read_source
    monkeypatch.setattr(packages, "read_source", lambda path: (read.append(Path(path).name), original(path))[1])
    compile_scene("Garage.Wheel", path=garage)
    assert sorted(read) == ["Rim.mo", "Wheel.lmo", "package.lmo"]


def test_the_order_of_a_package_is_that_of_package_order(garage) -> None:
    assert list(Folder(garage / "Garage", ("Garage",)).names()) == ["Wheel", "Rim", "Examples"]


@pytest.mark.parametrize(
    ("files", "model", "codes", "words"),
    [
        ({"Garage/Wheel.lmo": WHEEL.replace("Wheel", "Weel")}, "Garage.Wheel", ["E0244"], "'Weel'"),
        ({"Garage/Wheel.lmo": WHEEL.replace("within Garage", "within Garag")}, "Garage.Wheel", [], "within Garage;"),
        ({"Garage/Wheel.lmo": WHEEL.replace("Rim rim", "Rin rim")}, "Garage.Wheel", ["E0202"], "'Rim'"),
        ({"Garage/Wheel.lmo": WHEEL.replace("Real r", "Real r r")}, "Garage.Wheel", None, "Wheel.lmo"),
        ({"Garage/Wheel.lmo": "\0"}, "Garage.Examples.Car", ["E0612"], "Wheel.lmo"),
        ({"Garage/Wheel/package.mo": "within Garage;\npackage Wheel end Wheel;"}, "Garage.Wheel", ["E0244"], "both"),
        ({}, "Garage.Examples.Cat", ["E0601"], "'Car'"),
        ({}, "Garage.Exampels.Car", ["E0601"], "'Examples'"),
        ({}, "Garaje.Wheel", ["E0601"], "'Garage'"),
        ({}, "Garage", ["E0601"], "package"),
    ],
)
def test_what_is_wrong_with_a_file_is_said(garage, files, model, codes, words) -> None:
    write(garage, files)
    found = mistakes(model, path=garage)
    if codes:
        assert [d.code for d in found] == codes
    assert words in "\n".join(map(str, found))


def test_a_missing_within_is_warned_of(garage) -> None:
    write(garage, {"Garage/Wheel.lmo": WHEEL.replace("within Garage;\n", ""), "Garage/package.order": "Wheel\nRime\n"})
    dae = compile_scene("Garage.Examples.Car", path=garage)
    warned = [d for d in dae.notes if d.code == "W0245"]
    assert len(warned) == 2 and {"Rime" in d.message for d in warned} == {True, False}


def test_folders_that_are_not_there(garage) -> None:
    assert mistakes("Garage.Wheel", path=garage / "no")[0].code == "E0610"
    assert mistakes("Garage.Wheel", path=garage / "Garage/Wheel.lmo")[0].code == "E0610"
    assert mistakes("Garage.Wheel", path="")[0].code == "E0610"
    assert mistakes([])[0].code == "E0610"
    assert mistakes(["A", "B"])[0].code == "E0610"


def test_a_class_that_is_refused_harms_only_what_uses_it(garage) -> None:
    text = """
        model Good Mass m(m = 1, q(start = 1, fixed = true), v(start = 0, fixed = true)); end Good;
        model Bad Real x equation x = 1; end Bad;
        function far external "C"; end far;
        model User Bad bad; end User;
        model Caller Real y = far(); end Caller;"""
    dae = compile_text(text, model="Good")
    assert [d.code for d in dae.notes if d.severity == "warning" and d.code == "W0246"] == ["W0246", "W0246"]
    for model, code in (("User", "E0102"), ("Caller", "E0116"), ("Bad", "E0102")):
        with pytest.raises(ModelError) as caught:
            compile_text(text, model=model)
        assert [d.code for d in caught.value.diagnostics if d.severity == "error"] == [code]
    write(garage, {"Garage/Rim.mo": "within Garage;\nmodel Rim\n  parameter Real r = 1;\n  model X\n    Real y = ;\n"
                                    "  end X;\nend Rim;\n"})  # fmt: skip
    assert compile_scene("Garage.Wheel", path=garage).parameters["rim.r"] == 0.3


def test_a_structural_parameter_compiles_the_same_files_again(garage) -> None:
    write(garage, {"N.lmo": "model N\n  parameter Integer n = 2;\n  Garage.Wheel w[n];\n  Real x[n](each start = 1, "
                            "each fixed = true);\nequation\n  der(x) = -x;\nend N;\n"})  # fmt: skip
    dae = compile_scene(garage / "N.lmo")
    (garage / "Garage/Wheel.lmo").unlink()
    assert dae.simulate(stop=1, parameters={"n": 3})["x[3]"][-1] == pytest.approx(0.36788, rel=1e-4)


def test_the_command_takes_a_class_and_folders(garage, lmoc, monkeypatch) -> None:
    monkeypatch.chdir("/")
    write(garage, {"Spin.lmo": "model Spin\n  Real x(start = 1, fixed = true);\nequation\n  der(x) = -x*Garage.g;\n"
                               "end Spin;\n"})  # fmt: skip
    for words in (("check",), ("run", "--quiet"), ("equations",), ("show",), ("linearize",), ("equilibria",)):
        answer = lmoc(*words, "Spin", "--path", garage)
        assert answer.code == 0, (words, answer.err)
    assert lmoc("check", "Spin").code == 2
    assert "did you mean" in lmoc("check", "Spim", "--path", garage).err


def test_no_class_of_the_library_takes_the_place_of_one_that_is_wrong(garage) -> None:
    scene = "within Garage;\nmodel Scene\n  Spring s(k = 1);\nend Scene;\n"
    write(garage, {"Garage/Scene.lmo": scene, "Garage/Spring.lmo": "within Garage;\nmodel Springy\nend Springy;\n"})
    assert [d.code for d in mistakes("Garage.Scene", path=garage)] == ["E0244"]


WAGON = """within Trains;
model Wagon
  connector Flange Real s; flow Real f; end Flange;
  model Mass Flange a, b; Real v, acc(start = 0);
    equation a.s = b.s; v = der(a.s); acc = der(v); acc = a.f + b.f - abs(v); end Mass;
  Mass body(a(s(start = 1, fixed = true)), v(start = 1, fixed = true));
  Flange coupling;
equation connect(body.a, coupling);
end Wagon;
"""


def test_what_a_package_has_written_is_not_told_to_who_uses_it(tmp_path, monkeypatch) -> None:
    """A kink, an open end and a guess that cannot be met: told where the class is found in the current folder.

    In a folder that is named for libraries it is a library's, wherever that lies, and neither a model with it nor who
    runs it is told.
    """
    write(tmp_path, {"Trains/package.mo": "package Trains end Trains;", "Trains/Wagon.mo": WAGON})
    far = compile_scene("Trains.Wagon", path=str(tmp_path))
    assert not {"W0311", "W0312", "W0533"} & {d.code for d in (*far.notes, *far.simulate(stop=0.1).notes)}
    with monkeypatch.context() as at_home:
        at_home.chdir(tmp_path)
        assert not {"W0311", "W0312"} & {d.code for d in compile_scene("Trains.Wagon", path=".").notes}
        own = compile_scene("Trains.Wagon")
    assert {"W0311", "W0312"} <= {d.code for d in own.notes}
    assert "W0533" in {d.code for d in own.simulate(stop=0.1).notes}
    used = compile_text("model M Trains.Wagon w; end M;", model="M", path=str(tmp_path))
    assert [(d.code, d.message[:12]) for d in used.notes] == [("W0312", "'w.coupling'")]
    assert "W0533" not in {d.code for d in used.simulate(stop=0.1).notes}
