"""When the energy ledger of a run says that its result is not to be trusted."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmoc.messages.diagnostics import Diagnostic

if TYPE_CHECKING:
    from lmoc.numerics.observe.energy import Energy

# an error of the balance that is told: as large a multiple of the relative tolerance, within these bounds
_MULTIPLE, _LEAST, _MOST = 1e4, 1e-3, 0.1


def unbalanced(energy: Energy | None, rtol: float) -> Diagnostic | None:
    """Return the warning that energies do not add up, None where they do or are not known."""
    if energy is None or not energy.balance > min(_MOST, max(_LEAST, _MULTIPLE * rtol)):
        return None
    return Diagnostic(
        "W0553",
        f"supplied, lost and stored energy do not add up: {100 * energy.balance:.2g} % are missing or too much, at a "
        f"relative tolerance of {rtol:g}",
        hint="a finer tolerance (--rtol, rtol=), shorter steps (--max-step, max_step=) or another solver; if the error "
        "stays the same, a part does not declare all its energy and loss",
    )
