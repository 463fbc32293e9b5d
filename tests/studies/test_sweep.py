"""Parameter studies, in Python and on the command line."""

import json

import numpy as np
import pytest

import lmoc
from lmoc.cli.arguments import Range, value_or_range
from lmoc.cli.main import main
from lmoc.studies.sweep import branches

SWING = """
model Swing
  parameter Real k = 8, c = 0;
  output Real x(start = 1, fixed = true);
  Real v(start = 0, fixed = true);
equation
  der(x) = v;
  2*der(v) = -k*x - c*v;
end Swing;
"""


@pytest.fixture(scope="module")
def dae():
    return lmoc.compile_text(SWING)


def test_every_combination_is_run(dae):
    found = dae.sweep({"c": [0.0, 1.0]}, k=[2, 8, 18], options={"stop": 3, "rtol": 1e-9})
    assert len(found) == 6 and found.points[1] == (0.0, 8.0)
    table = found.to_dataframe("x")
    assert list(table.columns) == ["c", "k", "x end", "x min", "x max", "complete", "balance"]
    undamped = table[table.c == 0]
    assert np.allclose(undamped["x end"], np.cos(3 * np.sqrt(undamped.k / 2)), atol=1e-7)
    assert table.complete.all()


def test_eigenvalues_and_their_locus(dae, tmp_path):
    found = dae.sweep(c=[0.0, 2.0, 20.0], options={"stop": 1, "points": 3})
    first, second, last = found.eigenvalues
    assert np.allclose(np.sort(first.imag), [-2, 2]) and np.allclose(second.real, -0.5)
    assert np.allclose(np.sort(last.real), -5 + np.array([-1, 1]) * np.sqrt(21))
    figure = found.root_locus(tmp_path / "locus.png")
    assert "c = 0 to c = 20" in figure.get_suptitle() and (tmp_path / "locus.png").exists()


def test_the_models_own_values_stay_and_others_can_be_held(dae):
    found = dae.sweep(k=[8.0], options={"stop": 1, "points": 3, "parameters": {"c": 2.0}})
    alone = dae.simulate(stop=1, points=3, parameters={"c": 2.0})
    assert np.array_equal(found.runs[0]["x"], alone["x"])
    assert dae.parameters["c"] == 0


def test_a_run_that_fails_is_kept_as_far_as_it_came():
    dae = lmoc.compile_text("model M parameter Real a=1; Real x(start=1, fixed=true); equation der(x) = a*x^2; end M;")
    found = dae.sweep(a=[0.1, 1.0], options={"stop": 2})
    assert found.to_dataframe().complete.tolist() == [True, False]
    assert len(found.plot().axes[0].lines) == 2


def test_what_cannot_be_varied_is_refused(dae):
    with pytest.raises(ValueError, match="at least one value"):
        dae.sweep()
    with pytest.raises(ValueError, match="1000 runs at most"):
        dae.sweep(k=range(50), c=range(50))
    with pytest.raises(lmoc.ModelError):
        dae.sweep(kk=[1])


@pytest.mark.parametrize(
    ("text", "values"),
    [("10:10:50", (10, 20, 30, 40, 50)), ("1:3", (1, 2, 3)), ("0:0.1:0.3", (0, 0.1, 0.2, 0.3)), ("3:-1:1", (3, 2, 1))],
)
def test_ranges(text, values):
    found = value_or_range(text)
    assert isinstance(found, Range) and np.allclose(found.values, values)


@pytest.mark.parametrize("text", ["1:0:3", "3:1:1", "1:2:3:4", "1:x:3", "0:1e-9:1", "1:"])
def test_no_ranges(text, tmp_path, capsys):
    (tmp_path / "s.lmo").write_text(SWING)
    assert main(["run", str(tmp_path / "s.lmo"), "--set", f"k={text}"]) == 2
    assert "E0621" in capsys.readouterr().err


def test_the_command_runs_a_study(tmp_path, capsys):
    scene, picture, table = tmp_path / "s.lmo", tmp_path / "five.png", tmp_path / "five.csv"
    scene.write_text(SWING)
    options = ["--stop", "1", "--points", "5", "--plot", str(picture), "-o", str(table)]
    assert main(["run", str(scene), "--set", "k=10:10:50", "--set", "c=1", *options, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [r["k"] for r in rows] == [10, 20, 30, 40, 50] and picture.stat().st_size > 0
    assert len(table.read_text().splitlines()) == 6
    assert main(["run", str(scene), "--set", "k=10:10:50", "-o", str(tmp_path / "x.npz")]) == 2
    assert "E0624" in capsys.readouterr().err
    assert main(["check", str(scene), "--set", "k=10:10:50"]) == 2


def test_eigenvalues_are_followed_from_point_to_point():
    """Two pairs that are given in another order each time, one of which becomes real; then a state is lost."""
    first = np.array([1j, -1j, -2 + 3j, -2 - 3j])
    second = np.array([-2.1 - 3j, 0.1 + 1.1j, -2.1 + 3j, 0.1 - 1.1j])
    third = np.array([-2.2 + 3j, 0.5, 0.3, -2.2 - 3j])
    found = branches([first, second, third, np.array([-1.0])])
    assert [len(b) for b in found] == [3, 3, 3, 3, 1]
    assert found[2].tolist() == [-2 + 3j, -2.1 + 3j, -2.2 + 3j] and found[3].tolist() == [-2 - 3j, -2.1 - 3j, -2.2 - 3j]
    assert {found[0][2], found[1][2]} == {0.5, 0.3} and found[0][1] == 0.1 + 1.1j
