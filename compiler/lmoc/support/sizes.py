"""Sizes from which something large is done in another way."""

from __future__ import annotations

# edges or entries up to which a graph algorithm in Python costs less than importing SciPy
WITHOUT_SCIPY = 30_000
