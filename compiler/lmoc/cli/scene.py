"""The scene of a command line, compiled."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lmoc.cli.progress import Progress
    from lmoc.interface import DAE
    from lmoc.pipeline import Scene


def scene_of(arguments: argparse.Namespace) -> Scene:
    """Return what is to be compiled, from FILE, --model, --set, --path and, where a verb has it, --states."""
    from lmoc import compilation

    states = getattr(arguments, "states", None)
    return compilation.scene_of(arguments.model, dict(arguments.set), states, arguments.path)


def compiled(arguments: argparse.Namespace, progress: Progress) -> DAE:
    """Return the compiled scene; its stages are shown."""
    from lmoc import compilation

    return compilation.compiled(arguments.file, scene_of(arguments), progress.stage)


def recalled_or_compiled(arguments: argparse.Namespace, progress: Progress) -> DAE:
    """Return the scene as an earlier process has compiled it, if nothing has changed, else compile it."""
    from lmoc import compilation

    return compilation.recalled_or_compiled(arguments.file, scene_of(arguments), progress.stage)
