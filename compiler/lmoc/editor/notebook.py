"""The cell magic ``%%lmo NAME``: a scene written into a cell of a notebook, compiled and bound to a name.

%load_ext lmoc

%%lmo car
model Car
  …
end Car;
"""

from __future__ import annotations

import argparse
import shlex
from html import escape
from typing import Any

from lmoc.compilation import compiled, scene_of
from lmoc.interface import DAE
from lmoc.messages.diagnostics import Diagnostic, ModelError, render
from lmoc.messages.source import Source


class Scene:
    """What a cell shows: the picture of the scene, what it reduces to, and what is to be said of it."""

    def __init__(self, dae: DAE, name: str, said: tuple[Diagnostic, ...]) -> None:
        self.dae, self.name, self.said = dae, name, said

    def _repr_html_(self) -> str:
        from lmoc.report.summary import counted, stages

        counts = " → ".join(counted(n, stage) for stage, n in stages(self.dae.reduced.counts))
        title = f"<p><b>{escape(self.dae.name)}</b> is <code>{escape(self.name)}</code>: {escape(counts)}</p>"
        notes = [render(d) for d in self.said if d.severity == "warning"]
        return title + self.dae.draw().svg + "".join(f"<pre>{escape(note)}</pre>" for note in notes)

    def __repr__(self) -> str:
        return f"{self.name}: {self.dae.name}, {', '.join(self.dae.states) or 'no states'}"


class Mistakes:
    """The diagnostics of a cell that is wrong."""

    def __init__(self, error: ModelError) -> None:
        self.error = error

    def _repr_html_(self) -> str:
        return f'<pre style="border-left: 3px solid #c00; padding-left: .6em">{escape(str(self.error))}</pre>'

    def __repr__(self) -> str:
        return str(self.error)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("%%lmo", description="Compile the scene in this cell and bind it to a name.")
    parser.add_argument("name", nargs="?", default="scene", help="the Python name that gets the compiled scene")
    parser.add_argument("--model", help="which model of the cell")
    parser.add_argument("--path", action="append", help="a folder in which classes are looked for")
    return parser


def load(shell: Any) -> None:
    """Register the magic with a shell of IPython."""

    def lmo(line: str, cell: str) -> Scene | Mistakes | None:
        """Compile the scene in this cell and bind it to a name: %%lmo NAME [--model MODEL] [--path FOLDER]."""
        try:
            given = _parser().parse_args(shlex.split(line))
        except SystemExit:  # it has said why
            return None
        if not given.name.isidentifier():
            print(f"'{given.name}' is not a name of Python")
            return None
        try:
            dae = compiled(Source(f"<{given.name}>", cell), scene_of(given.model, path=given.path))
            said = dae.check()
        except ModelError as error:
            return Mistakes(error)
        shell.user_ns[given.name] = dae
        return Scene(dae, given.name, said)

    shell.register_magic_function(lmo, "cell", "lmo")
