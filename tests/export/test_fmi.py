"""FMUs: FMPy finds nothing wrong with them, and simulates what lmoc simulates."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest
from oracles.fmu import begin, by_cvode, instance, simulated
from oracles.fmu_calls import goes_on_to_the_bit

import lmoc
from lmoc.export import fmu as exporting
from lmoc.export import settable
from lmoc.export.executable import executable
from lmoc.export.fmu import find_compiler
from lmoc.export.laws import MOST_LAWS

fmpy = pytest.importorskip("fmpy")
from fmpy.fmi1 import FMICallException  # noqa: E402

pytestmark = pytest.mark.skipif(find_compiler() is None, reason="there is no C compiler")

MODELS = Path(__file__).parents[2] / "models"
RTOL = 1e-6
HUNG = """
  connect({0}.flange, spring.a);
  connect(spring.b, mass.flange);
  connect({0}.flange, damper.a);
  connect(damper.b, mass.flange);
"""
OSCILLATOR = (
    """
model Driven "a mass driven by a force"
  parameter Real k(unit = "N/m") = 40;
  parameter Real twice(unit = "N/m") = 2*k;
  parameter Real x0(unit = "m") = 0.1;
  input Real u(unit = "N");
  output Real x(unit = "m") = mass.q;
  Fixed wall;
  Spring spring(k = twice);
  Damper damper(c = 2);
  Mass mass(m = 2, q(start = x0));
  Force force;
equation
  force.f = u;
  connect(force.flange, mass.flange);
"""
    + HUNG.format("wall")
    + "end Driven;"
)
MOVED = (
    """
model Moved
  input Real u(unit = "m");
  output Real y(unit = "m") = mass.q;
  Motion motion;
  Spring spring(k = 50);
  Damper damper(c = 20);
  Mass mass(m = 2);
equation
  motion.q = u;
"""
    + HUNG.format("motion")
    + "end Moved;"
)
PULSE = """
model Pulse
  parameter Real begin(unit = "s") = 1.1;
  input Real u(unit = "N") = if time > begin and time < begin + 0.4 then 5 else 0;
  output Real v(unit = "m/s") = mass.v;
  Mass mass(m = 2);
  Force force;
equation
  force.f = u;
  connect(force.flange, mass.flange);
  annotation(experiment(StopTime = 4));
end Pulse;
"""
SWINGING = """
model Swinging
  output Real x(unit = "m") = mass.q;
  Fixed wall;
  Spring spring(k = 1e4);
  Mass mass(m = 1, q(start = 1, fixed = true), v(start = 0, fixed = true));
equation
  connect(wall.flange, spring.a);
  connect(spring.b, mass.flange);
  annotation(experiment(StopTime = 100));
end Swinging;
"""


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    """A scene with an input, and its FMUs of both versions."""
    dae = lmoc.compile_text(OSCILLATOR)
    folder = tmp_path_factory.mktemp("fmu")
    return dae, {fmi: dae.export(folder / f"driven{fmi}.fmu", fmi=fmi) for fmi in (3, 2)}


@pytest.mark.usefixtures("fixed_parameters")
@pytest.mark.parametrize(
    ("name", "fmi"),
    [("notes/ex05_suspension", 3), ("hard/h02_double_pendulum", 2), ("planar/slider_crank", 3),
     ("planar/pendulum", 3), ("notes/ex09_gear_pair_with_load", 2)],
)  # fmt: skip
def test_an_fmu_does_what_simulate_does(name: str, fmi: int, tmp_path) -> None:
    from fmpy.validation import validate_fmu

    dae = lmoc.compile(MODELS / f"{name}.lmo")
    made = dae.export(tmp_path / "scene.fmu", fmi=fmi)
    assert validate_fmu(str(made.path)) == []
    run = dae.simulate(points=101, rtol=RTOL, inputs=made.zero_inputs)
    stop = float(run.time[-1])
    shown = [n for n in (*dae.states, *dae.outputs) if n in dae.variables]
    for kind, rtol in (("ModelExchange", RTOL / 100), ("CoSimulation", RTOL)):
        found = simulated(
            made.path, fmi_type=kind, stop_time=stop, output_interval=stop / 100, relative_tolerance=rtol,
            output=shown,
        )  # fmt: skip
        own = found[np.searchsorted(found["time"], run.time - 1e-9 * stop)]
        for variable in shown:
            size = np.abs(run[variable]).max()
            assert np.abs(own[variable] - run[variable]).max() <= 100 * RTOL * size + 1e-12, (kind, variable)


def test_model_exchange_is_the_other_tools_integrator(driven) -> None:
    """The same CVode on the scene's functions makes the same steps: no error of an FMU is the FMU's own."""
    dae, made = driven
    described = {v.name: v for v in fmpy.read_model_description(str(made[3].path)).modelVariables}
    times = np.linspace(0, 2, 101)
    found = simulated(
        made[3].path, fmi_type="ModelExchange", stop_time=2.0, output_interval=0.02, relative_tolerance=1e-6,
        output=list(dae.states),
    )  # fmt: skip
    nominal = [float(described[name].nominal or 1) for name in dae.functions.states]
    start = [float(described[name].start) for name in dae.functions.states]
    own = by_cvode(dae.functions, start, nominal, times, 1e-6)
    exact = dae.simulate(times=times, inputs={"u": 0.0}, rtol=1e-10)
    for k, name in enumerate(dae.functions.states):
        assert np.abs(found[name] - own[:, k]).max() <= 1e-10 * nominal[k]
        assert np.abs(found[name] - exact[name]).max() > 1e-7 * nominal[k]  # which both have


def test_errors_of_many_steps_do_not_add_up(tmp_path) -> None:
    """1,592 periods without damping in one communication step: x = cos(100 t)."""
    dae = lmoc.compile_text(SWINGING)
    fmu, references = instance(dae.export(tmp_path / "swinging.fmu").path)
    fmu.enterInitializationMode(tolerance=RTOL, startTime=0.0)
    fmu.exitInitializationMode()
    fmu.doStep(0.0, 100.0)
    assert fmu.getFloat64([references["x"]]) == pytest.approx([np.cos(1e4)], abs=100 * RTOL)
    fmu.freeInstance()


@pytest.mark.parametrize("fmi", [3, 2])
def test_inputs_and_parameters(driven, fmi: int) -> None:
    """A parameter that is set changes what is bound to it; an input acts from the time on at which it is set."""
    dae, made = driven
    run = dae.simulate(stop=2, points=3, inputs={"u": 3.0}, parameters={"k": 60}, rtol=1e-9)
    found = simulated(
        str(made[fmi].path), fmi_type="CoSimulation", stop_time=2.0, output_interval=1.0, relative_tolerance=1e-9,
        start_values={"k": 60.0, "u": 3.0}, output=["x", "twice"],
    )  # fmt: skip
    assert found["twice"][-1] == 120
    assert found["x"] == pytest.approx(run["x"], rel=1e-7)
    assert "x0" in made[fmi].fixed  # the start has been computed with it
    assert made[fmi].zero_inputs == {"u": 0.0}


@pytest.mark.parametrize("kind", ["ModelExchange", "CoSimulation"])
def test_a_jump_of_a_function_of_time(kind: str, tmp_path) -> None:
    """A pulse of 5 N over 0.4 s, shorter than a step of 2 s, leaves 2 kg with a speed of 1 m/s."""
    dae = lmoc.compile_text(PULSE)
    made = dae.export(tmp_path / "pulse.fmu")
    found = simulated(str(made.path), fmi_type=kind, stop_time=4.0, relative_tolerance=1e-9, output=["v"])
    assert found["v"][-1] == pytest.approx(1.0, abs=1e-6)
    assert "begin" in made.fixed  # the times of the jumps have been computed with it


def test_the_derivative_of_an_input_is_an_input(tmp_path) -> None:
    """A wall that moves by u = 0.3 t pulls a mass by a spring and a damper, which feels der(u)."""
    dae = lmoc.compile_text(MOVED)
    made = dae.export(tmp_path / "moved.fmu")
    inputs = [v.name for v in fmpy.read_model_description(str(made.path)).modelVariables if v.causality == "input"]
    assert inputs == ["u", "der(u)"]
    run = dae.simulate(stop=1, points=2, inputs={"u": "0.3*time"}, rtol=1e-9)
    signal = np.array([(0, 0, 0.3), (2, 0.6, 0.3)], [("time", float), ("u", float), ("der(u)", float)])
    found = simulated(
        str(made.path), fmi_type="CoSimulation", stop_time=1.0, output_interval=1e-3, input=signal, output=["y"]
    )
    assert found["y"][-1] == pytest.approx(run["y"][-1], rel=2e-3)  # u is held over a step of 1 ms
    without = simulated(str(made.path), stop_time=1.0, output_interval=1e-3, input=signal[["time", "u"]])
    assert without["y"][-1] != pytest.approx(run["y"][-1], rel=2e-2)


def test_a_start_value_can_be_set(driven) -> None:
    dae, made = driven
    run = dae.simulate(stop=1, points=2, inputs={"u": 0.0}, initial={"x": 0.3}, rtol=1e-9)
    found = simulated(
        str(made[3].path), fmi_type="CoSimulation", stop_time=1.0, output_interval=1.0, relative_tolerance=1e-9,
        start_values={dae.states[0]: 0.3}, output=["x"],
    )  # fmt: skip
    assert found["x"][-1] == pytest.approx(run["x"][-1], rel=1e-7)


@pytest.mark.usefixtures("fixed_parameters")
def test_saving_a_state_is_no_part_of_the_motion(tmp_path) -> None:
    """A run in which a state was saved and one in which none was have the same bits: closures of loops are not solved
    anew, and factors keep their order of pivots."""
    target = str(lmoc.compile(MODELS / "planar" / "four_bar.lmo").export(tmp_path / "bar.fmu").path)
    assert goes_on_to_the_bit(fmpy.read_model_description(target), fmpy.extract(target), stop=2.0) == []


def test_a_saved_state_goes_on_to_the_bit(driven) -> None:
    """Restored in the same instance and, serialized, in another one, which has gone elsewhere meanwhile."""
    one, references = instance(driven[1][3].path)
    other, _ = instance(driven[1][3].path)
    x = [references["x"]]
    for fmu in (one, other):
        begin(fmu)
    one.setFloat64([references["u"]], [5.0])
    one.doStep(0.0, 0.3)
    state = one.getFMUState()
    saved = one.serializeFMUState(state)
    one.doStep(0.3, 0.4)
    expected = one.getFloat64(x)
    one.setFloat64([references["u"]], [-1.0])
    one.doStep(0.7, 0.1)
    assert one.getFloat64(x) != expected
    one.setFMUState(state)
    one.doStep(0.3, 0.4)
    assert one.getFloat64(x) == expected
    other.doStep(0.0, 1.7)
    other.setFMUState(other.deserializeFMUState(saved))
    other.doStep(0.3, 0.4)
    assert other.getFloat64(x) == expected
    one.freeFMUState(state)
    for fmu in (one, other):
        fmu.terminate()
        fmu.freeInstance()


def test_instances_do_not_see_each_other_and_reset_begins_again(driven) -> None:
    one, references = instance(driven[1][3].path)
    other, _ = instance(driven[1][3].path)
    x, k = [references["x"]], [references["k"]]
    begin(one)
    one.doStep(0.0, 0.5)
    expected = one.getFloat64(x)
    other.setFloat64(k, [400.0])
    begin(other)
    other.doStep(0.0, 0.5)
    assert other.getFloat64(x) != expected
    one.reset()
    begin(one)
    assert one.getFloat64(x) == [0.1]
    one.doStep(0.0, 0.5)
    assert one.getFloat64(x) == expected
    for fmu in (one, other):
        fmu.freeInstance()


def test_wrong_calls_get_a_status(driven) -> None:
    from fmpy.fmi1 import FMICallException

    fmu, references = instance(driven[1][3].path)
    wrong = [
        lambda: fmu.doStep(0.0, 0.1),  # before initialization
        lambda: fmu.exitInitializationMode(),
        lambda: fmu.setFloat64([references["u"]], [float("nan")]),
        lambda: fmu.setFloat64([references["x"]], [1.0]),  # calculated
        lambda: fmu.setFloat64([references["x0"]], [1.0]),  # the start has been computed with it
        lambda: fmu.getFloat64([10**6]),
    ]
    for call in wrong:
        with pytest.raises(FMICallException):
            call()
    begin(fmu)
    for time, step in ((5.0, 0.1), (0.0, -0.1), (0.0, np.nan), (0.0, np.inf), (np.inf, 0.1), (np.nan, 0.1)):
        with pytest.raises(FMICallException):
            fmu.doStep(time, step)
    fmu.doStep(0.0, 0.1)
    fmu.freeInstance()


def test_directional_derivatives(driven) -> None:
    """m·x″ = u - 2k·x - d·x′ with m = 2, k = 40, d = 2."""
    fmu, references = instance(driven[1][3].path, "ModelExchange")
    begin(fmu)
    position, speed = (references[n] for n in driven[0].states)
    description = fmpy.read_model_description(str(driven[1][3].path))
    rates = [d.variable.valueReference for d in description.derivatives]

    def along(known: int, unknowns) -> list[float]:
        return list(fmu.getDirectionalDerivative(unknowns, [known], [1.0]))

    assert along(position, rates) == pytest.approx([0, -40])
    assert along(speed, rates) == pytest.approx([1, -1])
    assert along(references["u"], [rates[1], references["x"]]) == pytest.approx([0.5, 0])
    fmu.freeInstance()


FAR = """
model M
  parameter Real {0};
  parameter Real k(unit = "N/m") = 40;
  parameter Real m(unit = "kg") = 1;
  Mass mass(m = m, g = -9.81, q(start = {1}, fixed = true), v(start = 0, fixed = true));
  Spring spring(k = k);
  Fixed wall;
  Force load(f = {2});
equation
  connect(wall.flange, spring.a);
  connect(spring.b, mass.flange);
  connect(load.flange, mass.flange);
  assert(k > 20, "the spring is too soft");
  annotation(experiment(StopTime = 2));
end M;
"""


@pytest.mark.parametrize(
    "declared, start, load, fixed",
    [
        ("p = -1", "if p > 3 then 1 else 0.1", "0", ("p",)),  # the start, but not near p = -1
        ("p = -1, w = if p > 3 then 1 else 0", "0.1 + w", "0", ("p",)),  # by a binding
        ("p = 7", "0.1", "max(0, time - p)", ("p",)),  # a kink behind the end of the experiment
        ("p = -1", "0.1", "(if p > 0 then 1 else 0)*mass.a", ("p",)),  # a term that is left out
        ("p = 0", "max(0, -p)", "0.1*cos(p)", ("p",)),  # by a change downwards alone
        ("p = 0", "0.1", "0.1*cos(p)", ()),
    ],
)
def test_what_decides_elsewhere_is_fixed(declared: str, start: str, load: str, fixed: tuple[str, ...]) -> None:
    """A parameter that is set far from where it was tried out changes numbers alone."""
    dae = lmoc.compile_text(FAR.format(declared, start, load))
    assert executable(dae).held == fixed


def test_parameters_that_break_an_assertion_are_refused(tmp_path) -> None:
    """Limits of parts and assertions about parameters alone: at the end of initialization, and in a run."""
    made = lmoc.compile_text(FAR.format("p = 0", "0.1", "p")).export(tmp_path / "far.fmu")
    for name, value in (("k", 10.0), ("m", -1.0)):
        fmu, references = instance(made.path)
        fmu.setFloat64([references[name]], [value])
        with pytest.raises(FMICallException):
            begin(fmu)
        fmu.reset()
        begin(fmu)
        fmu.doStep(0.0, 0.5)
        fmu.setFloat64([references[name]], [2.0 * abs(value) + 1.0])
        fmu.doStep(0.5, 0.5)
        fmu.setFloat64([references[name]], [value])
        with pytest.raises(FMICallException):
            fmu.doStep(1.0, 0.5)
        fmu.freeInstance()


def test_parameters_that_decide_the_start_are_found_among_many(tmp_path, monkeypatch) -> None:
    """Also by a comparison that one of two equal ones turns, up or down; the others are tried together."""
    text = """model Held
  parameter Real w[200] = fill(0.5, 200);
  parameter Real a = 1;
  parameter Real b = 1;
  Mass mass(m = 2, g = -9.81, q(start = if a > b then 1 else 0, fixed = true));
  Stop stop(L = -3, e = 1);
  Fixed floor;
  Force push(f = -sum(w)*mass.q);
equation
  connect(push.flange, mass.flange);
  connect(floor.flange, stop.a);
  connect(stop.b, mass.flange);
end Held;"""
    tried, same = [], settable.Tried._same_with
    monkeypatch.setattr(settable.Tried, "_same_with", lambda own, new: tried.append(new) or same(own, new))
    monkeypatch.setenv("LMOC_CC", "")
    exported = lmoc.compile_text(text).export(tmp_path / "held.fmu")
    assert exported.fixed == ("a", "b") and len(tried) < 60


def test_laws_too_many_for_tables_of_pairs_are_refused(tmp_path) -> None:
    text = f"""model M
  Mass m[{MOST_LAWS + 2}](each m = 1);
  Cable c[{MOST_LAWS + 1}](each L = 1);
equation
  for i in 1:{MOST_LAWS + 1} loop
    connect(m[i].flange, c[i].a);
    connect(c[i].b, m[i + 1].flange);
  end for;
end M;"""
    with pytest.raises(lmoc.ModelError, match="at most") as caught:
        lmoc.compile_text(text).export(tmp_path / "m.fmu")
    assert caught.value.diagnostics[0].code == "E0669"


def test_the_engine_is_compiled_once_for_all_scenes_and_processes(monkeypatch, tmp_path):
    compiler = find_compiler()
    made = exporting._objects(compiler, 3)
    exporting._objects.cache_clear()  # as in another process
    monkeypatch.setattr(exporting, "_compiled", lambda *_: {})
    assert exporting._objects(compiler, 3) == made and len(made) > 20
    exporting._objects.cache_clear()
    monkeypatch.setenv("LMOC_CACHE", str(tmp_path))
    asked: list[set[str]] = []
    monkeypatch.setattr(exporting, "_compiled", lambda _, sources: asked.append(set(sources)) or {})
    assert exporting._objects(compiler, 3) == exporting._objects(compiler, 2) == {}, "an empty cache"
    files = [sorted(name for name in sources if name.endswith(".c")) for sources in asked]
    assert files[1:] == [["fmi3.c"], ["fmi2.c"]] and len(files[0]) > 20, "what all versions share is compiled once"
    exporting._objects.cache_clear()
    monkeypatch.setattr(exporting, "_compiled", lambda *_: {"a.o": b""})
    monkeypatch.setattr(exporting, "_version", lambda _: "another compiler of the same name")
    assert exporting._objects(compiler, 3) == {"a.o": b""}
    exporting._objects.cache_clear()


def test_sources_rebuild_to_the_same(driven, tmp_path) -> None:
    """A compiler makes from the sources alone what the binary computes, and be it without the optimizations of that."""
    import shutil
    import subprocess
    from xml.etree import ElementTree

    path = driven[1][3].path
    expected = simulated(str(path), fmi_type="CoSimulation", stop_time=1.0, output=["x"])
    folder = tmp_path / "fmu"
    with zipfile.ZipFile(path) as archive:
        archive.extractall(folder)
    build = ElementTree.parse(folder / "sources" / "buildDescription.xml").find(".//SourceFileSet")
    files = [f.get("name") for f in build.findall("SourceFile")]
    binary = next((folder / "binaries").rglob("Driven.*"))
    binary.unlink()
    command = [shutil.which("cc") or "gcc", *build.get("compilerOptions").split(), "-O0", "-fPIC", "-shared"]
    subprocess.run([*command, *files, "-o", str(binary), "-lm"], cwd=folder / "sources", check=True)
    found = simulated(str(folder), fmi_type="CoSimulation", stop_time=1.0, output=["x"])
    assert (found["x"] == expected["x"]).all()


def test_without_a_compiler_there_are_sources(monkeypatch, tmp_path, capsys, icons) -> None:
    from lmoc.cli.main import main

    monkeypatch.setenv("LMOC_CC", "")
    target = tmp_path / "scene.fmu"
    assert main(["export", str(MODELS / "notes/ex02_spring_mass_damper.lmo"), "-o", str(target), "--fmi", "2"]) == 0
    assert "sources only: there is no C compiler" in capsys.readouterr().out
    with zipfile.ZipFile(target) as archive:
        names = archive.namelist()
        assert b'<File name="model.c"' in archive.read("modelDescription.xml")
    assert "sources/model.c" in names and "model.png" in names and not any("binaries" in n for n in names)


def test_a_target_names_the_platform(monkeypatch) -> None:
    monkeypatch.setenv("LMOC_CC", "true -target x86_64-windows-gnu")
    assert (find_compiler().folder(3), find_compiler().folder(2)) == ("x86_64-windows", "win64")
    monkeypatch.setenv("LMOC_CC", "true -target aarch64-macos")
    assert find_compiler().folder(3) == "aarch64-darwin"


def test_a_type_that_is_asked_for_twice_is_there_once(tmp_path):
    """XML with two elements of one type would not be valid."""
    made = lmoc.compile_text("model M Real x(start = 1, fixed = true); equation der(x) = -x; end M;").export(
        tmp_path / "m.fmu", type=("cs", "cs")
    )
    with zipfile.ZipFile(made.path) as archive:
        assert archive.read("modelDescription.xml").decode().count("<CoSimulation") == 1
