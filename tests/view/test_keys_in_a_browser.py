"""A page with keys alone, and with what a screen reader is told alone."""

from pathlib import Path

from oracles.browser import controls, in_page, needs_browser, open_page, press
from oracles.models import compiled

MODELS = Path(__file__).parents[2] / "models"
STATE = """
  const $ = (id) => document.getElementById(id), active = document.activeElement;
  const texts = ["play", "now", "happened", "keep", "trouble"].map((id) => [id, $(id).textContent]);
  const pulls = document.querySelector("#stage .hand").getAttribute("d") ?? "", { hash } = location;
  return { at: active.id || active.getAttribute("aria-label"), hash, pulls, ...Object.fromEntries(texts) };
"""

pytestmark = needs_browser


def state() -> dict:
    """What the page shows when it has computed what it was asked for."""
    return in_page(f"await idle(); {STATE}")


def go_to(name: str) -> dict:
    """Press Tab until a control has the focus."""
    for _ in range(80):
        press("Tab")
        if (now := in_page(STATE))["at"] == name:
            return now
    raise AssertionError(f"no Tab leads to {name}")


def test_keys_alone_run_drag_pull_and_compare():
    dae = compiled(MODELS / "laws" / "h06_bungee.lmo")
    assert open_page(dae.simulate(points=50).view().html, "return 1").console == []
    picture = go_to(in_page("return document.querySelector('#stage svg').getAttribute('aria-label')"))
    press(".")
    assert "taut" in state()["happened"]
    go_to("keep")
    press("Enter")
    go_to(picture["at"])
    press("ArrowDown", 2)
    dragged = state()
    assert "init=" in dragged["hash"] and "against" in dragged["hash"] and dragged["now"] == "t = 0.000 s"
    assert dragged["keep"] == "Forget the recorded run"
    press(" ")
    press("ArrowUp", 2)
    drawn = "document.querySelector('#stage .hand').getAttribute('d')"
    held = in_page(f"for (let k = 0; k < 600 && !{drawn}; k++) await frames(1); {STATE}")  # it stays busy
    assert held["play"] == "Pause" and held["pulls"]
    press("Enter")
    press(" ")
    free = state()
    assert free["play"] == "Play" and "pull=" in free["hash"] and not free["pulls"] and free["trouble"] == ""


def test_whatever_can_be_acted_on_has_a_name_and_a_role():
    names = set()
    for model in ("laws/h06_bungee", "planar/pendulum"):
        open_page(compiled(MODELS / f"{model}.lmo").simulate(points=50).view().html, "return 1")
        found = controls()
        assert [(role, name) for role, name in found if not name or role == "generic"] == []
        names |= set(found)
        (picture,) = [text for (role, _), text in found.items() if role == "application"]
        assert "arrow keys" in picture
    assert {("button", "Play"), ("slider", "time"), ("button", "next event"), ("combobox", "part")} <= names
