"""Ensembles: samples, results bit for bit those of single runs, rows that fail, stores, Dask."""

import csv
import json
import os
import re
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from conftest import ROOT
from scipy.stats import kstest

import lmoc
from lmoc.cli.main import main
from lmoc.messages.diagnostics import ModelError

SWING = """
model Swing
  parameter Real k = 8, c = 0;
  output Real x(start = 1, fixed = true);
  Real v(start = 0, fixed = true);
  Real root = sqrt(10 - k);
  input Real f = 0;
equation
  der(x) = v;
  2*der(v) = -k*x - c*v + f;
  assert(time < 1 or k < 9, "too stiff");
end Swing;
"""


@pytest.fixture(scope="module")
def dae():
    return lmoc.compile_text(SWING)


# ------------------------------------------------------------------------------------------------------- samples


@pytest.mark.parametrize("method", ["latin", "sobol", "random"])
def test_samples_follow_their_distributions(method):
    drawn = lmoc.sample(
        {"a.b": lmoc.normal(3, 0.5)}, u=lmoc.uniform(-1, 2), t=lmoc.triangular(0, 1, 4), l=lmoc.lognormal(2, 0.1),
        n=1024, seed=3, method=method,
    )  # fmt: skip
    assert list(drawn) == ["a.b", "u", "t", "l"]
    for name, law, own in (("a.b", "norm", (3, 0.5)), ("u", "uniform", (-1, 3)), ("t", "triang", (0.25, 0, 4))):
        assert kstest(drawn[name], law, own).pvalue > 0.01
    assert np.std(np.log(drawn["l"] / 2)) == pytest.approx(0.1, rel=0.1)
    assert abs(np.corrcoef(list(drawn.values()))[np.triu_indices(4, 1)]).max() < 0.1


def test_a_seed_gives_the_same_values_and_another_one_others():
    def draw(seed):
        return lmoc.sample(k=lmoc.uniform(0, 1), n=50, seed=seed)["k"]

    assert (draw(1) == draw(1)).all() and (draw(1) != draw(2)).all()


@pytest.mark.parametrize(
    "make",
    [
        lambda: lmoc.normal(1, 0), lambda: lmoc.normal(np.nan, 1), lambda: lmoc.uniform(2, 1),
        lambda: lmoc.lognormal(-1, 1), lambda: lmoc.triangular(1, 0, 2), lambda: lmoc.sample(n=10),
        lambda: lmoc.sample(k=lmoc.uniform(0, 1), n=0), lambda: lmoc.sample(k=lmoc.uniform(0, 1), n=4, method="?"),
        lambda: lmoc.sample(k="x", n=4), lambda: lmoc.sample(k=lmoc.uniform(0, 1), n=4, seed=-1),
    ],
)  # fmt: skip
def test_samples_that_cannot_be_drawn_are_refused(make):
    with pytest.raises(ValueError):
        make()


# ------------------------------------------------------------------------------------------- the bits of single runs


def _scenes():
    for folder, most in (("laws", 6), ("notes", 3)):
        yield from sorted((ROOT / "models" / folder).glob("*.lmo"))[:most]
    yield from (ROOT / f"models/planar/{name}.lmo" for name in ("four_bar", "cart_pole", "chain", "crane"))


def _varied(dae):
    """A parameter of the scene that may be changed, by name, and values for it."""
    for name in dae.parameters:
        value = dae.parameters[name]
        try:
            varies = np.ndim(value) == 0 and np.isfinite(value) and float(value) not in (0.0, 1.0)
            if varies and not dae.flat.block_at(int(dae.flat.find(name)[0])).structural:
                lmoc.parameters.indexed(dae.flat, {name: value * 1.01})
                return name, value * np.array([1.0, 1.01, 0.985])
        except ModelError:
            continue
    return None


@pytest.mark.parametrize("path", list(_scenes()), ids=lambda path: path.stem)
def test_runs_are_those_of_simulate_to_the_last_bit(path):
    dae = lmoc.compile(path)
    name, values = _varied(dae)
    stop = min(dae.flat.experiment.stop or 1.0, 1.0)
    many = dae.ensemble({name: values}, stop=stop, points=11, workers=2)
    alone = lmoc.compile(path)
    for row, value in enumerate(values):
        try:
            run = alone.simulate(stop=stop, points=11, parameters={name: value})
        except (lmoc.SimulationError, ModelError):
            assert many.failed[row] and many.reasons[row]
            continue
        assert not many.failed[row], many.reasons[row]
        for kept in many.kept:
            assert np.array_equal(many[kept][row], run[kept], equal_nan=True), kept
        assert many.events[row] == run.events


def test_whatever_shares_the_work_the_bits_are_the_same(dae):
    drawn = lmoc.sample(k=lmoc.uniform(2, 8), c=lmoc.uniform(0, 3), x=lmoc.normal(1, 0.2), n=40, seed=2)
    one, two = (dae.ensemble(drawn, stop=3, points=20, workers=n) for n in (1, 3))
    assert np.array_equal(one["x"], two["x"]) and np.array_equal(one["x"][:, 0], drawn["x"])
    undamped = dae.ensemble({"k": drawn["k"]}, times=[3.0], rtol=1e-9)
    assert undamped["x"].shape == (40, 1) and np.allclose(undamped.end["x"], np.cos(3 * np.sqrt(drawn["k"] / 2)))


def test_inputs_may_differ_from_run_to_run(dae):
    many = dae.ensemble(inputs={"f": ["0", "8", lambda t: 8.0, (np.array([0.0, 9.0]), np.array([8.0, 8.0]))]}, stop=2)
    assert np.allclose(many["x"][1:], 1.0, atol=1e-6) and abs(many["x"][0] - np.cos(2 * many.time)).max() < 1e-4
    numbers = dae.ensemble(inputs={"f": np.array([0.0, 8.0])}, stop=2)
    assert np.array_equal(numbers["x"], many["x"][:2])


# ------------------------------------------------------------------------------------------------ rows that fail


def test_a_run_that_fails_is_a_row_with_its_reason(dae):
    many = dae.ensemble({"k": [8.0, 9.5, 2.0]}, stop=2, points=21)
    assert many.failed.tolist() == [False, True, False] and "too stiff" in many.reasons[1]
    failed = many["x"][1]
    assert np.isfinite(failed[:10]).all() and np.isnan(failed[11:]).all() and np.isnan(many.end["x"][1])
    assert np.isfinite(many["x"][[0, 2]]).all() and many.minimum["x"][1] <= np.nanmin(failed)
    table = many.to_dataframe()
    assert list(table.columns) == ["k", "x end", "x min", "x max", "failed", "reason"] and len(table) == 3


def test_values_that_no_start_has_are_rows_with_their_reasons():
    loop = lmoc.compile(ROOT / "models/planar/four_bar.lmo")
    name = next(n for n in loop.parameters if n.endswith(".l") or n in ("l1", "l2", "l3"))
    many = loop.ensemble({name: [float(loop.parameters[name]), 1e3]}, stop=0.1, points=3)
    assert many.failed.tolist() == [False, True] and "E0" in many.reasons[1]


@pytest.mark.parametrize(
    "asked", [{"parameters": {"kk": [1, 2]}}, {"parameters": {"k": [1, 2]}, "keep": "y"},
              {"parameters": {"k": [1, 2]}, "rtol": -1}, {"initial": {"z": [1, 2]}}, {"inputs": {"g": [1, 2]}}],
)  # fmt: skip
def test_what_no_run_can_use_is_refused_before_any_is_made(dae, asked):
    with pytest.raises(ModelError):
        dae.ensemble(**asked)


def test_lengths_must_agree_and_something_must_vary(dae):
    with pytest.raises(ValueError, match="k: 2, c: 3"):
        dae.ensemble({"k": [1, 2], "c": [1, 2, 3]})
    with pytest.raises(ValueError, match="nothing that varies"):
        dae.ensemble({"k": 3})
    with pytest.raises(ValueError, match="workers"):
        dae.ensemble({"k": [1, 2]}, workers=0)
    with pytest.raises(KeyError, match="keep="):
        _ = dae.ensemble({"k": [1, 2]}, stop=1)["v"]


# ------------------------------------------------------------------------------------------------ files and pictures


def test_results_as_files_and_arrays(dae, tmp_path):
    many = dae.ensemble({"k": [8.0, 9.5, 2.0]}, stop=2, points=21, keep=("x", "v"))
    import pandas

    read = pandas.read_csv(many.save(tmp_path / "m.csv"))
    assert np.allclose(read["x end"], many.end["x"], equal_nan=True, rtol=1e-15) and "too stiff" in read.reason[1]
    held = np.load(many.save(tmp_path / "m.npz"))
    assert np.array_equal(held["x"], many["x"], equal_nan=True)
    pytest.importorskip("xarray")
    data = many.to_xarray()
    assert data["x"].dims == ("run", "time") and np.array_equal(data["v"].values, many["v"], equal_nan=True)


@pytest.mark.parametrize("kind", ["bands", "histogram", "scatter", "tornado"])
def test_pictures(dae, tmp_path, kind):
    many = dae.ensemble(lmoc.sample(k=lmoc.uniform(2, 8), c=lmoc.uniform(0, 3), n=20), stop=1, points=9)
    many.plot("x", tmp_path / "m.svg", kind)
    text = (tmp_path / "m.svg").read_text()
    assert "20 runs" in text and {"tornado": "rank correlation", "bands": "median"}.get(kind, "x") in text


def test_bands_are_the_quantiles_of_the_runs(dae):
    many = dae.ensemble({"k": np.linspace(2, 8, 21)}, stop=1, points=5)
    middle = many.plot("x").axes[0].lines[0]
    assert np.allclose(middle.get_ydata(), np.median(many["x"], axis=0))


# ------------------------------------------------------------------------------------------------ stores


def test_a_store_gives_the_same_bits_and_refuses_other_runs(dae, tmp_path):
    values = {"k": np.linspace(2, 9.5, 150)}
    many = dae.ensemble(values, stop=1.5, points=4)
    first = dae.ensemble(values, stop=1.5, points=4, store=tmp_path / "s")
    chunks = sorted((tmp_path / "s").glob("chunk-*"))
    chunks[1].unlink()  # as if it had not been done
    before = chunks[0].stat().st_mtime_ns
    again = dae.ensemble(values, stop=1.5, points=4, store=tmp_path / "s")
    for found in (first, again):
        assert np.array_equal(found["x"], many["x"], equal_nan=True) and found.reasons == many.reasons
    assert chunks[0].stat().st_mtime_ns == before and chunks[1].exists() and len(chunks) == 3
    for other in ({"stop": 1.6, "points": 4}, {"stop": 1.5, "points": 4, "rtol": 1e-7}):
        with pytest.raises(ModelError, match="E0667"):
            dae.ensemble(values, store=tmp_path / "s", **other)
    with pytest.raises(ModelError, match="E0667"):
        dae.ensemble({"k": values["k"] + 1e-12}, stop=1.5, points=4, store=tmp_path / "s")
    with pytest.raises(ModelError, match="E0667"):
        dae.ensemble(inputs={"f": [lambda t: 1.0, "2"]}, stop=1, store=tmp_path / "t")


def test_a_store_keeps_many_runs_that_c_makes_in_a_file(tmp_path):
    """As many as the folder says, where it has been begun: a chunk that is lost is made again, with the same bits."""
    model = "model A parameter Real k = 2; Real x(start = 1, fixed = true); equation der(x) = -k*x; end A;"
    dae, values, asked = lmoc.compile_text(model), {"k": np.linspace(1, 2, 5000)}, {"stop": 0.1, "points": 2}
    whole, new, begun = dae.ensemble(values, **asked)["x"], tmp_path / "new", tmp_path / "begun"
    assert np.array_equal(dae.ensemble(values, **asked, store=new)["x"], whole)
    begun.mkdir()
    (begun / "study.json").write_text((new / "study.json").read_text().replace(": 4096", ": 1000"))
    for folder, files in ((new, 2), (begun, 5)):
        for _ in range(2):
            assert np.array_equal(dae.ensemble(values, **asked, store=folder)["x"], whole)
            assert len(list(folder.glob("chunk-*"))) == files
            (folder / "chunk-000001.npz").unlink()


def test_events_come_back_from_a_store_as_they_were(tmp_path):
    ball = lmoc.compile(next((ROOT / "models/laws").glob("*.lmo")))
    name, values = _varied(ball)
    made, read = (ball.ensemble({name: values}, points=5, stop=2.0, store=tmp_path / "s") for _ in range(2))
    assert made.events == read.events and made.reasons == read.reasons


STUDY = ["study", "swing.lmo", "--sample", "k~uniform(2,8)", "--runs", "200", "--stop", "3", "--points", "50",
         "--seed", "5", "--workers", "1"]  # fmt: skip


@pytest.mark.parametrize(
    ("words", "code", "told"),
    [
        (["--sample", "k~uniform(2,8)", "--store", "taken.csv"], "E0623", "it is a file, and a store is a folder"),
        (["--sample", "k~uniform(2,8)", "--store", "odd", "--resume"], "E0623", "'study.json' in it"),
        (["--sample", "k~uniform(2,8)", "--sample", "k~normal(3,1)"], "E0621", "'k' has more than one distribution"),
    ],
)
def test_a_store_or_a_sample_that_cannot_be_used_is_explained(tmp_path, monkeypatch, capsys, words, code, told):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "swing.lmo").write_text(SWING)
    (tmp_path / "taken.csv").write_text("t\n")
    (tmp_path / "odd").mkdir()
    (tmp_path / "odd" / "study.json").write_text("not json")
    assert main(["study", "swing.lmo", "--runs", "3", *words]) == 2
    found = capsys.readouterr().err
    assert f"error[{code}]" in found and told in " ".join(found.split()) and "Errno" not in found


def test_a_sample_of_an_array_is_one_number_for_all_its_members(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    model = "model M parameter Real d[2] = {1, 2}, e[2, 2] = {{1, 2}, {3, 4}}; Real x(start = 1, fixed = true);"
    (tmp_path / "m.lmo").write_text(f"{model} equation der(x) = -d[1]*d[2] - e[2, 1]; end M;")
    asked = "--sample d~uniform(1,2) --sample e~uniform(1,2) --runs 4 --stop 0.5 --keep x -o out.csv"
    assert main(["study", "m.lmo", *asked.split()]) == 0, capsys.readouterr().err
    with (tmp_path / "out.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        d, e = float(row["d[1]"]), float(row["e[2,1]"])
        assert (float(row["d[2]"]), float(row["e[1,2]"])) == (d, e)
        assert float(row["x end"]) == pytest.approx(1 - 0.5 * (d**2 + e))
    assert len({row["d[1]"] for row in rows}) == 4


def test_a_study_that_is_killed_goes_on_to_the_same_bits(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "swing.lmo").write_text(SWING)
    command = [sys.executable, "-m", "lmoc", *STUDY, "--resume", "-o", "killed.csv"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    folder, end = tmp_path / "killed.study", time.monotonic() + 60
    while time.monotonic() < end and process.poll() is None and not list(folder.glob("chunk-*")):
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert list(folder.glob("chunk-*"))
    assert main([*STUDY, "--resume", "-o", "killed.csv"]) == 0 and main([*STUDY, "-o", "whole.csv"]) == 0
    assert (tmp_path / "killed.csv").read_bytes() == (tmp_path / "whole.csv").read_bytes()
    assert len((tmp_path / "whole.csv").read_text().splitlines()) == 201
    assert "200 runs" in capsys.readouterr().out


def test_the_command_tells_what_came_out(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "swing.lmo").write_text(SWING)
    assert main(["study", "swing.lmo", "--sample", "k~uniform(2,9.9)", "--runs", "20", "--stop", "2", "--json"]) == 3
    told = capsys.readouterr()
    data = json.loads(told.out)
    assert data["runs"] == 20 and 0 < data["failed"] < 10 and -1 <= data["summary"]["x min"]["mean"] < 0
    assert "too stiff" in told.err
    for wrong in (["--sample", "k~normal(1)"], ["--sample", "k"], [], ["--sample", "k~cauchy(1,2)"],
                  ["--sample", "kk~uniform(0,1)"], ["--sample", "k~uniform(1,2)", "-o", "x.txt"]):  # fmt: skip
        assert main(["study", "swing.lmo", *wrong]) == 2


@pytest.mark.parametrize(
    ("kind", "name", "wrong", "told"),
    [
        ("parameters", "k", np.nan, "E0530.*'k' is not a number"),
        ("parameters", "k", None, "E0530.*'k' is not a number"),
        ("parameters", "on", 0.5, "E0301.*'on' must be true or false"),
        ("initial", "x", np.nan, "E0621.*'x' does not fit, found nan"),
        ("inputs", "f", "sin(tme)", "E0521.*not understood at 'tme'"),
        ("inputs", "f", "sin(", "E0521.*not a formula"),
        ("inputs", "f", (np.array([0.0, 1.0]), np.array([0.0, np.nan])), "E0625.*nan is not a finite number"),
    ],
)
@pytest.mark.parametrize("place", [0, 1])
def test_a_wrong_value_of_one_run_is_a_row_with_its_reason(kind, name, wrong, told, place):
    """Whichever row it is in: the other runs are made."""
    dae = lmoc.compile_text(SWING.replace("Real v(", "parameter Boolean on = true; Real v("))
    values = [0.0, 0.0]
    values[place] = wrong
    many = dae.ensemble(**{kind: {name: values}}, stop=0.5, points=3, workers=1)
    assert many.failed.tolist() == [place == 0, place == 1]
    assert re.search(told, many.reasons[place]) and np.isfinite(many["x"][1 - place]).all()


# ------------------------------------------------------------------------------------------------ Dask


def test_workers_of_dask_give_the_same_bits(dae):
    distributed = pytest.importorskip("distributed")
    drawn = lmoc.sample(k=lmoc.uniform(2, 9.5), n=60, seed=2)
    own = dae.ensemble(drawn, stop=2, points=9)
    options = {"n_workers": 2, "threads_per_worker": 1, "processes": True, "dashboard_address": None}
    with distributed.LocalCluster(**options) as cluster, distributed.Client(cluster) as client:
        shared = dae.ensemble(drawn, stop=2, points=9, workers=client)
    assert np.array_equal(own["x"], shared["x"], equal_nan=True) and own.reasons == shared.reasons
