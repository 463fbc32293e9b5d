"""The error for what symbols cannot do, though numbers may."""

from __future__ import annotations

from lmoc.messages.diagnostics import Diagnostic, ModelError


class NoSymbolsError(ModelError):
    """Symbols give no answer, or a too long one; numbers may."""


def no_symbols(message: str, hint: str = "") -> NoSymbolsError:
    """Return the error for what symbols cannot do, though numbers may."""
    return NoSymbolsError([Diagnostic("E0660", message, hint=hint)])
