"""The stages in their order: what `check`, `run`, `show` and the Python interface all go through.

`STAGES` is the list that the timings, the progress line and `lmoc show --stage` read. With ``LMOC_CHECK=1`` in the
environment, every structure is checked when a stage hands it on (`lmoc.ir.check`).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import field, replace
from typing import TYPE_CHECKING, Any

from lmoc.messages.diagnostics import Report
from lmoc.messages.source import Source
from lmoc.support import budget
from lmoc.support.records import dataclass

if TYPE_CHECKING:
    import numpy as np

    from lmoc.ir.flat import FlatDAE
    from lmoc.ir.reduced import Reduced
    from lmoc.numerics.run.text import LoweredText
    from lmoc.sources.opened import Named
    from lmoc.sources.packages import Folder
    from lmoc.structure.coordinates.shared import Shared
    from lmoc.syntax import tree


class Clock:
    """Wall time of each stage, in seconds; tells `listener` which one begins. Its stages are those of `STAGES`."""

    def __init__(self, listener: Callable[[str], None] | None = None):
        self.seconds: dict[str, float] = {}
        self._listener = listener

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        if name not in BY_NAME:
            raise KeyError(f"there is no stage '{name}'")
        budget.moved_on(BY_NAME[name].label)
        if self._listener:
            self._listener(name)
        begin = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - begin

    def tell(self, what: str) -> None:
        """Tell the listener what begins that is no stage."""
        budget.moved_on(what)
        if self._listener:
            self._listener(what)


@dataclass(frozen=True, eq=False)
class Scene:
    """The user's input: enough to flatten and reduce again for other parameter values.

    Attributes
    ----------
    files : syntax trees of the files, once they are parsed
    path : folders in which classes are looked for, as the user named them
    folders : where the classes are found that the files do not define
    named : what the user named, where it has not been opened: the scene was found compiled
    """

    files: tuple[tree.File, ...] = ()
    model: str | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)
    states: tuple[str, ...] | None = None
    path: Named | None = None
    folders: tuple[Folder, ...] = ()
    named: Named | None = None

    def with_parameters(self, parameters: Mapping[str, float]) -> Scene:
        return replace(self, parameters={**self.parameters, **parameters})


# ----------------------------------------------------------------------------- the stages


def open_scene(named: Named | Source | tree.File, scene: Scene, clock: Clock) -> Scene:
    """Return the scene with its files parsed and the folders in which their classes are looked for.

    Parameters
    ----------
    named : files, the name of a class, a text, or its tree

    Raises
    ------
    ModelError
        For files and folders that cannot be read, and for mistakes outside of any class.
    """
    with clock.stage("parse"):
        from lmoc.sources.opened import open_files, open_source
        from lmoc.syntax.tree import File

        opened = open_source(named, scene.path) if isinstance(named, Source | File) else open_files(named, scene.path)
    model = scene.model or opened.model
    return replace(scene, files=opened.files, folders=opened.folders, model=model, named=None)


def parse(sources: Sequence[Source], clock: Clock) -> tuple[tree.File, ...]:
    """Syntax trees of the sources.

    Raises
    ------
    ModelError
        With the syntax errors of all of them.
    """
    with clock.stage("parse"):
        from lmoc.syntax.parse import parse as parse_one

        report = Report()
        files = tuple(parse_one(source, report) for source in sources)
        report.check()
    return files


def load_library(clock: Clock) -> tuple[tree.File, ...]:
    """Return the syntax trees of the library."""
    with clock.stage("library"):
        from lmoc.sources import library

        return library.load(())


def flatten(scene: Scene, clock: Clock) -> FlatDAE:
    """The flat model of a scene, with the warnings so far in its `notes`."""
    if scene.named is not None:
        scene = open_scene(scene.named, scene, clock)
    parts = load_library(clock)
    with clock.stage("flatten"):
        from lmoc.ir.checked import checked
        from lmoc.semantics.flatten import flatten as flatten_files
        from lmoc.structure.blocks.pieces import with_pieces

        report = Report()
        found = flatten_files(scene.files, parts, scene.model, scene.parameters, report, scene.folders)
        flat = checked(with_pieces(found))
        report.check()
    return flat


def reduce(
    flat: FlatDAE, values: np.ndarray, states: Sequence[str] | None, clock: Clock, shared: Shared | None = None
) -> Reduced:
    """The reduced system for a set of parameter values; `shared` as of `structure.reduce.reduce`."""
    with clock.stage("reduce"):
        from lmoc.semantics.parameter_checks import warn_of_lost
        from lmoc.structure.laws.reduce import reduce_with_laws

        # what was warned about before may be the reason why this fails: a part that is connected to nothing
        report = Report([d for d in flat.notes if d.severity == "warning"])
        warn_of_lost(flat, values, report)
        reduced = reduce_with_laws(flat, values, states, report, shared)
        report.check()
    return reduced


def recalled_or_compiled(file: str, scene: Scene, clock: Clock) -> tuple[FlatDAE, Reduced, Scene]:
    """Return the flat model of a file, its reduction, and the scene: as an earlier process has kept them, or made now.

    Raises
    ------
    ModelError
        As the stages do.
    """
    import os

    from lmoc.parameters import indexed
    from lmoc.sources.compiled import Compiled
    from lmoc.sources.opened import is_class_name

    kept = None
    with clock.stage("parse"):
        if (os.path.isfile(file) or is_class_name(file)) and os.environ.get("LMOC_CHECK", "") in ("", "0"):
            kept = Compiled(file, (scene.model, scene.parameters, scene.states, scene.path))
            found = kept.read()
            if found is not None:
                return *found, replace(scene, named=file)
    scene = open_scene(file, scene, clock)
    flat = flatten(scene, clock)
    reduced = reduce(flat, flat.parameter_values(indexed(flat, flat.overrides)), scene.states, clock)
    alone = all(not one.within for one in scene.files) and not os.path.basename(file).startswith("package.")
    if kept is not None and alone:
        kept.write(flat, reduced, scene.folders)
    return flat, reduced, scene


def reduce_with_loops(minimal: Reduced, states: Sequence[str] | None, gain: float, clock: Clock) -> Reduced:
    """The reduced system with all coordinates of its loops as states, for the parameter values of another one of it.

    Parameters
    ----------
    gain : 1/s, of the feedback of closures; 0 without

    Raises
    ------
    NotFormulatedError
        E0626: not all of them can be states.
    """
    with clock.stage("reduce"):
        from lmoc.messages.diagnostics import Diagnostic
        from lmoc.numerics.formulations.feedback import with_feedback
        from lmoc.numerics.options.formulations import NotFormulatedError
        from lmoc.structure.coordinates.closures import NotReleasedError
        from lmoc.structure.reduce import reduce

        report = Report()
        try:
            named = states if minimal.switched is None else minimal.state_names  # as those of the free scene
            reduced = reduce(minimal.flat, minimal.values, named, report, loops=True)
        except NotReleasedError as error:
            message = f"the coordinates of the loops cannot all be states: {error}"
            raise NotFormulatedError([Diagnostic("E0626", message, expected="formulation 'reduced'")]) from error
        report.check()
    reduced = replace(reduced, switched=minimal.switched, lawful=minimal.lawful)
    return with_feedback(reduced, gain) if gain else reduced


# ------------------------------------------------------------------------ their list


@dataclass(frozen=True)
class View:
    """A way to look at what a stage has made."""

    name: str
    text: Callable[[Any], str]


@dataclass(frozen=True)
class Stage:
    """A step from one structure to the next.

    Attributes
    ----------
    name : in the timings, and passed to listeners
    label : what the progress line says
    function : from what the stage before has made, the scene and a clock to what this one makes; None for the stages
        inside of a simulation
    views : what `lmoc show --stage` can print
    """

    name: str
    label: str
    function: Callable[[Any, Scene, Clock], Any] | None = None
    views: tuple[View, ...] = ()


def _flattened(scene: Scene, _: Scene, clock: Clock) -> FlatDAE:
    return flatten(scene, clock)


def _reduced(flat: FlatDAE, scene: Scene, clock: Clock) -> Reduced:
    from lmoc.parameters import indexed

    return reduce(flat, flat.parameter_values(indexed(flat, flat.overrides)), scene.states, clock)


def _lowered(reduced: Reduced, _: Scene, clock: Clock) -> LoweredText:
    with clock.stage("lower"):
        from lmoc.numerics.run.text import lower

        report = Report()
        lowered = lower(reduced, report)
        report.check()
    return lowered


def _tree_text(scene: Scene) -> str:
    from lmoc.syntax.outline import tree_text

    return tree_text(scene.files)


def _instance_text(flat: FlatDAE) -> str:
    from lmoc.ir.text.flat import instance_text

    return instance_text(flat)


def _text(structure: object) -> str:
    from lmoc.ir.text import text

    return text(structure)


def _normalized_text(reduced: Reduced) -> str:
    from lmoc.structure.normalize import normalize

    return _text(normalize(reduced.flat, reduced.values, None, Report()))


def _lowered_text(lowered: LoweredText) -> str:
    from lmoc.numerics.run.text import lowered_text

    return lowered_text(lowered)


STAGES = (
    Stage("parse", "parse", open_scene, (View("parse", _tree_text),)),
    Stage("library", "library"),  # read by `flatten`, timed apart
    Stage("flatten", "flatten", _flattened, (View("instantiate", _instance_text), View("flatten", _text))),
    Stage("reduce", "reduce", _reduced, (View("normalize", _normalized_text), View("reduce", _text))),
    Stage("lower", "lower", _lowered, (View("lower", _lowered_text),)),
    Stage("start", "lower and start"),
    Stage("simulate", "lower and start"),  # until simulated time advances
)
BY_NAME = {stage.name: stage for stage in STAGES}
VIEWS = tuple(view.name for stage in STAGES for view in stage.views)


def shown(name: str, named: Named | Source, scene: Scene, clock: Clock) -> str:
    """Return a view of what a stage makes of some files, or of a text.

    Parameters
    ----------
    name : one of `VIEWS`
    scene : the model, the requested parameters and states
    """
    structure: Any = named
    for stage in STAGES:
        if stage.function is not None:
            structure = stage.function(structure, scene, clock)
        for view in stage.views:
            if view.name == name:
                clock.tell("show")
                return view.text(structure)
    raise KeyError(name)
