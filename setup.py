"""The engine in C; everything else about the package stands in pyproject.toml."""

import sys

sys.path.insert(0, "compiler/building")

from lmoc_build import BuildEngine, engine  # noqa: E402
from setuptools import setup  # noqa: E402

setup(
    ext_modules=[engine()],
    cmdclass={"build_ext": BuildEngine},
    options={"bdist_wheel": {"py_limited_api": "cp311"}},
)
