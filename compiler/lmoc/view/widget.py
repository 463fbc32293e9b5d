"""The page of a scene as a widget of a notebook: its sliders set values that Python reads, and Python gets the run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import anywidget
import traitlets

from lmoc.report.result import Result
from lmoc.view.page.join import asset

Again = Callable[[Mapping[str, float], Mapping[str, float]], Any]  # (values, initial) -> the run with them


class Widget(anywidget.AnyWidget):
    """A moving scene with live values.

    Attributes
    ----------
    values : {parameter: value} of the sliders that have been moved; can be set
    initial : {state: value} at the start, as far as it has been given; can be set
    """

    _esm = asset("widget.js")
    _html = traitlets.Unicode().tag(sync=True)
    _title = traitlets.Unicode().tag(sync=True)
    values = traitlets.Dict(key_trait=traitlets.Unicode(), value_trait=traitlets.Float()).tag(sync=True)
    initial = traitlets.Dict(key_trait=traitlets.Unicode(), value_trait=traitlets.Float()).tag(sync=True)

    def __init__(self, html: str, run: Result, again: Again) -> None:
        super().__init__(_html=html, _title=run.flat.name)
        self._again = again
        self._known: tuple[dict[str, float], dict[str, float], Any] = {}, {}, run

    @property
    def run(self) -> Any:
        """The run with the present values, computed where they have changed.

        Raises
        ------
        ModelError, SimulationError
            As those of `simulate`.
        """
        if (self.values, self.initial) != self._known[:2]:
            found = self._again(self.values, self.initial)
            self._known = dict(self.values), dict(self.initial), found
        return self._known[2]
