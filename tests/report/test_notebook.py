"""What a notebook shows of a scene, a run and a linear model."""

import pytest
from conftest import SPRING

import lmoc


@pytest.fixture(scope="module")
def dae():
    return lmoc.compile_text(SPRING)


def test_a_scene_shows_its_names(dae):
    shown = dae._repr_html_()
    for name in ("body.q", "body.v", "spring.k", "<th>inputs</th><td><code>f</code>"):
        assert name in shown


def test_a_run_shows_its_summary(dae):
    shown = dae.simulate(stop=1)._repr_html_()
    assert shown.startswith("<pre>") and "states    body.q, body.v" in shown and "at t = 1 s" in shown


def test_a_linear_model_shows_its_matrices(dae):
    model = dae.linearize()
    assert repr(model) == "<LinearModel: 2 states, 1 input, 1 output; stable>"
    shown = model._repr_html_()
    assert "<th>A</th><th>body.q</th><th>body.v</th>" in shown
    assert "<tr><th>body.v</th><td>-4</td><td>0</td></tr>" in shown  # k/m = 8/2
    assert "<th>D</th>" not in shown  # zero


def test_a_model_in_symbols_shows_them(dae):
    model = dae.linearize(symbolic=True)
    assert repr(model).endswith("in symbols>")
    assert "<td>-k/body.m</td>" in model._repr_html_()


def test_text_of_the_user_is_no_markup():
    run = lmoc.compile_text(SPRING.replace('"A mass on a spring"', '"A <b>mass</b>"')).simulate(stop=1)
    assert "A &lt;b&gt;mass&lt;/b&gt;" in run._repr_html_()
