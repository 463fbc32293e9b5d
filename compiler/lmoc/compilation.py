"""From files or a text to the compiled scene that a user holds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from lmoc import pipeline
from lmoc.interface import DAE
from lmoc.ir.names import names_of
from lmoc.messages.budgeted import budgeted
from lmoc.messages.source import Source
from lmoc.parameters import Value, check_mappings
from lmoc.pipeline import Clock, Scene
from lmoc.syntax.tree import File


@budgeted("the compilation")
def compile(
    file: str | Path | Sequence[str | Path],
    model: str | None = None,
    parameters: Mapping[str, Value] | None = None,
    states: str | Sequence[str] | None = None,
    path: str | Path | Sequence[str | Path] | None = None,
    *,
    listener: Callable[[str], None] | None = None,
) -> DAE:
    """Compile the scene in a file.

    Parameters
    ----------
    file : the `.lmo` file, the folder of a package, or several; or the dotted name of a class that is found in a folder
    model : which model, where the file holds several that could be meant
    parameters : {dotted name: value}, overriding what the file says
    states : variables to prefer as states, or the name of one
    path : folders in which classes are looked for, after that of the file and before those of ``LMOPATH``
    listener : called with the name of each stage as it begins

    Raises
    ------
    ModelError
        The model is wrong, or the file cannot be read; `.diagnostics` say what and where.
    """
    return compiled(file, scene_of(model, parameters, states, path), listener)


@budgeted("the compilation")
def compile_text(
    text: str,
    name: str = "model.lmo",
    model: str | None = None,
    parameters: Mapping[str, Value] | None = None,
    states: str | Sequence[str] | None = None,
    path: str | Path | Sequence[str | Path] | None = None,
) -> DAE:
    """Compile a scene given as text; `name` stands for the file's name in messages. Otherwise as `compile`."""
    if not isinstance(text, str):
        raise TypeError(f"a model is a text (str), not {type(text).__name__}")
    return compiled(Source(name, text), scene_of(model, parameters, states, path))


def scene_of(
    model: str | None = None,
    parameters: Mapping[str, Value] | None = None,
    states: str | Sequence[str] | None = None,
    path: str | Path | Sequence[str | Path] | None = None,
) -> Scene:
    """Return what is to be compiled, before any file is opened. Parameters as of `compile`."""
    check_mappings(parameters=parameters)
    return Scene((), model, dict(parameters or {}), names_of(states), path)


@budgeted("the compilation")
def compiled(
    named: Source | File | str | Path | Sequence[str | Path],
    scene: Scene,
    listener: Callable[[str], None] | None = None,
) -> DAE:
    """Return the compiled scene that a text, its tree or some files hold. Errors as of `compile`."""
    clock = Clock(listener)
    scene = pipeline.open_scene(named, scene, clock)
    return DAE(scene, pipeline.flatten(scene, clock), clock)


@budgeted("the compilation")
def recalled_or_compiled(file: str, scene: Scene, listener: Callable[[str], None] | None = None) -> DAE:
    """Return what `compiled` does for a file, without compiling again where nothing it depends on has changed.

    For a process that runs a scene once. What is kept between processes holds for the parameters of the scene alone:
    to change them afterwards costs a reduction more than after `compiled`.
    """
    clock = Clock(listener)
    flat, reduced, scene = pipeline.recalled_or_compiled(file, scene, clock)
    return DAE(scene, flat, clock, reduced)
