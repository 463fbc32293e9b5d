"""The stages in their order: what `check`, `run`, `show` and the Python interface all go through."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from lmoc.messages.diagnostics import Diagnostic, ModelError, Report
from lmoc.messages.source import Source

if TYPE_CHECKING:
    import numpy as np

    from lmoc.ir.flat import FlatDAE
    from lmoc.ir.reduced import Reduced
    from lmoc.syntax import tree


class Clock:
    """Wall time of each stage, in seconds; tells `listener` which one begins."""

    def __init__(self, listener: Callable[[str], None] | None = None):
        self.seconds: dict[str, float] = {}
        self._listener = listener

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        if self._listener:
            self._listener(name)
        begin = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - begin


@dataclass(frozen=True, eq=False)
class Scene:
    """What the user gave: enough to flatten and reduce again for other parameter values."""

    files: tuple[tree.File, ...]
    model: str | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)
    states: tuple[str, ...] | None = None

    def with_parameters(self, parameters: Mapping[str, float]) -> Scene:
        return replace(self, parameters={**self.parameters, **parameters})


def read_source(path: str | Path) -> Source:
    """The text of a file.

    Raises
    ------
    ModelError
        E0610 no such file, E0611 a folder or not readable, E0612 not text in UTF-8.
    """
    name = str(path)
    try:
        data = Path(path).read_bytes()
    except FileNotFoundError:
        raise _refusal("E0610", f"there is no file '{name}'", hint=_similar_file(Path(path))) from None
    except IsADirectoryError:
        inside = sorted(p.name for p in Path(path).glob("*.lmo"))
        hint = f"it contains {', '.join(inside[:5])}{' …' if len(inside) > 5 else ''}" if inside else ""
        raise _refusal("E0611", f"'{name}' is a folder, not a file", hint=hint) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise _refusal("E0611", f"'{name}' cannot be read: {reason}") from None
    return Source(name, _decode(name, data))


def _decode(name: str, data: bytes) -> str:
    if b"\0" in data:
        raise _refusal("E0612", f"'{name}' is not a text file", expected="text in UTF-8", found="binary data")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        found = f"byte 0x{data[error.start]:02x} in line {line}"
        raise _refusal(
            "E0612", f"'{name}' is not text in UTF-8", expected="text in UTF-8", found=found,
            hint="save it with encoding UTF-8",
        ) from None  # fmt: skip
    return re.sub(r"\r(?!\n)", "\n", text) if "\r" in text else text  # lines that end as on the first Macintosh


def _similar_file(path: Path) -> str:
    from lmoc.messages.diagnostics import nearest

    folder = path.parent
    if not folder.is_dir():
        return f"there is no folder '{folder}' either"
    return nearest(path.name, (p.name for p in folder.iterdir()))


def _refusal(code: str, message: str, **more: str) -> ModelError:
    return ModelError([Diagnostic(code, message, **more)])


# ----------------------------------------------------------------------------- the stages


def parse(sources: Sequence[Source], clock: Clock) -> tuple[tree.File, ...]:
    """Syntax trees of the sources.

    Raises
    ------
    ModelError
        With the syntax errors of all of them.
    """
    with clock.stage("parse"):
        from lmoc.syntax.parse import parse as parse_one

        report = Report()
        files = tuple(parse_one(source, report) for source in sources)
        report.check()
    return files


def flatten(scene: Scene, clock: Clock) -> FlatDAE:
    """The flat model of a scene, with the warnings so far in its `notes`."""
    with clock.stage("library"):
        from lmoc.sources import library

        parts = library.load(file.span.source.text for file in scene.files)
    with clock.stage("flatten"):
        from lmoc.semantics.flatten import flatten as flatten_files

        report = Report()
        flat = flatten_files(scene.files, parts, scene.model, scene.parameters, report)
        report.check()
    return flat


def reduce(flat: FlatDAE, values: np.ndarray, states: Sequence[str] | None, clock: Clock) -> Reduced:
    """The reduced system for a set of parameter values."""
    with clock.stage("reduce"):
        from lmoc.semantics.parameter_checks import warn_of_lost
        from lmoc.structure.reduce import reduce as reduce_flat

        # what was warned about before may be the reason why this fails: a part that is connected to nothing
        report = Report([d for d in flat.notes if d.severity == "warning"])
        warn_of_lost(flat, values, report)
        reduced = reduce_flat(flat, values, states, report)
        report.check()
    return reduced
