"""What gives registers of a page's scene to those who write its programs."""

from __future__ import annotations

from typing import Protocol

import numpy as np


class RegisterSource(Protocol):
    """Gives registers."""

    def add(self, count: int, values: np.ndarray | None = None) -> np.ndarray: ...


class VariableRegisters(RegisterSource, Protocol):
    """Gives registers, and those of variables."""

    def of_variables(self, variables: np.ndarray) -> np.ndarray: ...
