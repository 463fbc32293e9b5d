"""`lmoc show --stage NAME`: what a stage of the compiler has made of a scene."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import fields, is_dataclass

from lmoc.cli.arguments import Parser, add_model_arguments, add_states_argument, choice
from lmoc.cli.progress import Progress
from lmoc.messages.source import Span

STAGES = ("parse", "instantiate", "flatten", "reduce", "lower")


def configure(parser: Parser) -> None:
    add_model_arguments(parser)
    add_states_argument(parser)
    add = parser.add_argument
    add("--stage", type=choice(STAGES), metavar="NAME", default="flatten", help=f"{', '.join(STAGES)} (flatten)")


def execute(arguments: argparse.Namespace) -> int:
    with Progress() as progress:
        text = _text(arguments, progress)
    print(text)
    return 0


def _text(arguments: argparse.Namespace, progress: Progress) -> str:
    from lmoc.pipeline import Clock, Scene, flatten, parse, read_source
    from lmoc.report import listing

    clock = Clock(progress.stage)
    files = parse([read_source(arguments.file)], clock)
    if arguments.stage == "parse":
        progress.stage("show")
        return "\n".join(line for file in files for line in _tree(file))
    states = None if arguments.states is None else tuple(arguments.states)
    scene = Scene(files, arguments.model, dict(arguments.set), states)
    flat = flatten(scene, clock)
    if arguments.stage in ("instantiate", "flatten"):
        progress.stage("show")
        return (listing.instance_text if arguments.stage == "instantiate" else listing.flat_text)(flat)
    from lmoc.dae import DAE

    dae = DAE(scene, flat, clock)
    progress.stage("show")
    return (listing.reduced_text if arguments.stage == "reduce" else listing.numeric_text)(dae.reduced)


def _tree(root: object) -> Iterator[str]:
    """A node, its plain attributes on its line and its children below; what is empty is left out."""
    pending: list[tuple[object, str]] = [(root, "")]
    while pending:  # no recursion: a sum of a thousand terms is a thousand deep
        node, lead = pending.pop()
        if isinstance(node, str):
            yield lead + node
            continue
        plain, children = _attributes(node)
        yield f"{lead}{type(node).__name__} {' '.join(map(str, plain))}".rstrip()
        below = [item for name, values in children for item in ((name, "  "), *((v, "    ") for v in values))]
        pending += [(item, lead + indent) for item, indent in reversed(below)]


def _attributes(node: object) -> tuple[list[str], list[tuple[str, list]]]:
    """What stands on a node's own line, and the headings of its children with them."""
    plain, children = [], []
    for f in fields(node):
        value = getattr(node, f.name)
        if value is None or value is False or value == () or value == "" or isinstance(value, Span):
            continue
        if is_dataclass(value):
            children.append((f"{f.name}:", [value]))
        elif isinstance(value, tuple) and any(is_dataclass(v) for v in value):
            children.append((f"{f.name}:", [v for v in value if is_dataclass(v)]))
        else:
            plain.append(value if f.name == "name" and isinstance(value, str) else f"{f.name}={value!r}")
    return plain, children
