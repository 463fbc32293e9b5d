"""Runs repeated by JavaScript: the same answer as Python's, with the model's values and with others."""

from pathlib import Path

import numpy as np
import pytest
from oracles.in_javascript import difference, in_engine, program, repeat
from oracles.models import PARALLELOGRAM, compiled
from oracles.node import needs_node, run_script

import lmoc
from lmoc.view.javascript import script as script_module
from lmoc.view.javascript.script import NotWritten, Script, write_script
from lmoc.view.javascript.sliders import Slider, sliders

MODELS = Path(__file__).parents[2] / "models"
AGREE = 1e-6  # of the largest value of the same unit

pytestmark = needs_node


def scripts(files: list[Path], **options) -> list[tuple[object, Script]]:
    runs = [compiled(f).simulate(**options) for f in files]
    return [(run, write_script(run.trajectory)) for run in runs]


@pytest.mark.parametrize("solver, agree", [("dop853", AGREE), ("auto", 1e-5)])
def test_every_scene_of_the_notes_and_its_variables(solver, agree):
    """Of the same method as the page's, and of what Python prefers: there both are right within the tolerance."""
    runs = [compiled(file).simulate(solver=solver) for file in sorted((MODELS / "notes").glob("*.lmo"))]
    smooth = [run for run in runs if run.reduced.switched is None]
    assert len(smooth) >= 31 and any(run.stats["solver"] == "taylor" for run in smooth) is (solver == "auto")
    cases = [(run, write_script(run.trajectory)) for run in smooth]
    for (run, script), again in zip(cases, repeat([(run, script, []) for run, script in cases]), strict=True):
        assert again.complete, (run.flat.name, again.reason)
        assert difference(run, again) < agree, run.flat.name
        assert script.data["held"] == [], run.flat.name


def test_mechanisms_with_blocks_and_constraints():
    names = ["chain", "slider_crank", "scissor_lift", "four_bar"]
    files = [MODELS / "planar" / f"{name}.lmo" for name in names] + [MODELS / "hard" / "h27_car_axis.lmo"]
    cases = scripts(files, rtol=1e-10, points=40)
    for (run, _), again in zip(cases, repeat([(run, script, []) for run, script in cases]), strict=True):
        assert again.complete, (run.flat.name, again.reason)
        assert difference(run, again) < AGREE, run.flat.name


def changeable(run, script: Script) -> list[Slider]:
    return [s for s in sliders(run.trajectory.observer, script.slots) if not s.fixed and s.value]


def test_other_values_of_parameters_give_what_python_gives():
    files = [MODELS / "notes" / f for f in ("ex05_suspension.lmo", "ex09_gear_pair_with_load.lmo", "fig5_rods.lmo")]
    files += [MODELS / "planar" / f for f in ("slider_crank.lmo", "cart_pole.lmo")]
    cases, truths = [], []
    for file in files:
        dae = compiled(file)
        run = dae.simulate(points=30, rtol=1e-8)
        script = write_script(run.trajectory)
        chosen = changeable(run, script)
        assert len(chosen) >= 2, file.name
        for slider in (chosen[0], chosen[-1]):
            value = 1.3 * slider.value
            truths.append(dae.simulate(points=30, rtol=1e-8, parameters={slider.name: value}))
            cases.append((truths[-1], script, [[slider.slot, value]]))
    for truth, again in zip(truths, repeat(cases), strict=True):
        assert again.complete, again.reason
        assert difference(truth, again) < AGREE


def test_what_is_bound_follows():
    text = """
    model Bound
      parameter Real k = 8, a = 0.2;
      parameter Real stiff = 2*k;
      Fixed wall; Spring spring(k = stiff, d0 = a); Mass body(m = 2, q(start = 3*a, fixed = true));
      Real h(start = a + 1, fixed = true);
    equation
      connect(wall.flange, spring.a); connect(spring.b, body.flange);
      der(h) = -h + body.q;
    end Bound;
    """
    dae = lmoc.compile_text(text)
    run = dae.simulate(stop=3, points=20, solver="dop853")
    script = write_script(run.trajectory, 3.0)
    found = {s.name: s for s in sliders(run.trajectory.observer, script.slots)}
    assert "k" in found and "stiff" not in found and "spring.k" not in found
    truth = dae.simulate(stop=3, points=20, parameters={"k": 3.0, "a": -0.4}, solver="dop853")
    (again,) = repeat([(truth, script, [[found["k"].slot, 3.0], [found["a"].slot, -0.4]])])
    assert difference(truth, again) < 1e-7
    assert truth["h"][0] == pytest.approx(0.6)


def test_a_value_given_for_what_is_bound_stays():
    text = "model M parameter Real k = 8; parameter Real s = 2*k; Real x(start = 1, fixed = true); equation\n" \
           "der(x) = -s*x; end M;"  # fmt: skip
    dae = lmoc.compile_text(text, parameters={"s": 1.0})
    run = dae.simulate(stop=1, points=5)
    script = write_script(run.trajectory, 1.0)
    assert [s.name for s in sliders(run.trajectory.observer, script.slots)] == ["s"]
    (again,) = repeat([(run, script, [])])
    assert again.values[-1, again.names.index("x")] == pytest.approx(np.exp(-1), rel=1e-6)


def test_kinks_tables_and_starts_on_dependent_variables():
    text = """
    model Driven
      parameter Real t1 = 0.7, l = 0.5;
      input Real u = if time < t1 then 0 else 2*sin(3*time)*sign(sin(20*time));
      input Real v = 0;
      Mass body(m = 2); Fixed wall; Spring s(k = 30); Damper d(c = 0.3); Force push(f = u + v);
      output Real twice(start = l, fixed = true) = 2*body.q;
      output Real rate(start = 1, fixed = true) = 3*body.v;
    equation
      connect(wall.flange, s.a); connect(s.b, body.flange); connect(wall.flange, d.a); connect(d.b, body.flange);
      connect(push.flange, body.flange);
    end Driven;
    """
    dae = lmoc.compile_text(text)
    table = np.array([[0, 0], [0.5, 1], [0.5, -1], [1, 0.3], [2, 0.4]])
    run = dae.simulate(stop=2, points=21, inputs={"v": table})
    script = write_script(run.trajectory, 2.0)
    found = {s.name: s for s in sliders(run.trajectory.observer, script.slots)}
    assert {"t1", "l"} <= set(found)
    truth = dae.simulate(stop=2, points=21, inputs={"v": table}, parameters={"t1": 1.1, "l": -0.2})
    first, second = repeat([(run, script, []), (truth, script, [[found["t1"].slot, 1.1], [found["l"].slot, -0.2]])])
    assert difference(run, first) < 1e-9 and difference(truth, second) < 1e-9


def test_a_start_that_was_given_is_held():
    dae = compiled(MODELS / "notes" / "ex02_spring_mass_damper.lmo")
    states = [n for n in dae.states if not n.startswith("der") and n.endswith("q")]
    run = dae.simulate(stop=1, points=5, initial={states[0]: 0.123})
    script = write_script(run.trajectory, 1.0)
    assert script.data["held"] == [states[0]]
    (again,) = repeat([(run, script, [])])
    assert again.values[0, again.names.index(states[0])] == 0.123


def test_values_that_the_model_forbids_are_refused():
    run = compiled(MODELS / "notes" / "ex02_spring_mass_damper.lmo").simulate(points=5)
    script = write_script(run.trajectory, 1.0)
    mass = next(s for s in sliders(run.trajectory.observer, script.slots) if s.name.endswith("m"))
    (again,) = repeat([(run, script, [[mass.slot, -1.0]])])
    assert not again.complete and "m" in again.reason and len(again.values) == 0


def test_coordinates_change_as_in_python():
    """The same changes at the same times: the judge is the same, and so are the steps of the same method."""
    cases = []
    for file in ("planar/pendulum_cartesian", "hard/h01_cartesian_pendulum", "hard/h03_four_bar"):
        dae = compiled(MODELS / f"{file}.lmo")
        options = {"solver": "dop853", "formulation": "reduced"}
        run = dae.simulate(points=60, **options)
        assert len(run.coordinates) > 2
        script = write_script(run.trajectory)
        slots = {s.name: s for s in sliders(run.trajectory.observer, script.slots)}
        cases.append((run, script, []))
        if "world.g" in slots:
            value = 1.2 * slots["world.g"].value
            other = dae.simulate(points=60, parameters={"world.g": value}, **options)
            cases.append((other, script, [[slots["world.g"].slot, value]]))
    for (run, _, changed), again in zip(cases, repeat(cases), strict=True):
        assert again.complete, again.reason
        apart = AGREE if changed else 1e-9  # absolute tolerances are those of the run at hand
        assert difference(run, again) < apart
        assert again.changes == pytest.approx([t for t, _ in run.coordinates[1:]], rel=10 * apart if changed else apart)


def test_singular_positions_are_passed_as_in_a_run():
    """Where branches meet, page and run take one passage: on the same branch, with the same output times in it."""
    cases = []
    for text in ((MODELS / "failures" / "isosceles.lmo").read_text("utf-8"), PARALLELOGRAM):
        run = lmoc.compile_text(text).simulate(stop=4, points=101, solver="dop853")
        assert any(n.code == "N0633" for n in run.notes)
        cases.append((run, write_script(run.trajectory), []))
    for (run, _, _), again in zip(cases, repeat(cases), strict=True):
        assert again.complete, again.reason
        assert difference(run, again) < AGREE, run.flat.name


def test_a_page_stops_at_a_singular_position_where_a_run_stops():
    """The coupler is too long by 1e-10: two branches almost meet where the bars are in line."""
    dae = lmoc.compile_text(PARALLELOGRAM.replace("coupler(l = 1,", "coupler(l = 1.0000000001,"))
    with pytest.raises(lmoc.SimulationError, match="singular position lies ahead") as stopped:
        dae.simulate(stop=1, points=11, solver="dop853")
    run = stopped.value.partial
    (again,) = repeat([(run, write_script(run.trajectory, 1.0), [])])
    at, sentence = str(stopped.value).split(": ", 1)
    assert not again.complete and again.reason == f"{at.split(' of')[0].replace('stopped', 'stops')}: {sentence}"


def test_coordinates_that_the_page_does_not_have(monkeypatch):
    """A pendulum in x and y passes the place where x no longer tells y, in a page that has x alone."""
    run = compiled(MODELS / "hard" / "h01_cartesian_pendulum.lmo").simulate(points=60)
    assert len(run.coordinates) > 2
    monkeypatch.setattr(script_module, "_other_choices", lambda trajectory: [])
    (again,) = repeat([(run, write_script(run.trajectory), [])])
    assert not again.complete and again.reason.startswith("the run stops at t = 0.2386")
    assert again.reason.endswith("the coordinates would have to change, to some that this page does not have")


def test_no_second_branch_without_a_word():
    """Beyond its dead centre the point has no height: no value, as in Python, and none of another branch."""
    text = """
    model M
      Real x(start = 0.6, fixed = true), y(start = 0.8), z(start = 0, fixed = true);
    equation
      x^2 + y^2 = 1;
      der(x) = 1;
      der(z) = SLOPE;
    end M;
    """
    free, bound = (lmoc.compile_text(text.replace("SLOPE", e)).simulate(stop=0.3, points=5) for e in ("1", "y"))
    for run, complete in ((free, True), (bound, False)):
        script = write_script(run.trajectory, 1.0)
        times = np.linspace(0, 1, 51).tolist()
        wanted = [int(script.registers[run.flat.find("y")[0]])]
        body = f"const r = simulate(scene, [], {times}, {wanted}); console.log(JSON.stringify([r, [...r.columns[0]]]));"
        r, y = run_script("\n".join([in_engine("repeat.js"), program(script, body)]))
        x, y = 0.6 + np.array(r["time"]), np.array(y, float)
        assert r["complete"] is complete and bool(r["reason"]) is not complete
        assert np.allclose(y[x < 0.99], np.sqrt(1 - x[x < 0.99] ** 2)) and np.isnan(y[x > 1.0001]).all()


def test_what_a_page_cannot_do_is_said():
    dae = compiled(MODELS / "laws" / "h19_bouncing_ball.lmo")
    with pytest.raises(NotWritten, match="impulses"):
        write_script(dae.simulate(stop=0.5, points=20, solver="moreau", step=0.01).trajectory)
    first = dae.simulate(stop=1, points=20)
    with pytest.raises(NotWritten, match="another one has ended"):
        write_script(dae.simulate(start=1, stop=2, initial=first.end).trajectory)


def test_a_function_of_python_is_not_in_the_page():
    dae = lmoc.compile_text("model M input Real u; Real x(start=1, fixed=true); equation der(x) = u; end M;")
    run = dae.simulate(stop=1, points=5, inputs={"u": lambda t: t})
    with pytest.raises(NotWritten, match="'u' is a function of Python"):
        write_script(run.trajectory, 1.0)


def test_the_functions_of_the_language():
    """Every function and relation, at arguments of both signs, also where they give no number."""
    terms = "sin(x) cos(x) tan(x) asin(x) acos(x) atan(x) sinh(x) cosh(x) tanh(x) exp(x) log(x) log10(x) sqrt(x) "
    terms += "abs(x) sign(x) floor(3*x) ceil(3*x) integer(3*x) min(x,0.3) max(x,0.3) mod(x,0.4) rem(x,0.4) "
    terms += "div(3*x,0.4) atan2(x,0.2) x^3 abs(x)^1.7 2^x (if(x>0.2)then(x)else(-x))"
    shown = terms.split()
    text = "model M Real x(start=-0.9,fixed=true); " + " ".join(f"Real y{k};" for k in range(len(shown)))
    text += " equation der(x) = 1; " + " ".join(f"y{k} = noEvent({e});" for k, e in enumerate(shown)) + " end M;"
    run = lmoc.compile_text(text).simulate(stop=1.8, points=37, solver="dop853")
    (again,) = repeat([(run, write_script(run.trajectory, 1.8), [])])
    jumps = {k for k, e in enumerate(shown) if e.startswith(("floor", "ceil", "integer", "mod", "rem", "div"))}
    for k, e in enumerate(shown):
        ours, theirs = again.values[:, again.names.index(f"y{k}")], run[f"y{k}"]
        assert (np.isnan(ours) == np.isnan(theirs)).all(), e
        if k not in jumps:
            assert np.allclose(ours, theirs, rtol=1e-9, atol=1e-9, equal_nan=True), e
        else:
            assert np.mean(np.isclose(ours, theirs, rtol=1e-9, atol=1e-9)) > 0.9, e


def test_stiff_scenes_take_few_steps():
    cases, truths = [], []
    for file in ("h28_prothero_robinson", "h28b_stiff_mount"):
        dae = compiled(MODELS / "hard" / f"{file}.lmo")
        run = dae.simulate(points=30, rtol=1e-7)
        script = write_script(run.trajectory)
        k = next(s for s in sliders(run.trajectory.observer, script.slots) if s.name.endswith("k"))
        truths += [dae.simulate(points=30, rtol=1e-10, parameters=p) for p in (None, {k.name: 1.3 * k.value})]
        cases += [(run, script, []), (run, script, [[k.slot, 1.3 * k.value]])]
    for truth, again in zip(truths, repeat(cases), strict=True):
        assert again.complete and again.steps < 5000, again.reason
        assert difference(truth, again) < AGREE, truth.flat.name


def test_start_values_that_contradict_each_other_with_other_parameters():
    """Python finds the nearest start then, by least squares; the page says that it does not."""
    dae = compiled(MODELS / "classic" / "car_axis.lmo")
    run = dae.simulate(points=5)
    script = write_script(run.trajectory)
    length = next(s for s in sliders(run.trajectory.observer, script.slots) if s.name == "L")
    first, other = repeat([(run, script, []), (run, script, [[length.slot, 1.15]])])
    assert first.complete and not other.complete and "the start value of xr contradicts others" in other.reason
    assert abs(dae.simulate(points=5, parameters={"L": 1.15})["xr"][0] - 1.15) > 1e-4


def test_one_slider_for_what_each_gives_to_an_array():
    """A tower of twenty floors has the masses, stiffnesses and dampings of its floors once, not twenty times."""
    dae = lmoc.compile(Path(__file__).parents[1] / "data" / "pictures" / "tower20.lmo")
    run = dae.simulate(stop=3, points=30, rtol=1e-8)
    script = write_script(run.trajectory)
    found = {s.name: s for s in changeable(run, script)}
    assert {"floor.m", "storey.k", "storey.c", "tuned.m", "hanger.k"} <= set(found) and len(found) < 12
    cases, truths = [], []
    for name in ("floor.m", "storey.k"):
        slider = found[name]
        assert len(slider.alike) == 19
        truths.append(dae.simulate(stop=3, points=30, rtol=1e-8, parameters={name: 1.3 * slider.value}))
        cases.append((truths[-1], script, [[slot, 1.3 * slider.value] for slot in (slider.slot, *slider.alike)]))
    for truth, again in zip(truths, repeat(cases), strict=True):
        assert again.complete, again.reason
        assert difference(truth, again) < AGREE


def test_elements_with_values_of_their_own_have_their_own_sliders():
    text = """model Chain
      Fixed wall; Mass one[3](m = {1, 2, 3}), same[3](m = {2, 2, 2}), given[3](each m = 2);
      Spring spring[9](each k = 50);
    equation
      for i in 1:3 loop
        connect(wall.flange, spring[i].a); connect(spring[i].b, one[i].flange);
        connect(one[i].flange, spring[3 + i].a); connect(spring[3 + i].b, same[i].flange);
        connect(same[i].flange, spring[6 + i].a); connect(spring[6 + i].b, given[i].flange);
      end for;
    end Chain;"""
    run = lmoc.compile_text(text, parameters={"given[2].m": 5.0}).simulate(stop=0.1, points=3)
    names = {s.name for s in changeable(run, write_script(run.trajectory))}
    assert "spring.k" in names and "spring[1].k" not in names
    assert {f"{part}[{i}].m" for part in ("one", "same", "given") for i in (1, 2, 3)} <= names
