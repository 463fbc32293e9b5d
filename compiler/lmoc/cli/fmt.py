"""`lmoc fmt`: put files into the standard layout."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from lmoc.cli import terminal
from lmoc.cli.arguments import Parser
from lmoc.messages.diagnostics import Diagnostic, ModelError
from lmoc.messages.source import Source

WRONG_MODEL = 1


def configure(parser: Parser) -> None:
    parser.add_argument("files", metavar="FILE", nargs="+", help="scenes to rewrite; - reads one and prints it")
    parser.add_argument("--check", action="store_true", help="change nothing, name the files that would change")


def execute(arguments: argparse.Namespace) -> int:
    outcomes = [_one(name, arguments.check) for name in arguments.files]
    return max(outcomes)


def _one(name: str, check: bool) -> int:
    """Format one file; 1 where it is wrong, or would change and is only checked."""
    from lmoc.sources.files import read_source
    from lmoc.syntax.layout import formatted

    source = Source("standard input", sys.stdin.read()) if name == "-" else read_source(name)
    try:
        text = formatted(source)
    except ModelError as error:
        terminal.show(error.diagnostics)
        return WRONG_MODEL
    if check:
        if text != source.text:
            print(f"{source.name} is not in the standard layout")
        return int(text != source.text)
    if name == "-":
        print(text, end="")
    elif text != source.text:
        _write(Path(name), text)
        print(f"{name} rewritten")
    return 0


def _write(path: Path, text: str) -> None:
    from lmoc.support.replacing import replace_text

    try:
        replace_text(path, text)
    except OSError as error:
        reason = error.strerror or error
        message = f"'{path}' cannot be written: {reason}"
        raise ModelError([Diagnostic("E0623", message, hint="the file is unchanged")]) from None
