"""When the energy ledger of a run says that its result is not to be trusted."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmoc.messages.diagnostics import Diagnostic

if TYPE_CHECKING:
    from lmoc.numerics.observe.energy import Energy

# the error of the balance that is reported: as large a multiple of the relative tolerance, within these bounds
_MULTIPLE, _LEAST, _MOST = 1e4, 1e-3, 0.1


def is_unbalanced(energy: Energy | None, rtol: float) -> bool:
    """Return whether the energy balance of a run does not close; where it is unknown, it does."""
    return energy is not None and energy.balance > min(_MOST, max(_LEAST, _MULTIPLE * rtol))


def unbalanced(energy: Energy | None, rtol: float) -> Diagnostic | None:
    """Return the warning that the energy balance does not close, None where it does or is unknown."""
    if energy is None or not is_unbalanced(energy, rtol):
        return None
    return Diagnostic(
        "W0553",
        f"the energy balance does not close: {100 * energy.balance:.2g} % of the energy is unaccounted for, at a "
        f"relative tolerance of {rtol:g}",
        hint="a finer tolerance (--rtol, rtol=), shorter steps (--max-step, max_step=) or another solver; if the error "
        "stays the same, a part does not declare all its energy and loss",
    )
