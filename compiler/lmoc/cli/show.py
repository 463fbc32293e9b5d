"""`lmoc show --stage NAME`: what a stage of the compiler has made of a scene."""

from __future__ import annotations

import argparse

from lmoc.cli.arguments import Parser, add_model_arguments, add_states_argument, choice
from lmoc.cli.progress import Progress
from lmoc.pipeline import VIEWS, Clock, Scene, shown


def configure(parser: Parser) -> None:
    add_model_arguments(parser)
    add_states_argument(parser)
    add = parser.add_argument
    add("--stage", type=choice(VIEWS), metavar="NAME", default="flatten", help=f"{', '.join(VIEWS)} (flatten)")


def execute(arguments: argparse.Namespace) -> int:
    states = None if arguments.states is None else tuple(arguments.states)
    with Progress() as progress:
        scene = Scene((), arguments.model, dict(arguments.set), states, arguments.path)
        text = shown(arguments.stage, arguments.file, scene, Clock(progress.stage))
    print(text)
    return 0
