"""The command `lmoc`: what it prints, where, and with which exit code."""

import json
import math

import numpy as np
import pytest
from conftest import ROOT


def test_without_arguments_it_tells_its_verbs(lmoc):
    answer = lmoc()
    assert answer.code == 0
    assert all(verb in answer.out for verb in ("run", "check", "show", "fmt", "equations", "explain"))


def test_version(lmoc):
    import lmoc as package

    assert lmoc("--version").out == f"lmoc {package.__version__}\n"


@pytest.mark.parametrize(
    ("words", "code", "help"),
    [
        (["rnu", "a.lmo"], "E0620", "did you mean 'run'?"),
        (["scene.lmo"], "E0620", "lmoc run scene.lmo"),
        (["run"], "E0620", "FILE"),
        (["run", "a.lmo", "b.lmo"], "E0620", "'b.lmo' is one argument too many"),
        (["run", "a.lmo", "--sotp", "3"], "E0620", "did you mean '--stop'?"),
        (["run", "--sotp=3"], "E0620", "did you mean '--stop'?"),
        (["run", "a.lmo", "--stop", "soon"], "E0621", "'soon' is not a number"),
        (["run", "a.lmo", "--stop", "inf"], "E0621", "finite"),
        (["run", "a.lmo", "--points", "1"], "E0621", "at least 2"),
        (["run", "a.lmo", "--rtol", "-1"], "E0621", "above zero"),
        (["run", "a.lmo", "--solver", "dop835"], "E0621", "did you mean 'dop853'?"),
        (["run", "a.lmo", "--solver", "ode45"], "E0621", "'dop853' is the method of that kind here"),
        (["run", "a.lmo", "--solver", "RK4"], "E0621", "did you mean 'rk4'?"),
        (["run", "a.lmo", "--solver", "ode15s"], "E0621", "'cvode' is the method of that kind here"),
        (["run", "a.lmo", "--solver", "DASSL"], "E0621", "'ida' is the method of that kind here"),
        (["run", "a.lmo", "--formulation", "hht"], "E0626", "reduced, projected"),
        (["run", "a.lmo", "--formulation", "ggl", "--solver", "dop853"], "E0626", "expected: auto, ida"),
        (["run", "a.lmo", "--set", "k"], "E0621", "expected name=value"),
        (["run", "a.lmo", "--set", "k=stiff"], "E0621", "k: 'stiff' is not a number"),
        (["check", "a.lmo", "--set", "k=1:1:3"], "E0621", "k: expected one value, found '1:1:3'"),
        (["run", "a.lmo", "-o", "out.xls"], "E0624", ".csv"),
        (["run", "a.lmo", "-o", "nowhere/out.csv"], "E0623", "no folder 'nowhere'"),
        (["run", "a.lmo", "--plot", "out.doc"], "E0624", ".png"),
        (["show", "a.lmo", "--stage", "flaten"], "E0621", "did you mean 'flatten'?"),
        (["explain", "E9999"], "E0620", "E9999"),
    ],
)
def test_a_wrong_command_is_explained(lmoc, words, code, help):
    answer = lmoc(*words)
    assert answer.code == 2
    assert answer.out == ""
    assert f"error[{code}]" in answer.err
    assert help in answer.err


@pytest.mark.parametrize(
    ("words", "code"),
    [(["--start", "2", "--stop", "1"], "E0541"), (["--rtol", "2"], "E0541"), (["--input", "f=sin(tme)"], "E0521")],
)
def test_options_that_do_not_fit_the_model_are_mistakes_of_the_command(lmoc, scene, words, code):
    answer = lmoc("run", scene, *words)
    assert (answer.code, f"error[{code}]" in answer.err) == (2, True)


def test_unreadable_files_are_named(lmoc, tmp_path, scene):
    (tmp_path / "picture.lmo").write_bytes(b"\x89PNG\0\1")
    (tmp_path / "latin.lmo").write_bytes("model M \"Tür\"\nend M;".encode("latin-1"))
    for name, code, help in [
        ("osillator.lmo", "E0610", "did you mean 'oscillator.lmo'?"),
        ("no/where.lmo", "E0610", "no folder 'no'"),
        (".", "E0611", "oscillator.lmo"),
        ("picture.lmo", "E0612", "binary"),
        ("latin.lmo", "E0612", "byte 0xfc in line 1"),
    ]:
        answer = lmoc("run", name)
        assert answer.code == 2
        assert f"error[{code}]" in answer.err
        assert help in answer.err


def test_solvers_prints_their_table(lmoc):
    from lmoc.numerics.problem.base import HEAD
    from lmoc.numerics.steps.choice import table

    lines = lmoc("solvers").out.splitlines()
    assert all(any(line.startswith(one.name + " ") for line in lines) for one in table())
    gauss = lmoc("solvers", "gauss").out
    assert all(name in gauss for name in HEAD) and "conservative scenes" in gauss
    rows = json.loads(lmoc("solvers", "--json").out)
    assert [row["name"] for row in rows if row["symplectic"] == "yes"] == ["gauss", "midpoint", "verlet", "collocation"]
    wrong = lmoc("solvers", "gaus")
    assert wrong.code == 2 and "did you mean 'gauss'?" in wrong.err


def test_explain_prints_a_page(lmoc):
    answer = lmoc("explain", "e0612")
    assert answer.code == 0
    assert "UTF-8" in answer.out


def test_an_internal_error_is_owned_up_to(lmoc, scene, monkeypatch):
    from lmoc import pipeline

    def broken(*_):
        raise ZeroDivisionError("in a stage")

    monkeypatch.setattr(pipeline, "open_scene", broken)
    answer = lmoc("check", scene)
    assert answer.code == 70
    assert "mistake in lmoc, not in your model" in answer.err
    assert "Traceback" not in answer.err
    monkeypatch.setenv("LMOC_TRACEBACK", "1")
    assert "Traceback" in lmoc("check", scene).err


def test_run_tells_what_was_solved_and_where_it_ended(lmoc, scene):
    answer = lmoc("run", scene)
    assert answer.code == 0
    assert answer.err == ""
    for words in ("Oscillator: A mass on a spring", "4 parts", "2 states", "balance error", "at t = 3 s"):
        assert words in answer.out


def test_states_are_preferred_where_it_matters_what_is_solved(lmoc):
    model = ROOT / "models/notes/ex09_gear_pair_with_load.lmo"
    asked = ["--states", "gear2.theta"]
    assert "states    gear2.theta," in lmoc("run", model, *asked).out
    assert "gear2.theta" not in json.loads(lmoc("run", model, "--json").out)["states"]
    assert lmoc("check", model, *asked).code == 0
    assert "gear2.theta" in lmoc("show", model, "--stage", "reduce", *asked).out.split("\n\n")[1]
    for verb in ("run", "check"):
        answer = lmoc(verb, model, "--states", "gear2.thet")
        assert answer.code == 2 and "error[E0414]" in answer.err


def test_run_as_json(lmoc, scene):
    data = json.loads(lmoc("run", scene, "--json", "--rtol", "1e-9").out)
    assert data["final"]["x"] == pytest.approx(0.5 * math.cos(2 * 3), abs=1e-7)
    assert data["units"]["x"] == "m"
    assert data["counts"]["states"] == 2
    assert data["energy"]["balance"] < 1e-7


def test_quiet_prints_nothing(lmoc, scene):
    assert lmoc("run", scene, "--quiet") == (0, "", "")


def test_options_reach_the_run(lmoc, scene, tmp_path):
    words = "--stop 2 --points 5 --set k=18 --set body.m=2 --init body.q=0.1 --input f=36*time --rtol 1e-9 -o out.csv"
    assert lmoc("run", scene, *words.split(), "--quiet").code == 0
    table = np.genfromtxt(tmp_path / "out.csv", delimiter=",", names=True, deletechars="")
    t = np.linspace(0, 2, 5)
    assert np.array_equal(table["time"], t)
    expected = 0.1 * np.cos(3 * t) + 2 * (t - np.sin(3 * t) / 3)
    assert table["x"] == pytest.approx(expected, abs=1e-7)


def test_a_table_as_input(lmoc, scene, tmp_path):
    (tmp_path / "push.csv").write_text("time,f\n" + "".join(f"{t},{4 * t}\n" for t in range(5)))
    answer = lmoc("run", scene, "--input", "f=push.csv", "--init", "body.q=0", "--rtol", "1e-9", "--json")
    assert json.loads(answer.out)["final"]["x"] == pytest.approx(0.5 * (3 - math.sin(6) / 2), abs=1e-7)


@pytest.mark.parametrize(
    ("words", "code", "help"),
    [
        (["--set", "body.mass=2"], "E0622", "body.m"),
        (["--set", "m=3"], "E0622", "did you mean body.m?"),
        (["--set", "body.q=1"], "E0622", "--init body.q=1, or initial={'body.q': 1}"),
        (["--set", "body.q=1"], "E0622", "Mass body(m = 2, q(start"),
        (["--set", "f=1"], "E0622", "--input f=1"),
        (["--init", "body.m=1"], "E0534", "--set body.m=1"),
        (["--init", "q=1"], "E0622", "did you mean body.q?"),
        (["--init", "body=1"], "E0622", "'body' is a part; it has body.q"),
        (["--set", "x=2"], "E0622", "x"),
        (["--init", "bdy.q=2"], "E", "body.q"),
        (["--input", "g=2"], "E0622", "the inputs are f"),
        (["--input", "f=2*tiem"], "E0521", "time"),
        (["--input", "f=push.csv"], "E0610", "push.csv"),
        (["--input", "f=wrong.csv"], "E0625", "columns 'time' and 'f'"),
    ],
)
def test_names_and_signals_that_are_not_in_the_model(lmoc, scene, tmp_path, words, code, help):
    (tmp_path / "wrong.csv").write_text("seconds,newton\n0,1\n")
    answer = lmoc("run", scene, *words)
    assert answer.code in (1, 2)
    assert f"error[{code}" in answer.err
    assert help in answer.err


@pytest.mark.parametrize(
    ("port", "hint"),
    [
        ("body", "'body' is a part; did you mean body.flange?"),
        ("spring", "'spring' is a part; did you mean spring.a or spring.b?"),
        ("body.flang", "did you mean 'body.flange'?"),
        ("body.q", "there are body.flange"),
        ("xyz", "there are wall.flange, spring.a, spring.b"),
    ],
)
def test_a_port_is_named_where_a_part_was_given(lmoc, scene, port, hint):
    answer = lmoc("equivalent", scene, port)
    assert "error[E0661]" in answer.err and hint in answer.err


def test_check_says_that_all_is_well(lmoc, scene):
    answer = lmoc("check", scene)
    assert answer.code == 0
    assert "no errors" in answer.out
    assert json.loads(lmoc("check", scene, "--json").out) == []


def test_check_finds_what_run_would_stumble_over(lmoc, scene):
    scene.write_text(scene.read_text().replace("output Real x", "Spring more;\n  output Real x"))
    for verb in ("check", "run"):
        answer = lmoc(verb, scene)
        assert answer.code == 1
        assert "more" in answer.err
    said = json.loads(lmoc("check", scene, "--json").out)
    assert all({"code", "severity", "message"} <= set(d) for d in said)


@pytest.mark.parametrize("stage", ["parse", "instantiate", "flatten", "reduce", "lower"])
def test_every_stage_can_be_shown(lmoc, scene, stage):
    answer = lmoc("show", scene, "--stage", stage)
    assert answer.code == 0
    assert "Oscillator" in answer.out


@pytest.mark.parametrize("name", ["h07_ball_on_string", "h17_backlash", "h19_bouncing_ball", "friction_stop"])
@pytest.mark.parametrize("stage", ["reduce", "lower"])
def test_every_stage_of_a_scene_with_laws_and_events_can_be_shown(lmoc, name, stage):
    """The run sets the modes of laws and the values of relations: nobody else has to give them."""
    answer = lmoc("show", ROOT / "models" / "laws" / f"{name}.lmo", "--stage", stage)
    assert answer.code == 0, answer.err
    assert "parameters" in answer.out and not answer.err


def test_the_jacobian_of_a_chain_is_shown_as_it_is_stored(lmoc, tmp_path):
    """Sorted by reverse Cuthill–McKee, a chain has a narrow band whatever the order of its states."""
    (tmp_path / "chain.lmo").write_text(
        "model Chain Fixed w; Mass m[200](each m = 1); Spring s[200](each k = 1); equation connect(w.flange, s[1].a); "
        "for i in 1:199 loop connect(m[i].flange, s[i+1].a); end for; "
        "for i in 1:200 loop connect(s[i].b, m[i].flange); end for; end Chain;"
    )
    (line,) = [x for x in lmoc("show", "chain.lmo", "--stage", "lower").out.splitlines() if "Jacobian" in x]
    from lmoc import compile

    stored = compile(tmp_path / "chain.lmo").simulate(stop=0.01, solver="cvode").stats["matrix"]
    assert stored == "band of 2 + 1 + 2, reverse Cuthill–McKee" and line.endswith(stored)


def test_show_puts_arrays_together(lmoc, tmp_path):
    (tmp_path / "chain.lmo").write_text(
        "model Chain\n  Fixed wall;\n  Mass m[100](each m = 1);\n  Spring s[100](each k = 1);\nequation\n"
        "  connect(wall.flange, s[1].a);\n  for i in 1:99 loop\n    connect(m[i].flange, s[i+1].a);\n  end for;\n"
        "  for i in 1:100 loop\n    connect(s[i].b, m[i].flange);\n  end for;\nend Chain;\n"
    )
    flat = lmoc("show", "chain.lmo").out
    assert "m[1:100].v = der(m[1:100].q)   (100 equations)" in flat
    assert len(flat.splitlines()) < 200
    assert "200" in lmoc("show", "chain.lmo", "--stage", "reduce").out


def test_an_interrupted_run_keeps_what_it_has(lmoc, scene, tmp_path, monkeypatch):
    from lmoc.cli.progress import Progress
    from lmoc.numerics.problem.base import Watch

    def interrupt(self, simulated, stop):
        if simulated > 100:
            raise KeyboardInterrupt

    monkeypatch.setattr(Watch, "EVERY", 0.0)
    monkeypatch.setattr(Progress, "reached", interrupt)
    answer = lmoc("run", scene, "--stop", 1e4, "--points", 10001, "-o", "kept.csv")
    assert answer.code == 130 and "it was interrupted" in answer.err and "Traceback" not in answer.err
    assert "s, where the run broke off" in answer.out
    assert 100 <= len((tmp_path / "kept.csv").read_text().splitlines()) < 10001


def test_a_failing_run_keeps_what_it_has(lmoc, scene, tmp_path):
    scene.write_text(scene.read_text().replace("Force push(f = f);", "Force push(f = f + 1/(1 - body.q)^3);"))
    answer = lmoc("run", scene, "--input", "f=9", "-o", "part.csv", "--stop", "20")
    assert answer.code == 3
    assert "stopped at t = " in answer.err
    assert "part.csv" in answer.err
    table = np.genfromtxt(tmp_path / "part.csv", delimiter=",", names=True)
    assert 1 < len(table["time"]) < 501


def test_fmt_rewrites_and_checks(lmoc, tmp_path):
    (tmp_path / "loose.lmo").write_text("// kept\nmodel  A\n Mass m(m=1); // too\nend A;\n")
    assert lmoc("fmt", "--check", "loose.lmo").code == 1
    assert lmoc("fmt", "loose.lmo").code == 0
    text = (tmp_path / "loose.lmo").read_text()
    assert "// kept" in text and "Mass m(m = 1);" in text and "// too" in text
    assert lmoc("fmt", "--check", "loose.lmo") == (0, "", "")
    (tmp_path / "broken.lmo").write_text("model A\n")
    assert lmoc("fmt", "broken.lmo").code == 1
    assert (tmp_path / "broken.lmo").read_text() == "model A\n"


def test_the_models_of_the_repository_are_in_the_standard_layout(lmoc):
    files = [*ROOT.glob("models/*/*.lmo"), *ROOT.glob("stdlib/*.lmo")]
    assert lmoc("fmt", "--check", *files) == (0, "", "")


@pytest.mark.parametrize(
    "options, words",
    [
        (["--show", "body.qq"], "there is no variable 'body.qq'"),
        (["--keep", "x", "--show", "spring.f"], "'spring.f' cannot be drawn: of this run only x are kept"),
        (["--show", "body.qq", "--set", "spring.k=10:10:30"], "there is no variable 'body.qq'"),
    ],
)
def test_what_cannot_be_drawn_is_refused_before_time_is_spent(lmoc, scene, tmp_path, options, words):
    code, _, err = lmoc("run", scene, *options, "--plot", tmp_path / "a.png", "-o", tmp_path / "a.csv")
    assert code == 2 and words in err
    assert not list(tmp_path.glob("a.*"))


def test_what_is_kept_is_drawn(lmoc, scene, tmp_path):
    options = ["--keep", "x", "--stop", 1, "--points", 11]
    assert lmoc("run", scene, *options, "--show", "x", "--plot", tmp_path / "a.png")[0] == 0
    code, _, err = lmoc("run", scene, *options, "--phase", tmp_path / "b.png")
    assert code == 2 and "--show" in err


@pytest.mark.parametrize(
    "given, hint",
    [
        ("{}.start=1", "--init {}=1"),
        ("{}.fixed=true", "'fixed' is an attribute: it is set in the model"),
        ("{}.stateSelect=1", "'stateSelect' is an attribute"),
    ],
)
def test_attributes_are_no_parameters(lmoc, scene, given, hint):
    code, _, err = lmoc("run", scene, "--set", given.format("x"))
    assert code == 2 and "the model has no parameter" in err and hint.format("x") in err
