"""The page in a notebook: its sliders set values that Python reads, Python's values move the sliders."""

import json
from html import escape

import numpy as np
import pytest
from conftest import SPRING
from oracles.browser import needs_browser, open_page

import lmoc
from lmoc.view.page.join import asset

pytest.importorskip("anywidget")

# a notebook, as far as the widget sees one; what the page is told and tells goes through `model`
AROUND = """<!doctype html><meta charset="utf-8"><div id="here"></div><script type="module">
{script}
const own = {{ _html: {html}, _title: "scene", values: {values}, initial: {{}} }};
const heard = {{}};
window.saved = [];
window.model = {{
  get: (name) => own[name],
  set: (name, value) => {{ own[name] = value; }},
  save_changes: () => saved.push(JSON.parse(JSON.stringify({{ values: own.values, initial: own.initial }}))),
  on: (name, call) => {{ heard[name] = call; }},
  off: (name) => {{ delete heard[name]; }},
  python: (name, value) => {{ own[name] = value; heard[`change:${{name}}`](); }},
}};
window.stop = render({{ model, el: document.getElementById("here") }});
</script>"""
READY = """
const page = () => document.querySelector("iframe").contentDocument;
const until = async (holds) => {
  for (let k = 0; k < 2000 && !holds(); k++) await frames(1);
  if (!holds()) throw Error("never: " + holds);
};
const slider = () => page()?.querySelector('[data-name="k"] input[type="number"]');
await until(() => slider());
"""


@pytest.fixture(scope="module")
def dae():
    return lmoc.compile_text(SPRING)


def around(widget, values=None) -> str:
    script = asset("widget.js").replace("export default { render };", "").replace("</script", "<\\/script")
    html = json.dumps(widget._html).replace("<", "\\u003c")
    return AROUND.format(script=script, html=html, values=json.dumps(values or {}))


def test_the_run_follows_the_values(dae) -> None:
    """Force zero, k = 8 and m = 2: twice a second; with 4k twice as fast."""
    widget = dae.widget(stop=2, rtol=1e-9, initial={"body.q": 1.0})
    first = widget.run
    assert widget.run is first
    widget.values = {"k": 4 * dae.parameters["k"]}
    again = widget.run
    other = dae.simulate(stop=2, rtol=1e-9, initial={"body.q": 1.0}, parameters={"k": 4 * dae.parameters["k"]})
    assert np.array_equal(again["body.q"], other["body.q"]) and not np.array_equal(first["body.q"], other["body.q"])
    widget.initial = {"body.q": 0.5}
    assert widget.run["body.q"][0] == 0.5
    assert escape("body.q") in widget._html


@needs_browser
def test_a_slider_that_is_moved_is_read_by_python(dae) -> None:
    widget = dae.widget(stop=1)
    seen = open_page(around(widget), READY + """
        const field = slider();
        field.value = "20";
        field.dispatchEvent(new Event("change"));
        await until(() => saved.some((s) => s.values.k === 20));
        return saved.at(-1);
    """)  # fmt: skip
    assert seen.answer["values"] == {"k": 20}
    widget.values = seen.answer["values"]
    assert np.array_equal(widget.run["body.q"], dae.simulate(stop=1, parameters={"k": 20})["body.q"])


@needs_browser
def test_a_value_set_in_python_moves_the_slider(dae) -> None:
    """Also one that was set before the page has opened; what comes back is no change."""
    seen = open_page(around(dae.widget(stop=1), {"k": 11}), READY + """
        await until(() => slider().value === "11");
        model.python("values", { k: 13 });
        await until(() => slider().value === "13" && model.get("values").k === 13);
        const told = saved.length;
        await frames(30);
        return [model.get("values"), saved.length - told];
    """)  # fmt: skip
    assert seen.answer == [{"k": 13}, 0]


@needs_browser
def test_a_run_from_before_is_no_change(dae) -> None:
    """Values set in Python while the page answers others stay; so do those that were set before it has opened."""
    seen = open_page(around(dae.widget(stop=1)), """
        await frames(0);
        model.python("values", { k: 9 });""" + READY + """
        await until(() => slider().value === "9");
        for (const k of [11, 12, 13]) model.python("values", { k });
        await until(() => slider().value === "13");
        await frames(30);
        return [model.get("values"), saved.length];
    """)  # fmt: skip
    assert seen.answer == [{"k": 13}, 0]
