"""The notebook of the how-to pages, as Jupyter executes it."""

from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient")
pytest.importorskip("ipykernel")
pytest.importorskip("anywidget")

NOTEBOOK = Path(__file__).parents[2] / "docs" / "how-to" / "car.ipynb"


@pytest.fixture(scope="module")
def shown() -> dict[str, dict]:
    """What each cell shows, by the beginning of its text."""
    notebook = nbformat.read(NOTEBOOK, 4)
    assert all(not cell.get("outputs") for cell in notebook.cells)  # it is kept without them
    nbclient.NotebookClient(notebook, timeout=300, kernel_name="python3").execute()
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    return {cell.source: {**cell.outputs[-1]["data"]} if cell.outputs else {} for cell in cells}


def of(shown: dict[str, dict], begin: str) -> dict:
    return next(data for source, data in shown.items() if source.startswith(begin))


def test_a_notebook_shows_the_scene_its_equations_and_runs(shown) -> None:
    scene = of(shown, "%%lmo car")["text/html"]
    assert "4 states" in scene and "<svg" in scene
    assert "\\ddot{q}" in of(shown, "car.equations()")["text/latex"]
    assert "QuarterCar" in of(shown, "run = ")["text/html"]
    assert "asymptotically stable" in of(shown, "car.linearize()")["text/html"]
    assert of(shown, "car.sweep")["text/html"].count("<tr>") == 4


def test_the_page_is_a_widget_whose_run_python_gets(shown) -> None:
    """With twice the damping the body rises less."""
    assert "application/vnd.jupyter.widget-view+json" in of(shown, "page = car.widget()")
    with_more, first = map(float, of(shown, "page.values")["text/plain"].strip("()").split(","))
    assert 0 < with_more != first > 0
