"""`lmoc lsp`: the language server, for editors."""

from __future__ import annotations

import argparse

from lmoc.cli.arguments import Parser, UsageError
from lmoc.messages.diagnostics import Diagnostic


def configure(parser: Parser) -> None:
    parser.add_argument("--stdio", action="store_true", help="over standard input and output, which is the default")


def execute(arguments: argparse.Namespace) -> int:
    try:
        from lmoc.editor.server import serve
    except ModuleNotFoundError as missing:
        if missing.name not in ("pygls", "lsprotocol"):
            raise
        hint = "pip install 'lmoc[editor]'"
        raise UsageError([Diagnostic("E0664", f"the language server needs '{missing.name}'", hint=hint)]) from None
    serve()
    return 0
