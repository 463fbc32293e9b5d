"""The result of a run with what can be made of it: files, pictures, a summary."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from lmoc.messages.budgeted import budgeted
from lmoc.report.result import Result

if TYPE_CHECKING:
    import numpy as np

    from lmoc.numerics.run.sensitivities import Sensitivities
    from lmoc.view.page.page import Page


class Run(Result):
    """The result of a simulation; see `Result`.

    Attributes
    ----------
    tangents : the derivatives that were asked for; None where none were
    """

    tangents: Sensitivities | None = None

    def sensitivity(self, name: str, by: str) -> np.ndarray:
        """Return the derivative (times,) of a variable by a parameter or start value.

        Parameters
        ----------
        by : one of the names given to `simulate` as `sensitivities`

        Raises
        ------
        KeyError
            It was not asked for, or there is no such variable.
        ModelError
            E0575: at an output time something happens that comes earlier or later with it, so that there are two.
        """
        if self.tangents is None:
            raise KeyError(f"sensitivities were not asked for: simulate(sensitivities=({by!r},))")
        return self.tangents(name, by)

    def columns(self, names: str | Sequence[str] | None = None) -> dict[str, np.ndarray]:
        """{name: (times,) values}, as of `Result`, and the derivatives asked for: of `final`, or of the names."""
        found = super().columns(names)
        if self.tangents is None:
            return found
        shown = self.final if names is None else [name for name in found if name != "time"]
        of = {f"d({name})/d({by})": (name, by) for name in shown for by in self.tangents.directions}
        return found | {label: self.sensitivity(*own) for label, own in of.items()}

    @property
    def final_sensitivities(self) -> dict[str, dict[str, float]]:
        """{variable: {asked for: its last derivative}} of the variables of `final`; empty where none were asked for."""
        by = () if self.tangents is None else tuple(self.tangents.directions)
        return {name: {own: float(self.sensitivity(name, own)[-1]) for own in by} for name in self.final} if by else {}

    def save(self, path: str | Path, names: str | Sequence[str] | None = None) -> Path:
        """Write a table of the run: .csv, .npz, .parquet or .mat by the ending of the name.

        Raises
        ------
        ModelError
            E0623 the file cannot be written, E0624 unknown ending.
        """
        from lmoc.report.files import save

        return save(self, Path(path), names)

    def plot(
        self,
        names: str | Sequence[str] | None = None,
        path: str | Path | None = None,
        units: str | Sequence[str] | None = None,
    ):
        """Draw signals in panels by unit, and the energy. Returns the matplotlib figure; with `path` also writes it.

        Parameters
        ----------
        names : what to show: one name or several; by default outputs or states, and inputs that change
        units : in which to show it, such as ``["mm", "deg"]``; SI units without it
        """
        from lmoc.report.plots import plot

        return plot(self, names, path, units)

    def phase(self, x: str | None = None, y: str | None = None, path: str | Path | None = None):
        """Draw one variable over another, by default the first two states; see `report.portraits.phase_portrait`."""
        from lmoc.report.portraits import phase_portrait

        return phase_portrait(self, x, y, path)

    def spectrum(self, names: str | Sequence[str] | None = None, path: str | Path | None = None):
        """Draw the amplitudes of variables over the frequency in Hz; see `report.portraits.spectrum`."""
        from lmoc.report.portraits import spectrum

        return spectrum(self, names, path)

    @budgeted("the page")
    def view(self, path: str | Path | None = None) -> Page:
        """Return a page in which the run moves and can be simulated again; with `path` also write it.

        Raises
        ------
        ModelError
            E0623 the file cannot be written, E0624 it is none for a page (.html).
        """
        from lmoc.support.version import __version__
        from lmoc.view.page.page import Page

        page = Page(self, __version__)
        if path is not None:
            page.save(path)
        return page

    def _repr_html_(self) -> str:
        """Return the HTML representation for notebooks: the summary that `lmoc run` prints."""
        from html import escape

        from lmoc.report.summary import summary

        return f"<pre>{escape(summary(self))}</pre>"
