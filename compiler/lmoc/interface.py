"""The user's interface: what can be done with a compiled scene, its studies and pictures included."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lmoc.dae import CompiledDAE, suspicion
from lmoc.messages.budgeted import budgeted
from lmoc.parameters import Value
from lmoc.simulation import Request

if TYPE_CHECKING:
    from lmoc.run import Run
    from lmoc.studies.chart import Chart
    from lmoc.studies.economy import Economy
    from lmoc.studies.sweep import Sweep
    from lmoc.symbolic.places import Point
    from lmoc.view.drawing import Drawing
    from lmoc.view.page.page import Page


class DAE(CompiledDAE):
    """A compiled scene and what can be done with it: runs, studies, derivations, pictures.

    Made by `lmoc.compile`. Most methods take `parameters`, {name: value} for this one result, without compiling again.
    """

    # ----------------------------------------------------------------------- studies

    @budgeted("the sweep", suspicion)
    def sweep(
        self,
        values: Mapping[str, Sequence[float]] | None = None,
        /,
        *,
        options: Mapping[str, Any] | None = None,
        **more: Sequence[float],
    ) -> Sweep:
        """Simulate for several values of parameters: ``dae.sweep(k=[10, 20, 30])``.

        Parameters
        ----------
        values : {name: values}, for names with dots; several parameters are combined in every way
        options : arguments of `simulate`, such as ``{"stop": 5}``
        more : values of parameters without dots in their names

        Raises
        ------
        ModelError
            As `simulate` does. A run that fails on its way is kept as far as it came.
        ValueError
            There is nothing to vary.
        """
        from lmoc.studies.sweep import sweep

        given = {**(options or {})}
        held = given.pop("parameters", None) or {}
        return sweep(
            {**(values or {}), **more},
            lambda point: self.simulate(**given, parameters={**held, **point}),
            lambda point: self.linearize(parameters={**held, **point}).eigenvalues,
        )

    @budgeted("the chart", suspicion)
    def chart(
        self,
        solvers: str | Sequence[str] | None = None,
        formulations: str | Sequence[str] | None = None,
        rtols: Sequence[float] | None = None,
        quick: bool = False,
        *,
        start: float | None = None,
        stop: float | None = None,
        points: int | None = None,
        parameters: Mapping[str, Value] | None = None,
        initial: Point | str | None = None,
        inputs: Mapping[str, object] | None = None,
        seconds: float | None = None,
        progress: Callable[[str, float], None] | None = None,
    ) -> Chart:
        """Return a chart of speed against accuracy; parameters and errors as of `lmoc.studies.chart.chart`.

        Parameters
        ----------
        start, stop, points, parameters, initial, inputs : of the run, as in `simulate`
        seconds : that the chart may take, about; 300 by default
        progress : called with what is being done and the share of the work that is done
        """
        from lmoc.numerics.options import RunOptions
        from lmoc.studies.chart import chart

        request = Request(RunOptions(start, stop, points), parameters, initial, inputs)
        return chart(self._session, request, solvers, formulations, rtols, quick, seconds, progress)

    @budgeted("the economy", suspicion)
    def economy(
        self,
        rtol: float | None = None,
        *,
        start: float | None = None,
        stop: float | None = None,
        parameters: Mapping[str, Value] | None = None,
        initial: Point | str | None = None,
        inputs: Mapping[str, object] | None = None,
    ) -> tuple[Economy, ...]:
        """Return what reduction saves: the scene with all its equations, with dummy derivatives, and reduced.

        Parameters and errors as of `simulate` and `lmoc.studies.economy.economy`.
        """
        from lmoc.numerics.options import RunOptions
        from lmoc.studies.economy import economy

        return economy(self._session, Request(RunOptions(start, stop, rtol=rtol), parameters, initial, inputs))

    # ---------------------------------------------------------------------- pictures

    @budgeted("the picture", suspicion)
    def draw(
        self,
        path: str | Path | None = None,
        free_body: bool = False,
        parameters: Mapping[str, Value] | None = None,
        *,
        run: Run | None = None,
        time: float | None = None,
        dimensions: bool = False,
        frames: int | None = None,
    ) -> Drawing:
        """Draw the scene: a schematic of what moves along lines and turns, mechanisms of the plane where they start.

        Parameters
        ----------
        path : where to write it (.svg, .png, .pdf), if anywhere
        free_body : draw the free-body diagrams instead: each body cut out, the forces on it, and their balance
        parameters : {name: value} for this picture only
        run, time : for free-body diagrams with numbers, their arrows to scale: at the output time nearest to `time`
            (s), by default the last
        dimensions : with the lengths of bars, rods, links and lever arms
        frames : draw so many instants of `run` beside each other, the first and the last among them

        Raises
        ------
        ModelError
            E0623, E0624: the picture cannot be written. E0660: there are no free-body diagrams. A mechanism of the
            plane has no consistent start. ValueError: the run is one of another scene.
        """
        from lmoc.view.drawing import draw

        prepared = self.prepare(parameters)
        drawing = draw(prepared, lambda: self.at_start(parameters), free_body, run, time, dimensions, frames)
        if path is not None:
            drawing.save(path)
        return drawing

    @budgeted("the page", suspicion)
    def view(self, path: str | Path | None = None, run: Run | None = None) -> Page:
        """Return a page in which the scene moves and can be simulated again; with `path` also write it.

        Parameters
        ----------
        path : where to write it (.html), if anywhere
        run : what it shows; by default a simulation with the model's own values

        Raises
        ------
        ModelError, SimulationError
            As those of `simulate`; E0623, E0624: the page cannot be written.
        """
        return (self.simulate() if run is None else run).view(path)
