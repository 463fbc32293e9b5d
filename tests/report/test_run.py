"""The result of a run: every variable by name, tables, files and pictures."""

import numpy as np
import pytest
from conftest import SPRING
from oracles.models import compiled
from test_dae import CHAIN

import lmoc
from lmoc.ir.names import UnknownNameError, patterns, summarised
from lmoc.report import summary
from lmoc.report.units import _per_second


@pytest.fixture(scope="module")
def run():
    return lmoc.compile_text(SPRING).simulate(rtol=1e-9, inputs={"f": "sin(time)"})


@pytest.fixture(scope="module")
def chain():
    return lmoc.compile_text(CHAIN).simulate(stop=2, initial={"m[1].q": 1}, rtol=1e-9)


def test_every_variable_can_be_asked_for(run):
    assert run.time.shape == (501,)
    assert np.array_equal(run["time"], run.time)
    assert run["f"] == pytest.approx(np.sin(run.time))
    assert run["spring.f"] == pytest.approx(8 * run["body.q"], abs=1e-9)
    assert run["wall.flange.f"] == pytest.approx(run["spring.f"], abs=1e-9)
    assert run["body.a"] == pytest.approx((run["f"] - run["spring.f"]) / 2, abs=1e-9)
    assert run["body.energy"] == pytest.approx(run["body.v"] ** 2, abs=1e-9)
    assert np.all(run["spring.k"] == 8)
    for name in lmoc.compile_text(SPRING).variables:
        assert np.isfinite(run[name]).all(), name


def test_what_is_no_name_is_refused(run):
    with pytest.raises(TypeError, match="names of variables, .* not by 3"):
        run[3]
    with pytest.raises(KeyError):
        lmoc.compile_text(SPRING).parameters[3]


def test_states_can_be_asked_for_by_the_names_they_are_told_by(run):
    for name in run.states:
        assert run[name].shape == run.time.shape


def test_arrays_are_two_dimensional(chain):
    assert chain["m[2].q"].shape == (501,)
    assert chain["m.q"].shape == (501, 3)
    assert chain["m[2:3].q"].shape == (501, 2)
    assert np.array_equal(chain["m.q"][:, 1], chain["m[2].q"])
    assert chain["m[2:2].q"].shape == (501, 1)


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("body.qq", "body.q"),
        ("body", "body.m, body.g"),
        ("bdy.q", "body.q"),
        ("xyzzy", "there is no variable 'xyzzy'"),
    ],
)
def test_unknown_names_are_key_errors_with_a_hint(run, name, hint):
    assert name not in run
    with pytest.raises(KeyError) as caught:
        run[name]
    assert isinstance(caught.value, UnknownNameError)
    assert hint in str(caught.value)


def test_an_index_out_of_range_is_told(chain):
    with pytest.raises(KeyError, match="from 1 to 3"):
        chain["m[4].q"]


def test_the_energy_balance_closes(run):
    energy = run.energy
    assert energy.balance < 1e-6
    assert energy.stored == pytest.approx(run["spring.energy"] + run["body.energy"], abs=1e-12)
    assert energy.lost == pytest.approx(0, abs=1e-12)
    assert energy.supplied[0] == 0


def test_units_follow_derivatives(run):
    assert run.unit("x") == "m"
    assert run.unit("spring.f") == "N"
    assert run.unit("der(x)") == "m/s"
    assert [_per_second(u) for u in ("m", "m/s", "m/s2", "1", "J")] == ["m/s", "m/s2", "m/s3", "1/s", "J/s"]


def test_tables_as_files(run, tmp_path):
    names = ["x", "spring.f"]
    run.save(tmp_path / "run.csv", names)
    csv = np.genfromtxt(tmp_path / "run.csv", delimiter=",", names=True, deletechars="")
    assert csv.dtype.names == ("time", "x", "spring.f")
    assert np.array_equal(csv["x"], run["x"])

    run.save(tmp_path / "run.npz")
    with np.load(tmp_path / "run.npz") as npz:
        assert np.array_equal(npz["spring.f"], run["spring.f"])
        assert np.array_equal(npz["time"], run.time)


def trajectory(path):
    """A result as the viewers of Dymola and OpenModelica read it: texts in columns, variables in rows of two tables."""
    from scipy.io import loadmat

    mat = loadmat(path, chars_as_strings=False)
    assert ["".join(row).strip() for row in mat["Aclass"]] == ["Atrajectory", "1.1", "", "binTrans"]
    names, texts = (["".join(column).strip() for column in mat[key].T] for key in ("name", "description"))
    rows = {n: mat[f"data_{table or 2}"][row - 1] for n, (table, row, *_) in zip(names, mat["dataInfo"].T, strict=True)}
    assert np.array_equal(mat["data_1"][0], rows["time"][[0, -1]])
    return rows, dict(zip(names, texts, strict=True))


def test_mat_is_what_dymola_and_openmodelica_write(run, tmp_path):
    names = ["x", "spring.f", "spring.k"]
    rows, texts = trajectory(run.save(tmp_path / "run.mat", names))
    assert list(rows) == ["time", *names] and np.array_equal(rows["time"], run.time)
    assert np.array_equal(rows["spring.f"], run["spring.f"]) and rows["spring.k"].tolist() == [8, 8]
    assert texts["time"] == "Time [s]" and texts["spring.f"].endswith("[N]")


def test_parquet_is_written_or_the_missing_package_named(run, tmp_path):
    pytest.importorskip("pandas")
    try:
        import pyarrow  # noqa: F401
    except ImportError:
        with pytest.raises(lmoc.ModelError, match="pyarrow"):
            run.save(tmp_path / "run.parquet")
    else:
        import pandas

        run.save(tmp_path / "run.parquet")
        assert np.array_equal(pandas.read_parquet(tmp_path / "run.parquet")["x"], run["x"])


def test_a_dataframe_has_time_as_index(run):
    frame = run.to_dataframe(["x"])
    assert list(frame.columns) == ["x"]
    assert frame.index.name == "time"
    assert {"x", "f", "spring.f", "body.v"} <= set(run.to_dataframe().columns)


@pytest.mark.parametrize(("path", "code"), [("run.xlsx", "E0624"), ("run", "E0624"), ("no/run.csv", "E0623")])
def test_targets_that_cannot_be_written(run, tmp_path, path, code):
    with pytest.raises(lmoc.ModelError) as caught:
        run.save(tmp_path / path)
    assert caught.value.diagnostics[0].code == code


def test_pictures(run, chain, tmp_path):
    figure = run.plot(path=tmp_path / "run.png")
    assert (tmp_path / "run.png").stat().st_size > 10_000
    labels = [axis.get_ylabel() for axis in figure.axes]
    assert labels == ["position in m", "force in N", "energy in J"]
    assert figure.axes[-1].get_xlabel() == "time in s"
    by_unit = run.plot(["x", "body.v", "spring.f"])
    assert [axis.get_ylabel() for axis in by_unit.axes] == ["position in m", "velocity in m/s", "force in N"]
    chain.plot(["m.q"], tmp_path / "chain.svg")
    assert "m[3].q" in (tmp_path / "chain.svg").read_text()


def test_names_of_arrays_are_put_together():
    names = [f"m[{i}].{x}" for x in "qv" for i in range(1, 101)]
    assert summarised(["a.q", *names]) == ["a.q", "m[1:100].q", "m[1:100].v"]
    assert summarised(["m[1].q", "m[2].q", "m[4].q"]) == ["m[1].q", "m[2].q", "m[4].q"]
    assert summarised([f"a[1,{j}].q" for j in range(1, 5)]) == ["a[1,1:4].q"]
    assert len(summarised([f"part{i}.q" for i in range(100)], most=12)) == 12


def test_a_run_keeps_only_what_is_asked_for() -> None:
    dae = lmoc.compile_text("model M parameter Integer N = 4; Mass m[N](each m = 1, v(each start = 1)); end M;")
    run = dae.simulate(stop=1, points=3, keep=["m[2].q"])
    assert run["m[2].q"] == pytest.approx([0, 0.5, 1])
    assert list(run.columns()) == ["time", *run.final] == ["time", "m[2].q"]
    assert run.energy.balance < 1e-9
    with pytest.raises(KeyError, match="not kept"):
        run["m[3].q"]
    with pytest.raises(lmoc.ModelError, match="did you mean 'm.q'"):
        dae.simulate(keep=["m.qq"])


REST = """model M Mass m(m = 2, g = -9.81); Spring s(k = 10); Fixed f; {}
equation connect(f.flange, s.a); connect(s.b, m.flange); end M;"""


def test_derivatives_of_derivatives_that_are_states():
    run = lmoc.compile_text(REST.format("")).simulate(stop=1)
    assert np.array_equal(run["der(m.v)"], run["m.a"])
    assert np.array_equal(run["der(m.q)"], run["m.v"])


def test_a_start_at_rest_given_by_derivatives():
    """The second derivative of a position is that of a velocity, which is a state itself."""
    for given in ("der(m.q) = 0; der(m.v) = 0;", "m.v = 0; der(m.v) = 0;", "der(m.v) = 0;", "m.v = 0; m.a = 0;"):
        run = lmoc.compile_text(REST.format("initial equation " + given)).simulate(stop=1)
        assert run["m.q"] == pytest.approx(-2 * 9.81 / 10), given


def test_names_of_large_arrays_are_put_together_without_making_them(chain):
    flat = chain.flat
    assert patterns(flat, flat.find("m.q")) == ["m[1:3].q"]
    assert patterns(flat, flat.find("m[2:3].q")) == ["m[2:3].q"]
    assert patterns(flat, flat.find("m.q")[[0, 2]]) == ["m[1].q", "m[3].q"]
    both = np.ravel([flat.find("m.q"), flat.find("m.v")], order="F")
    assert patterns(flat, both, np.tile([0, 1], 3)) == ["m[1:3].q", "der(m[1:3].v)"]
    assert patterns(flat, flat.find("wall.flange.q")) == ["wall.flange.q"]


ELECTRICAL = """
package El
  connector Pin Real v(unit = "V"); flow Real i(unit = "A"); end Pin;
  partial model TwoPin Pin p, n; Real v; Real i; equation v = p.v - n.v; p.i + n.i = 0; i = p.i; end TwoPin;
  model Resistor extends TwoPin; parameter Real R; equation v = R*i; end Resistor;
  model Coil extends TwoPin; parameter Real L; equation v = L*der(i); end Coil;
  model Source extends TwoPin; input Real u; equation v = u; end Source;
  model Ground Pin p; equation p.v = 0; end Ground;
end El;
"""
MOTOR = """
model Machine extends El.TwoPin; Shaft shaft; parameter Real k; equation v = k*der(shaft.theta); shaft.tau = -k*i;
end Machine;
model M
  El.Source s(u = if time < 1 then 5 else 2*time); El.Resistor r(R = 2); El.Coil l(L = 0.1); El.Ground g;
  Machine e(k = 0.5); Inertia J(J = 0.3); TorsionDamper d(c = 0.05); FixedShaft f;
equation
  connect(s.p, r.p); connect(r.n, l.p); connect(l.n, e.p); connect(e.n, s.n); connect(g.p, s.n);
  connect(e.shaft, J.shaft); connect(J.shaft, d.b); connect(d.a, f.shaft);
end M;
"""


def test_the_power_of_electrical_ports_is_current_times_voltage():
    """Parts that state nothing are sources of what comes out of their ports, whatever its kind."""
    run = lmoc.compile_text(ELECTRICAL + MOTOR).simulate(stop=2, rtol=1e-8)
    assert run["r.power"] == pytest.approx(-2 * run["l.i"] ** 2, abs=1e-9)
    assert run["s.power"] == pytest.approx(run["s.u"] * run["l.i"], abs=1e-9)
    assert run["e.power"] == pytest.approx(0, abs=1e-9)
    assert run.energy.balance < 1e-7


def test_a_scene_in_which_nothing_states_its_energy_has_an_empty_ledger():
    run = lmoc.compile_text(
        ELECTRICAL
        + """
        model M El.Source s(u = 5); El.Resistor r(R = 2); El.Coil l(L = 0.1); El.Ground g;
        equation connect(s.p, r.p); connect(r.n, l.p); connect(l.n, s.n); connect(g.p, s.n); end M;"""
    ).simulate(stop=1)
    assert run["l.i"] == pytest.approx(2.5 * (1 - np.exp(-20 * run.time)), abs=1e-5)
    assert run["r.power"] == pytest.approx(-2 * run["l.i"] ** 2, abs=1e-9)
    assert run.energy.balance == 0
    assert summary.energy_text(run) == "none stored, supplied or lost"
    assert [axis.get_ylabel() for axis in run.plot().axes if "energy" in axis.get_ylabel()] == []


def test_the_work_of_a_callable_that_moves_a_base_is_known():
    """The force needs no derivative of the motion; the power of the source does, and differences serve for that."""
    dae = lmoc.compile_text("""model M input Real u; Motion base(q = u); Spring s(k = 4); Mass m(m = 1);
        equation connect(base.flange, s.a); connect(s.b, m.flange); end M;""")
    run = dae.simulate(stop=2, inputs={"u": np.sin}, rtol=1e-9)
    t = run.time
    assert run["m.q"] == pytest.approx((4 * np.sin(t) - 2 * np.sin(2 * t)) / 3, abs=1e-7)
    exact = dae.simulate(stop=2, inputs={"u": "sin(time)"}, rtol=1e-9)
    assert run.energy.balance < 1e-8 and run.energy.supplied == pytest.approx(exact.energy.supplied, abs=1e-9)

    def careful(t):
        assert 0 <= t <= 2
        return np.sin(t)

    assert dae.simulate(stop=2, inputs={"u": careful}).energy.balance < 1e-5


def test_a_callable_that_would_have_to_give_an_acceleration_is_refused():
    dae = lmoc.compile_text("""model M input Real u; Motion base(q = u); Mass m(m = 1); output Real f = base.flange.f;
        equation connect(base.flange, m.flange); end M;""")
    with pytest.raises(lmoc.ModelError, match=r"derivative\(n\)"):
        lmoc.compile_text("""model M input Real u; Motion base(q = u); Damper d(c = 1); Mass m(m = 1);
            equation connect(base.flange, d.a); connect(d.b, m.flange); end M;""").simulate(inputs={"u": np.sin})
    run = dae.simulate(inputs={"u": np.sin})
    assert np.isnan(run["f"]).all() and [n.code for n in run.notes] == ["N0523"]


def test_one_name_is_as_good_as_a_list(run, tmp_path):
    assert [line.get_label() for line in run.plot("x").axes[0].lines[:1]] == ["x"]
    assert list(run.columns("x")) == ["time", "x"] and list(run.to_dataframe("x").columns) == ["x"]
    assert run.save(tmp_path / "x.csv", "x").read_text().startswith("time,x\n")
    model = "model M Real x(start = 1, fixed = true), y; equation der(x) = -x; y = 2*x; end M;"
    assert lmoc.compile_text(model, states="y").states == ["y"]


def test_the_energy_in_a_line(run):
    assert str(run.energy) == summary.energy_text(run) and "\n" not in str(run.energy)
    assert "balance error" in repr(run.energy) and repr(run.energy).startswith("<Energy: ")


def test_eight_curves_are_told_apart():
    names = [f"y{k}" for k in range(10)]
    text = "".join(f"output Real {name} = {k} + time;" for k, name in enumerate(names))
    scene = f"model M {text} Real x(start=1, fixed=true); equation der(x) = -x; end M;"
    figure = lmoc.compile_text(scene).simulate().plot()
    looks = [(line.get_color(), line.get_linestyle()) for line in figure.axes[0].lines]
    assert len(set(looks[:10])) == 10


def test_axes_say_the_quantity_or_the_name():
    scene = """model M input Real u(unit = "N") = sin(time); output Real i(unit = "A") = x; output Real j = 2*x;
        output Real w(unit = "cd") = x; parameter Real c = 1; Real x(start = 1, fixed = true);
        equation der(x) = -c*x; end M;"""
    labels = [axis.get_ylabel() for axis in lmoc.compile_text(scene).simulate().plot().axes]
    assert labels[:4] == ["current in A", "j", "w in cd", "force in N"]


def test_panels_that_do_not_fit_are_named():
    units = ["m", "s", "kg", "A", "K", "mol", "cd"]
    text = "".join(f'output Real y{k}(unit = "{unit}") = time;' for k, unit in enumerate(units))
    figure = lmoc.compile_text(f"model M {text} end M;").simulate().plot()
    assert len(figure.axes) == 5 and "y5, y6" in figure.axes[-1].get_xlabel()


@pytest.mark.parametrize("ending", [".csv", ".npz", ".mat"])
def test_every_name_can_be_saved(tmp_path, ending):
    names = ["file", "allow_pickle", "names", "data", "args", "compress", "self"]
    declared = "".join(f"output Real {name} = time + {k};" for k, name in enumerate(names))
    quoted = "Real 'a \"b\", c' = 5*time;"
    run = lmoc.compile_text(f"model M {declared} {quoted} Real x(start=1, fixed=true); equation der(x) = -x; end M;")
    run = run.simulate(stop=1, points=3)
    path = run.save(tmp_path / f"all{ending}")
    if ending == ".npz":
        with np.load(path) as kept:
            found = {name: kept[name] for name in kept.files}
    elif ending == ".mat":
        found = trajectory(path)[0]
    else:
        import pandas

        found = pandas.read_csv(path).to_dict("list")
    assert set(names) <= set(found) and set(found) == set(run.columns())
    for k, name in enumerate(names):
        assert found[name] == pytest.approx(run.time + k)


@pytest.mark.parametrize("scene", ["s3_1_cubic_spring", "s3_2_spring_left_of_mass", "ex08_cable_around_cylinder"])
def test_the_energy_balance_does_not_depend_on_what_is_kept(scene):
    dae = compiled(f"notes/{scene}")
    whole, kept = dae.simulate(), dae.simulate(keep=[dae.states[0]])
    assert kept.energy.exchanged == pytest.approx(whole.energy.exchanged)
    assert kept.energy.balance == pytest.approx(whole.energy.balance)


def test_a_scene_that_only_coasts_is_judged_by_what_it_stores():
    dae = lmoc.compile_text("model M Inertia d(J = 2, omega(start = 0.331, fixed = true)); end M;")
    assert dae.simulate(solver="cvode").energy.balance < 1e-6


def test_an_input_without_signal_is_an_error_though_no_state_asks_for_it():
    dae = lmoc.compile_text("""
        model M input Real u(unit = "m"); Motion M(q = u); Mass m(m = 2); output Real F = M.flange.f;
        equation connect(M.flange, m.flange); end M;""")
    with pytest.raises(lmoc.ModelError) as caught:
        dae.simulate()
    assert [d.code for d in caught.value.diagnostics] == ["E0520"]
    assert dae.simulate(inputs={"u": "time^2"})["F"] == pytest.approx(-4)  # that on the part that moves it
    assert "W0524" in {note.code for note in dae.simulate(inputs={"u": "abs(time - 1)"}).notes}


def test_what_follows_from_parameters_alone_and_has_no_value_is_told():
    dae = lmoc.compile_text("""
        model M parameter Real a = 0; output Real y = 1/a; Real x(start = 1, fixed = true);
        equation der(x) = -x; end M;""")
    [note] = [n for n in dae.simulate(stop=1).notes if n.code == "W0537"]
    assert note.message == "y has no finite value (inf)"
    assert not [n for n in dae.simulate(stop=1, parameters={"a": 2}).notes if n.code == "W0537"]


def test_the_table_of_last_values_tells_of_those_left_out():
    """24 rows are shown; the others stand beside their number: 30 outputs are the positions, 30 velocities are left."""
    text = "model M Mass m[30](each m = 1); output Real y[30] = m.q; end M;"
    lines = summary.summary(lmoc.compile_text(text).simulate(stop=1)).splitlines()
    assert [line.split()[0] for line in lines[-25:-1]] == [f"y[{i}]" for i in range(1, 25)]
    assert lines[-1] == "  … and 36 more: y[25:30], m[1:30].v"
    plain = lmoc.compile_text("model M Mass m[13](each m = 1); end M;").simulate(stop=1)
    assert summary.summary(plain).splitlines()[-1] == "  … and 2 more: m[13].q, m[13].v"
    small = lmoc.compile_text("model M Mass m[12](each m = 1); end M;").simulate(stop=1)
    assert "more" not in summary.summary(small)


SHAKEN = """model M Mass m(m = 1, q(fixed = true), v(fixed = true)); Spring s(k = 10000); Damper d(c = 1); Fixed w;
    Force f(f = sin(314.159*time)); output Real x = m.q; equation connect(w.flange, s.a); connect(s.b, m.flange);
    connect(w.flange, d.a); connect(d.b, m.flange); connect(f.flange, m.flange); end M;"""


@pytest.mark.parametrize("solver", ["auto", "taylor", "gauss"])
def test_a_picture_is_drawn_from_the_steps_and_the_table_says_that_it_is_coarse(solver):
    """50 Hz and 62 points a second: seen through the table it would be 12 Hz."""
    dae = lmoc.compile_text(SHAKEN)
    run = dae.simulate(stop=1, points=63, solver=solver, parameters={"d.c": 10})
    assert [n.code for n in run.notes] == ["N0528"] and "--points" in run.notes[0].hint
    drawn = run.plot("x").axes[0].lines[0]
    times, values = drawn.get_xdata(), drawn.get_ydata()
    late = times > 0.5
    turns = (np.diff(np.sign(np.diff(values[late]))) != 0).sum()
    assert turns == pytest.approx(50, rel=0.02)  # two a period, in half a second
    assert np.isin(run.time, times).all()
    assert values[np.searchsorted(times, run.time)] == pytest.approx(run["x"], abs=1e-9)
    points = int(run.notes[0].hint.split()[-1].strip("(points=)"))
    assert not dae.simulate(stop=1, points=points, solver=solver, parameters={"d.c": 10}).notes


def test_a_smooth_run_a_few_samples_and_a_copy_are_drawn_as_they_are(run):
    import pickle

    assert run.fine is run
    few = lmoc.compile_text(SHAKEN).simulate(times=[1.0, 2.0, 8.0])
    assert not few.notes and len(few.fine.time) > 1000
    copy = pickle.loads(pickle.dumps(lmoc.compile_text(SHAKEN).simulate(stop=8)))
    assert copy.fine is copy and len(copy.plot("x").axes[0].lines[0].get_xdata()) == 501


def test_a_balance_that_the_tolerance_does_not_explain_is_a_warning():
    scene = """model M Fixed w; Spring s(k = 4); Mass m(m = 1, q(start = 1, fixed = true));
    equation connect(w.flange, s.a); connect(s.b, m.flange); end M;"""
    assert not [n for n in lmoc.compile_text(scene).simulate().notes if n.code == "W0553"]
    from lmoc.numerics.observe.energy import Energy
    from lmoc.report.balance import unbalanced

    one, zero = np.array([1.0, 0.8]), np.zeros(2)
    assert "does not close: 20 %" in unbalanced(Energy(one, zero, zero, 1.0), 1e-6).message
    assert unbalanced(Energy(np.array([1.0, 0.9999]), zero, zero, 1.0), 1e-6) is None
    assert unbalanced(None, 1e-6) is None


def test_a_balance_is_judged_between_output_times_that_happen_to_be_at_whole_periods():
    scene = """model M Spring s(k = (2*3.14159265358979)^2); Mass m(m = 1); Fixed w;
    Force f(f = if time < 1 then 0 else 5);
    equation connect(w.flange, s.a); connect(s.b, m.flange); connect(f.flange, m.flange); end M;"""
    run = lmoc.compile_text(scene).simulate(stop=10, points=3)  # at 5 and 10 s the mass is back where it was pushed
    assert abs(run["m.q"][-1]) < 1e-5
    assert run.energy.balance < 1e-4 and not [n for n in run.notes if n.code == "W0553"]


def test_names_in_a_picture_are_no_formulas_and_leave_room_for_the_curves(tmp_path):
    long = "x" * 300
    text = f"""model M "costs $5, or $x_{{1$" Real 'a$b$c'(start = 1, fixed = true), {long}(start = 1, fixed = true);
      equation der('a$b$c') = -'a$b$c'; der({long}) = -{long}; end M;"""
    figure = lmoc.compile_text(text).simulate().plot(path=tmp_path / "names.png")
    labels = [line.get_label() for line in figure.axes[0].lines if line.get_label()[0] != "_"]
    assert labels[0] == "'a$b$c'" and len(labels[1]) < 40
    assert figure.axes[0].get_window_extent().width > 600


def test_a_model_without_anything_to_draw_is_told():
    with pytest.raises(lmoc.ModelError, match="there is nothing to draw"):
        lmoc.compile_text("model Empty end Empty;").simulate().plot()
