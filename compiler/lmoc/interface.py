"""The user's interface: what can be done with a compiled scene, its studies and pictures included."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lmoc import simulation
from lmoc.dae import CompiledDAE, suspicion
from lmoc.messages.budgeted import budgeted
from lmoc.parameters import Value
from lmoc.report.units import unit_of
from lmoc.simulation import Request

if TYPE_CHECKING:
    from lmoc.export.fmu import Exported
    from lmoc.run import Run
    from lmoc.studies.chart import Chart
    from lmoc.studies.economy import Economy
    from lmoc.studies.ensemble import Ensemble
    from lmoc.studies.fit import Fit
    from lmoc.studies.misses import Differentiate
    from lmoc.studies.sweep import Sweep
    from lmoc.symbolic.places import Point
    from lmoc.view.drawing import Drawing
    from lmoc.view.page.page import Page
    from lmoc.view.widget import Widget


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

    def ensemble(
        self,
        parameters: Mapping[str, Any] | None = None,
        initial: Mapping[str, Any] | str | None = None,
        inputs: Mapping[str, object] | None = None,
        start: float | None = None,
        stop: float | None = None,
        times: Sequence[float] | None = None,
        points: int | None = None,
        rtol: float | None = None,
        keep: str | Sequence[str] = (),
        workers: Any = None,
        store: str | Path | None = None,
        *,
        atol: float | None = None,
        solver: str = "auto",
        max_step: float | None = None,
        energy: bool = True,
        series: bool = True,
        progress: Callable[[int, int], None] | None = None,
    ) -> Ensemble:
        """Make many runs with other numbers: ``dae.ensemble(lmoc.sample(k=lmoc.normal(30, 3), n=1000))``.

        Every run is what `simulate` makes of the same arguments, bit for bit, whatever shares the work. A run that
        fails is a row with its reason; every run has a budget of its own.

        Parameters
        ----------
        parameters, initial : {name: N values, or a number that stays}; of an array of the model (N, m) values. A
            `lmoc.sample` may be given as `parameters` where it has start values as well
        inputs : {name: N numbers, a list of N signals, or a signal for all as in `simulate`}
        start, stop, times, points, rtol, atol, solver, max_step, energy : as in `simulate`
        keep : names of the variables to keep; by default the outputs, else the states
        workers : number of threads, by default one for each processor; or a `Client` of dask.distributed
        store : a folder in which chunks are kept as they are done; an ensemble that was interrupted goes on from them
        series : keep variables over time; without, only their last, smallest and largest values
        progress : called with the runs done and the runs in all

        Raises
        ------
        ModelError
            Names or options that no run can use; E0623, E0667: the store cannot be used.
        ValueError
            Nothing varies, or lengths differ.
        """
        from lmoc.numerics.options.options import RunOptions
        from lmoc.studies.batch import rows_of_a_chunk, run
        from lmoc.studies.job import job_of
        from lmoc.studies.rows import rows_of
        from lmoc.studies.sample import Sample
        from lmoc.studies.store import Store

        seed = parameters.seed if isinstance(parameters, Sample) else None
        parameters, initial = self._sorted(parameters, initial)
        rows = rows_of(self.flat, parameters, initial, inputs)
        options = RunOptions(start, stop, points, times, rtol, atol, solver, energy=energy, max_step=max_step)
        job = job_of(self._session, options, rows, keep or None, series)
        kept = None if store is None else Store(store, job, lambda: rows_of_a_chunk(job), seed)
        return run(job, workers, kept, progress)

    @budgeted("the fit", suspicion)
    def fit(
        self,
        data: Any,
        free: Mapping[str, Any],
        outputs: Mapping[str, str] | None = None,
        sigma: float | Mapping[str, float] | None = None,
        starts: int = 1,
        *,
        start: float | None = None,
        parameters: Mapping[str, Value] | None = None,
        initial: Point | None = None,
        inputs: Mapping[str, object] | None = None,
        rtol: float | None = None,
        solver: str = "auto",
        seed: int = 0,
        profile: bool | str | Sequence[str] = False,
    ) -> Fit:
        """Find the parameters and start values with which the scene comes nearest to measured data.

        >>> fit = dae.fit("measured.csv", free={"k": 30, "c": (1, 0, 10)})
        >>> fit.values, fit.intervals, fit.undetermined, fit.plot("fit.png")

        Parameters
        ----------
        data : a file, a data frame or a mapping, with a column ``time``; or a pair of it and {"parameters", "initial",
            "inputs", "start"} of that experiment; or a list of these
        free : {name of a parameter or of a variable at the start: where to begin, or (where to begin, low, high)}
        outputs : {column: variable}; by default the columns that are called as variables are
        sigma : standard deviation of the data, for all columns or by column; without it, it is estimated
        starts : how many places the search begins at
        start, parameters, initial, inputs, rtol, solver : of the runs, as in `simulate`; rtol is 1e-9 by default
        seed : for the places at which the search begins
        profile : True, or names of unknowns: `fit.profiles` has their profile likelihoods with the intervals that
            follow, which hold where those from the covariance do not

        Raises
        ------
        ModelError
            E0668: data and model do not go together; whatever `simulate` raises where the search begins.
        SimulationError
            The run fails where the search begins.
        """
        from lmoc.numerics.options.options import RunOptions
        from lmoc.studies.fit import fit, unknowns_of
        from lmoc.studies.measured import Experiment, check_variables, experiments_of
        from lmoc.studies.misses import OF_FITS

        held = {"parameters": parameters or {}, "initial": initial or {}, "inputs": inputs or {}}
        unknowns = unknowns_of(free)
        moving = self._moving(free)
        measured = experiments_of(data, outputs, self.flat, lambda name: unit_of(self.reduced, name))
        check_variables(self.flat, measured)
        begin = (self.flat.experiment.start or 0.0) if start is None else start

        def simulate(values: Mapping[str, float], experiment: Experiment) -> tuple[Run, Differentiate]:
            own = experiment.settings
            given = {kind: {**held[kind], **(own.get(kind) or {})} for kind in held}
            given["parameters"] |= {name: value for name, value in values.items() if name not in moving}
            given["initial"] |= {name: value for name, value in values.items() if name in moving}
            booked = any(name.startswith("ledger.") for _, _, name in experiment.columns.values())
            options = RunOptions(
                own.get("start", begin), times=experiment.times, rtol=1e-9 if rtol is None else rtol, solver=solver,
                energy=booked,
            )  # fmt: skip
            request = Request(options, **given, compiled=self.timings, occasions=[])
            run = simulation.simulate(self._session, request)
            return run, lambda names: simulation.sensitivities(self._session, request, run, names, OF_FITS)

        return fit(simulate, measured, unknowns, sigma, starts, seed, profile)

    def _moving(self, names: Iterable[str]) -> set[str]:
        """Return those of some names that are variables and no parameters."""
        from lmoc.ir.flat import Kind

        found = {name: self.flat.find(name) for name in names}
        return {n for n, v in found.items() if v is not None and self.flat.kind[v[0]] != Kind.PARAMETER}

    def _sorted(
        self, parameters: Mapping[str, Any] | None, initial: Mapping[str, Any] | str | None
    ) -> tuple[Mapping[str, Any] | None, Mapping[str, Any] | str | None]:
        """Return parameters and start values, each in its place: a sample may hold both."""
        from lmoc.studies.sample import Sample

        if not isinstance(parameters, Sample) or isinstance(initial, str):
            return parameters, initial
        moving = self._moving(parameters)
        return parameters.only(set(parameters) - moving), {**(initial or {}), **parameters.only(moving)}

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
        from lmoc.numerics.options.options import RunOptions
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
        from lmoc.numerics.options.options import RunOptions
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
        frames : draw so many instants of `run` beside each other, the first and the last among them; at most 500

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

    def widget(self, **options: Any) -> Widget:
        """Return the page of a scene as a widget for notebooks (``pip install 'lmoc[notebook]'``).

        Its ``values`` and ``initial`` are those of the sliders, and can be set; its ``run`` is the run with them.

        Parameters
        ----------
        options : as of `simulate`; parameters and start values given here stay, where no slider gives others

        Raises
        ------
        ModelError, SimulationError
            As those of `simulate`.
        """
        from lmoc.view.widget import Widget

        def again(values: Mapping[str, float], initial: Mapping[str, float]) -> Run:
            given = {
                "parameters": {**(options.get("parameters") or {}), **values},
                "initial": {**(options.get("initial") or {}), **initial},
            }
            return self.simulate(**{**options, **given})

        run = self.simulate(**options)
        return Widget(run.view().html, run, again)

    # ------------------------------------------------------------------- other tools

    @budgeted("the export", suspicion)
    def export(self, path: str | Path, fmi: int = 3, type: str | Sequence[str] = ("me", "cs")) -> Exported:
        """Write the scene as an FMU; parameters and errors as of `lmoc.export.fmu.export`."""
        from lmoc.export.fmu import export

        return export(self, self.draw, path, fmi, type)
