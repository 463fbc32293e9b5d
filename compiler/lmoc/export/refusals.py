"""Why a scene cannot be an FMU."""

from __future__ import annotations

from lmoc.ir.flat import FlatDAE
from lmoc.messages.diagnostics import Diagnostic, ModelError


def refusal(flat: FlatDAE, why: str, hint: str = "") -> ModelError:
    """Return the error of a scene that cannot be an FMU."""
    return ModelError([Diagnostic("E0669", f"'{flat.name}' cannot be exported: {why}", hint=hint)])
