"""FMUs of scenes in which a prescribed motion jumps or bends: velocities jump there as in `simulate`."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.fmu import begin, beside_a_run, instance
from oracles.models import FLOOR

import lmoc
from lmoc.export.fmu import find_compiler

fmpy = pytest.importorskip("fmpy")
pytestmark = pytest.mark.skipif(find_compiler() is None, reason="there is no C compiler")

STEPPED = """
model Stepped "a mass behind a damper whose end steps, by a formula of time, by a clock and by the motion itself"
  parameter Real U(unit = "m") = 0.1;
  output Real v(unit = "m/s") = m.v;
  discrete Real h(start = 0, fixed = true, unit = "m");
  Motion base(q = noEvent(if time < 1 then 0 else U) + (if m.q > 0.08 then 0.05 else 0) + h);
  Damper d(c = 5);
  Mass m(m = 2, q(start = 0, fixed = true), v(start = 0, fixed = true));
equation
  connect(base.flange, d.a); connect(d.b, m.flange);
  when sample(1.5, 0.4) then h = pre(h) + 0.02; end when;
  annotation(experiment(StopTime = 3));
end Stepped;
"""
CART = """
model Cart "a pendulum on a cart whose velocity jumps, and a closed loop that hangs on its angle"
  output Real th(start = 0.3, fixed = true), w(start = 0, fixed = true), y(start = 0.2);
  Real x;
equation
  x = if time < 1 then 0 else 0.5*(time - 1);
  der(th) = w;
  der(w) = -9.81*sin(th) - der(der(x))*cos(th) - 0.1*y;
  y + 0.3*sin(y) = th;
  annotation(experiment(StopTime = 2));
end Cart;
"""
SCENES = {"Stepped": STEPPED, "Floor": FLOOR, "Cart": CART}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder, found = tmp_path_factory.mktemp("jumps"), {}
    for name, text in SCENES.items():
        dae = lmoc.compile_text(text)
        found[name] = dae, dae.export(folder / f"{name}.fmu").path
    return found


@pytest.mark.parametrize("kind", ["ModelExchange", "CoSimulation"])
@pytest.mark.parametrize("name", list(SCENES))
def test_velocities_jump_as_in_a_run(made, name: str, kind: str) -> None:
    dae, path = made[name]
    run, own = beside_a_run(dae, path, kind)
    for output in dae.outputs:
        # CVode goes to a time that is not that of the event by rounding: what is there is on either side of it
        off = np.abs(own[output] - run[output])
        assert np.sort(off)[-4 if kind == "ModelExchange" else -1] <= 1e-5 * np.abs(run[output]).max(), output
        assert off[-1] <= 1e-5 * np.abs(run[output]).max()


def test_a_step_through_a_damper_is_a_jump_of_the_velocity(made) -> None:
    """m·Δv = c·U with a height of the step that is set in the FMU."""
    fmu, references = instance(made["Stepped"][1])
    fmu.setFloat64([references["U"]], [0.04])
    begin(fmu)
    fmu.doStep(currentCommunicationPoint=0.0, communicationStepSize=1.2)
    assert fmu.getFloat64([references["v"]]) == pytest.approx([0.1 * np.exp(-0.5)], abs=1e-7)
    fmu.terminate()
    fmu.freeInstance()
