"""Linear models in python-control, runs in xarray, scenes in notebooks."""

from pathlib import Path

import numpy as np
import pytest

import lmoc

MODELS = Path(__file__).parents[2] / "models"


def test_a_suspension_in_control():
    control = pytest.importorskip("control")
    linear = lmoc.compile(MODELS / "notes" / "ex05_suspension.lmo").linearize(outputs=["q1", "body.v"])
    system = linear.to_control()
    assert system.state_labels == ["wheel_q", "wheel_v", "body_q", "body_v"]
    assert (system.input_labels, system.output_labels) == (["u"], ["q1", "body_v"])
    # the road's velocity acts through the damper: A, B and the effect of the derivative together give G(s)
    for w in (0.5, 8.0, 60.0):
        s = 1j * w
        b = sum(m * s**k for k, m in enumerate(linear.Bs))
        d = sum(m * s**k for k, m in enumerate(linear.Ds))
        expected = linear.C @ np.linalg.solve(s * np.eye(4) - linear.A, b) + d
        found = np.asarray(control.evalfr(system, s)).reshape(expected.shape)
        assert found == pytest.approx(expected, rel=1e-9)


def test_what_is_not_proper_is_refused():
    pytest.importorskip("control")
    dae = lmoc.compile(MODELS / "notes" / "ex05_suspension.lmo")
    with pytest.raises(lmoc.ModelError, match="tire_force"):
        dae.linearize().to_control()


def test_a_run_in_xarray():
    pytest.importorskip("xarray")
    run = lmoc.compile(MODELS / "notes" / "ex05_suspension.lmo").simulate(points=11)
    data = run.to_xarray(["q1", "body.v"])
    assert data.sizes == {"time": 11} and data["q1"].attrs["units"] == "m"
    assert data["body.v"].values == pytest.approx(run["body.v"]) and data.attrs["model"] == "Suspension"


def test_a_cell_of_a_notebook():
    testing = pytest.importorskip("IPython.testing.globalipapp")
    shell = testing.start_ipython() or testing.get_ipython()
    shell.run_line_magic("load_ext", "lmoc")
    cell = "model Fall\n  Mass m(m = 1, g = 9.81, q(start = 0, fixed = true), v(start = 0, fixed = true));\nend Fall;"
    shown = shell.run_cell_magic("lmo", "fall", cell)
    assert "<svg" in shown._repr_html_() and "2 states" in shown._repr_html_()
    assert shell.user_ns["fall"].simulate(stop=1).end["m.q"] == pytest.approx(9.81 / 2, rel=1e-6)
    wrong = shell.run_cell_magic("lmo", "other", cell.replace("Mass m", "Mas m"))
    assert "E0202" in wrong._repr_html_() and "did you mean" in repr(wrong) and "other" not in shell.user_ns
    assert shell.run_cell_magic("lmo", "2x", cell) is None
