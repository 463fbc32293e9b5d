"""The build back end: setuptools, and a C compiler for the engine.

The engine is built where the package is installed. It takes the machine's C compiler (`CC`, or the one that Python
was built with); where there is none, the build asks PyPI for one (`ziglang`, which is clang with its libraries), so
that nobody has to install a compiler. Functions of PEP 517 and 660 that depend on the machine are here, all others are
those of setuptools.
"""

from __future__ import annotations

import os
import shlex
import shutil
import sys
import sysconfig
from pathlib import Path

from setuptools import Extension
from setuptools import build_meta as _setuptools
from setuptools.build_meta import *  # noqa: F403  the back end's functions that do not depend on the machine
from setuptools.command.build_ext import build_ext

ENGINE = Path("compiler/lmoc/engine/c")
# Equal bits everywhere: no contraction to fused operations, nothing reassociated, no instructions of one processor.
# `-fno-math-errno` lets a square root be one instruction; its value is exact.
FLAGS = ["-O3", "-std=c11", "-ffp-contract=off", "-fno-math-errno", "-fno-strict-aliasing"]
FLAGS_OF_MSVC = ["/O2", "/fp:precise", "/std:c11"]


def own_compiler() -> list[str] | None:
    """Return the command of the machine's C compiler, or None where there is none."""
    named = os.environ.get("CC")
    if named is not None:  # an empty one stands for none
        return shlex.split(named) or None
    candidates = [shlex.split(sysconfig.get_config_var("CC") or ""), ["cc"], ["gcc"], ["clang"]]
    return next((c for c in candidates if c and shutil.which(c[0])), None)


def _needs_compiler() -> list[str]:
    return [] if sys.platform == "win32" or own_compiler() else ["ziglang"]


def get_requires_for_build_wheel(config_settings=None) -> list[str]:
    """Return what a wheel's build needs on this machine."""
    return [*_setuptools.get_requires_for_build_wheel(config_settings), *_needs_compiler()]


def get_requires_for_build_editable(config_settings=None) -> list[str]:
    """Return what an editable installation needs on this machine."""
    return [*_setuptools.get_requires_for_build_editable(config_settings), *_needs_compiler()]


class BuildEngine(build_ext):
    """Builds the engine with the compiler that there is."""

    def build_extensions(self) -> None:
        if self.compiler.compiler_type == "msvc":
            flags = FLAGS_OF_MSVC
        else:
            flags = FLAGS
            command = own_compiler() or [sys.executable, "-m", "ziglang", "cc"]
            shared = ["-dynamiclib", "-undefined", "dynamic_lookup"] if sys.platform == "darwin" else ["-shared"]
            self.compiler.set_executables(
                compiler=command, compiler_so=[*command, "-fPIC"], linker_so=[*command, *shared]
            )
        for extension in self.extensions:
            extension.extra_compile_args = flags
        super().build_extensions()


def engine() -> Extension:
    """Return the engine as setuptools takes it."""
    return Extension(
        "lmoc.engine._engine",
        sources=sorted(str(p) for p in ENGINE.glob("*.c")),
        depends=sorted(str(p) for p in ENGINE.glob("*.h")),
        libraries=[] if sys.platform == "win32" else ["m"],
        py_limited_api=True,
    )
