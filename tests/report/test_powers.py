"""Labels of logarithmic axes, which the style of pictures would show as mark-up."""

import pytest

import lmoc
from lmoc.report.linear_plots import bode
from lmoc.report.plots import STYLE
from lmoc.report.powers import plain

LAG = """model Lag
  input Real u = 1;
  output Real y;
equation
  der(y) = 3*u - 2*y;
  annotation(experiment(StopTime = 2));
end Lag;"""


@pytest.mark.parametrize(
    ("text", "shown"),
    [(r"$\mathdefault{10^{-12}}$", "10⁻¹²"), (r"$\mathdefault{2\times10^{-3}}$", "2×10⁻³"), ("", ""), ("0.5", "0.5")],
)
def test_a_power_of_ten_in_plain_characters(text, shown):
    assert plain(text) == shown


@pytest.mark.parametrize(
    "draw",
    [lambda dae: bode(dae.transfer_function("u", "y")),
     lambda dae: dae.chart(["dop853", "cvode"], rtols=[1e-4, 1e-8], quick=True).plot()],
    ids=["bode", "chart"],
)  # fmt: skip
def test_no_mark_up_at_an_axis(draw):
    figure = draw(lmoc.compile_text(LAG))
    figure.canvas.draw()
    labels = [t.get_text() for axis in figure.axes for one in (axis.xaxis, axis.yaxis) for t in one.get_ticklabels()]
    assert STYLE["text.parse_math"] is False and any("10" in text for text in labels)
    assert not any("$" in text or "{" in text for text in labels)
