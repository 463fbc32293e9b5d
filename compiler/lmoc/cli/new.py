"""`lmoc new`: a scene to start from, as a file of one's own.

The scenes are the files of the folder `starters`, which comes with the package; the first line of its model tells what
each is.
"""

from __future__ import annotations

import argparse
import re
import shlex
from pathlib import Path

from lmoc.cli.arguments import Parser, UsageError
from lmoc.messages.diagnostics import Diagnostic, ModelError, nearest
from lmoc.support.records import dataclass

FOLDER = Path(__file__).parent / "starters"


@dataclass(frozen=True)
class Starter:
    """A scene to start from."""

    name: str
    text: str

    @property
    def title(self) -> str:
        """What its model is described by."""
        return re.search(r'^model \w+ "(.*)"$', self.text, re.MULTILINE)[1]


def starters() -> dict[str, Starter]:
    """The scenes that come with lmoc, by their names."""
    return {p.stem: Starter(p.stem, p.read_text(encoding="utf-8")) for p in sorted(FOLDER.glob("*.lmo"))}


def configure(parser: Parser) -> None:
    add = parser.add_argument
    add("name", metavar="NAME", nargs="?", help="which scene; without one, all are listed")
    add("-o", "--output", metavar="FILE", type=Path, help="the file to write (NAME.lmo)")
    add("--force", action="store_true", help="replace the file if there is one")
    add("--quiet", action="store_true", help="print nothing but errors")


def execute(arguments: argparse.Namespace) -> int:
    if arguments.name is None:
        if arguments.output is not None:
            raise UsageError([Diagnostic("E0620", "which scene?", expected=", ".join(starters()))])
        _list()
        return 0
    starter = _starter(arguments.name)
    path = arguments.output or Path(f"{starter.name}.lmo")
    _write(path, starter.text, arguments.force)
    if not arguments.quiet:
        print(_next_steps(path, starter))
    return 0


def _list() -> None:
    print("scenes to start from:")
    for starter in starters().values():
        print(f"  {starter.name:<12}  {starter.title}")
    print("\n`lmoc new NAME` writes NAME.lmo, `lmoc new NAME -o FILE.lmo` a file of another name.")


def _starter(name: str) -> Starter:
    """The scene of a name; a hyphen, a blank and the ending of a file are no mistakes.

    Raises
    ------
    UsageError
        E0620 there is no such scene.
    """
    known = starters()
    wanted = re.sub(r"[-\s]+", "_", name.strip().lower().removesuffix(".lmo"))
    if wanted not in known:
        hint = nearest(wanted, known)
        if name.endswith(".lmo"):
            hint = f"which scene, and then the file: lmoc new {next(iter(known))} -o {shlex.quote(name)}"
        raise UsageError([Diagnostic("E0620", f"there is no scene '{name}'", expected=", ".join(known), hint=hint)])
    return known[wanted]


def _write(path: Path, text: str, force: bool) -> None:
    """Write the file; one that is there is replaced only if that is asked for."""
    from lmoc.report.files import check_target
    from lmoc.support.replacing import replace_text

    check_target(path, (".lmo",))
    if path.exists() and not force:
        hint = "-o OTHER.lmo writes another file, --force replaces this one"
        raise ModelError([Diagnostic("E0623", f"'{path}' exists already; nothing was written", hint=hint)])
    try:
        replace_text(path, text)
    except OSError as error:
        raise ModelError([Diagnostic("E0623", f"'{path}' cannot be written: {error.strerror or error}")]) from None


def _next_steps(path: Path, starter: Starter) -> str:
    def file(ending: str) -> str:
        return shlex.quote(str(path.with_suffix(ending)))

    scene = file(".lmo")
    steps = (
        f"lmoc run {scene} --plot {file('.png')}",
        f"lmoc draw {scene} -o {file('.svg')}",
        f"lmoc view {scene} -o {file('.html')}",
        f"lmoc equations {scene}",
    )
    return f"{path}: {starter.title}\n\nnext:\n" + "\n".join(f"  {step}" for step in steps)
