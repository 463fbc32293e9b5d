"""lmoc: from an acausal scene to the smallest system of equations, solved and trusted.

>>> import lmoc
>>> dae = lmoc.compile("suspension.lmo")
>>> run = dae.simulate(stop=5)
>>> run["body.q"]
"""

from __future__ import annotations

from importlib import import_module

TYPE_CHECKING = False  # as type checkers know it; importing `typing` would come before the command's care for Ctrl-C
if TYPE_CHECKING:
    from lmoc.compilation import compile, compile_text
    from lmoc.export.environment import Environment
    from lmoc.export.vector_environment import VectorEnvironment
    from lmoc.interface import DAE
    from lmoc.messages.diagnostics import ModelError, SimulationError
    from lmoc.report.compare import compare
    from lmoc.report.picture import plot
    from lmoc.run import Run
    from lmoc.studies.sample import lognormal, normal, sample, triangular, uniform
    from lmoc.support.budget import budget
    from lmoc.support.version import __version__

__all__ = ["__version__", "DAE", "Environment", "ModelError", "Run", "SimulationError", "VectorEnvironment"]
__all__ += ["budget", "compare", "compile", "compile_text", "plot"]
__all__ += ["lognormal", "normal", "sample", "triangular", "uniform"]

# Looked up on first use: `import lmoc` itself must cost nothing, since every stage imports it.
_HOME = {
    "__version__": "lmoc.support.version",
    "DAE": "lmoc.interface",
    "Environment": "lmoc.export.environment",
    "VectorEnvironment": "lmoc.export.vector_environment",
    "budget": "lmoc.support.budget",
    "compare": "lmoc.report.compare",
    "compile": "lmoc.compilation",
    "compile_text": "lmoc.compilation",
    "ModelError": "lmoc.messages.diagnostics",
    "SimulationError": "lmoc.messages.diagnostics",
    "Run": "lmoc.run",
    "plot": "lmoc.report.picture",
    **dict.fromkeys(("lognormal", "normal", "sample", "triangular", "uniform"), "lmoc.studies.sample"),
}


def __getattr__(name: str):
    if name in _HOME:
        return getattr(import_module(_HOME[name]), name)
    raise AttributeError(f"module 'lmoc' has no attribute '{name}'")


def load_ipython_extension(shell) -> None:
    """Give notebooks the cell magic ``%%lmo NAME``: called by ``%load_ext lmoc``."""
    import_module("lmoc.editor.notebook").load(shell)


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOME])
