"""HTML for notebooks: tables of comparisons, studies, equilibria; names of a model are text in them."""

from html.parser import HTMLParser
from pathlib import Path

import pytest

import lmoc

MODELS = Path(__file__).parents[2] / "models"


class Cells(HTMLParser):
    """The texts of a table, and all elements."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.names: set[str] = set()
        self.texts: list[str] = []
        self.feed(html)

    def handle_starttag(self, tag, attrs):
        self.names.add(tag)

    def handle_data(self, data):
        self.texts.append(data)


@pytest.fixture(scope="module")
def dae():
    return lmoc.compile(MODELS / "notes" / "ex02_spring_mass_damper.lmo")


def test_comparisons(dae):
    runs = {"<b>one</b>": dae.simulate(stop=1), "<i>two</i>": dae.simulate(stop=1, parameters={"k": 20.0})}
    both = lmoc.compare(runs)
    found = Cells(both._repr_html_())
    assert found.names == {"p", "b", "table", "tr", "th", "td"} and "<i>two</i>" in found.texts
    assert f"{both.differences()['largest'].iloc[0]:.6g}" in found.texts


def test_comparisons_without_anything_in_common(dae):
    other = lmoc.compile_text("model M output Real z(start = 1, fixed = true); equation der(z) = -z; end M;")
    html = lmoc.compare([dae.simulate(stop=1), other.simulate(stop=1)])._repr_html_()
    assert "Comparison" in html and "<td>" not in html


def test_studies_and_what_reduction_saves(dae):
    study = dae.sweep(k=[10.0, 20.0], options={"stop": 1})
    found = Cells(study._repr_html_())
    assert found.texts.count("20") == 1 and "k" in found.texts
    table = dae.economy(stop=0.2)
    found = Cells(table._repr_html_())
    assert isinstance(table, tuple) and all(one.form in found.texts for one in table)


def test_equilibria(dae):
    found = Cells(dae.equilibria()._repr_html_())
    assert "1 equilibrium" in found.texts and "exact" in found.texts
    text = "model M Mass m(m = 1); Force f(f = 1); equation connect(f.flange, m.flange); end M;"
    assert "no equilibrium" in lmoc.compile_text(text).equilibria()._repr_html_()
