"""The errors for what cannot be derived, or not in symbols."""

from __future__ import annotations

from lmoc.messages.diagnostics import Diagnostic, ModelError


class NotDerivableError(ModelError):
    """Something cannot be derived from a scene, or does not exist (E0660)."""


class NoSymbolsError(NotDerivableError):
    """Symbols give no answer, or a too long one; numbers may."""


def no_symbols(message: str, hint: str = "") -> NoSymbolsError:
    """Return the error for what symbols cannot do, though numbers may."""
    return NoSymbolsError([Diagnostic("E0660", message, hint=hint)])
