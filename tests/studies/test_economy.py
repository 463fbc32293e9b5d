"""What reduction saves: the same scene with all its equations, with dummy derivatives, and in minimal coordinates."""

import numpy as np
import pytest
from conftest import ROOT

import lmoc

LEDGER = 2  # work and heat are integrated as equations among others where nothing is reduced
STOP = """
model M "a mass on a stop"
  Mass m(m = 1, g = -9.81, q(start = 1, fixed = true)); Fixed f; Stop stop(L = 0);
equation
  connect(f.flange, stop.a); connect(stop.b, m.flange);
end M;
"""


def economy(text: str, **options) -> dict[tuple[str, str], object]:
    dae = lmoc.compile(ROOT / text) if text.endswith(".lmo") else lmoc.compile_text(text)
    return {(e.form, e.solver): e for e in dae.economy(**options)}


def test_a_pendulum_in_every_form():
    rows = economy("models/planar/pendulum.lmo", stop=2, rtol=1e-6)
    written, dummy, reduced = (rows[f, "ida"] for f in ("all equations", "dummy derivatives", "reduced"))
    assert (dummy.states, reduced.states) == (2 + LEDGER, 2)
    assert written.states > dummy.states, "positions, angle and velocities of the frames beside the coordinates"
    assert written.unknowns > 20 * reduced.unknowns
    assert dummy.unknowns > written.unknowns, "the derivatives of the constraints are equations, too"
    assert all(e.error < 1e-3 and not e.status for e in rows.values())
    assert rows["reduced", "taylor"].steps < reduced.steps / 3


def test_closed_loops_as_they_are_written_have_index_three():
    rows = economy("models/planar/four_bar.lmo", stop=0.5, rtol=1e-5)
    assert "step size collapsed" in rows["all equations", "ida"].status
    assert np.isnan(rows["all equations", "ida"].error)
    assert rows["dummy derivatives", "ida"].error < 1e-2
    assert rows["reduced", "ida"].error < 1e-3


def test_redundant_constraints_have_no_form_without_reduction():
    rows = economy("models/hard/h10_gear_loop.lmo", rtol=1e-5)
    assert rows["dummy derivatives", "ida"].status
    assert rows["reduced", "taylor"].error < 1e-3


def test_scenes_with_laws_are_refused():
    with pytest.raises(lmoc.ModelError, match="laws or events"):
        economy(STOP)
