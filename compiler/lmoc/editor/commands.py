"""What an editor can have done with a model: run, draw, view, equations. Each answers with text or a page."""

from __future__ import annotations

from collections.abc import Callable

from lmoc.compilation import compiled, scene_of
from lmoc.editor.analysis import folders_around
from lmoc.interface import DAE
from lmoc.messages.diagnostics import ModelError, SimulationError
from lmoc.messages.source import Source

# from a text, its file and a model in it to {"kind": "text", "svg", "html" or "error", "content": …}
Command = Callable[[str, str, str | None], dict[str, str]]


def _dae(text: str, path: str, model: str | None) -> DAE:
    return compiled(Source(path, text), scene_of(model, path=[str(f.path) for f in folders_around(text, path)]))


def _command(kind: str, make: Callable[[DAE], str]) -> Command:
    def run(text: str, path: str, model: str | None = None) -> dict[str, str]:
        try:
            return {"kind": kind, "content": make(_dae(text, path, model))}
        except (ModelError, SimulationError) as error:
            return {"kind": "error", "content": str(error)}

    return run


def _run(dae: DAE) -> str:
    from lmoc.report.summary import summary

    return summary(dae.simulate())


def _draw(dae: DAE) -> str:
    return dae.draw().svg


def _view(dae: DAE) -> str:
    return dae.view().html


COMMANDS: dict[str, Command] = {
    "lmoc.run": _command("text", _run),
    "lmoc.draw": _command("svg", _draw),
    "lmoc.view": _command("html", _view),
    "lmoc.equations": _command("text", lambda dae: str(dae.equations())),
}
