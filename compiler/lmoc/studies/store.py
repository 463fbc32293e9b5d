"""A folder in which an ensemble is kept as it grows, so that it can be interrupted and go on.

Each chunk is a file that is there as a whole or not at all. `study.json` says of which runs they are: with other
values, options or another model the folder is refused.
"""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from lmoc.ir.text.flat import flat_text
from lmoc.messages.diagnostics import Diagnostic, ModelError
from lmoc.numerics.observe.event import Event
from lmoc.report.files import written
from lmoc.studies.ensemble import Chunk
from lmoc.studies.job import Job
from lmoc.support.version import __version__

_ROWS = "rows of a chunk"
_TABLES = ("series", "end", "minimum", "maximum")


class Store:
    """The folder of one ensemble.

    Attributes
    ----------
    size : rows of a chunk
    """

    def __init__(self, folder: str | Path, job: Job, size: Callable[[], int], seed: int | None = None) -> None:
        """
        Parameters
        ----------
        size : of chunks, where the folder is new

        Raises
        ------
        ModelError
            E0667: the folder holds other runs; E0623: it cannot be written.
        """
        self.folder, self._job = Path(folder), job
        about = _about(job) | {"seed": seed}
        target = self.folder / "study.json"
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            kept = json.loads(target.read_text(encoding="utf-8")) if target.exists() else None
        except OSError as error:
            reason = "it is a file, and a store is a folder" if self.folder.is_file() else error.strerror
            raise _refusal("E0623", f"'{folder}' cannot be used as a store: {reason}") from None
        except ValueError as error:
            raise _refusal("E0623", f"'{folder}' cannot be used as a store: 'study.json' in it: {error}") from None
        there = None if kept is None else kept.get(_ROWS)
        self.size: int = there if isinstance(there, int) and there > 0 else size()
        about[_ROWS] = self.size
        if kept is None:
            written(target, lambda beside: beside.write_text(json.dumps(about, indent=1), encoding="utf-8"))
        elif kept != about:
            other = [name for name in about if kept.get(name) != about[name]]
            message = f"'{folder}' holds runs that differ in: {', '.join(other)}"
            raise _refusal("E0667", message, "take another folder, or the values and options of the runs that it holds")

    def _file(self, k: int) -> Path:
        return self.folder / f"chunk-{k:06d}.npz"

    def write(self, k: int, chunk: Chunk) -> None:
        """Keep a chunk."""
        tables = [getattr(chunk, table) for table in _TABLES]
        arrays = {f"{t}{n}": v for t, own in enumerate(tables) for n, v in enumerate(own.values())}
        events = [[_as_list(event) for event in own] for own in chunk.events]
        text = json.dumps({"reasons": chunk.reasons, "events": events})

        def write(beside: Path) -> None:
            with zipfile.ZipFile(beside, "w", zipfile.ZIP_DEFLATED) as archive:
                archive.writestr("about.json", text)
                for name, values in arrays.items():
                    with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                        np.lib.format.write_array(member, np.ascontiguousarray(values), allow_pickle=False)

        written(self._file(k), write)

    def read(self, k: int) -> Chunk | None:
        """Return a chunk; None where it is not there."""
        path = self._file(k)
        if not path.exists():
            return None
        try:
            with zipfile.ZipFile(path) as archive:
                about = json.loads(archive.read("about.json"))
                held = {n: np.load(io.BytesIO(archive.read(n))) for n in archive.namelist() if n.endswith(".npy")}
        except (OSError, ValueError, zipfile.BadZipFile) as error:
            hint = "delete it: its runs are made again"
            raise _refusal("E0667", f"'{path}' is no chunk of a study: {error}", hint) from None
        tables = {
            table: {name: held[f"{t}{n}.npy"] for n, name in enumerate(self._job.names) if f"{t}{n}.npy" in held}
            for t, table in enumerate(_TABLES)
        }
        events = tuple(tuple(_as_event(event) for event in own) for own in about["events"])
        return Chunk(**tables, reasons=tuple(about["reasons"]), events=events)


def _as_list(event: Event) -> list[Any]:
    return [getattr(event, field.name) for field in fields(Event)]


def _as_event(values: list[Any]) -> Event:
    *simple, passed_on = values
    names = [field.name for field in fields(Event)]
    own = dict(zip(names, simple, strict=False))
    return Event(**own, passed_on=tuple((name, impulse) for name, impulse in passed_on))


def _about(job: Job) -> dict[str, Any]:
    """Return what the runs of a job depend on, in the form of digests."""
    session, rows = job.session, job.rows
    values = session.values.tobytes()
    model = _digest(flat_text(session.flat).encode(), values, repr(session.scene.states).encode())
    varied = [
        part
        for table in (rows.parameters, rows.initial, rows.inputs)
        for name, own in sorted(table.items())
        for part in (name.encode(), _content(name, own))
    ]
    same = [_content(name, own) for name, own in sorted(rows.same.items())]
    options = [f"{field.name}: {_words(getattr(job.options, field.name))}" for field in fields(job.options)]
    return {
        "version": __version__,
        "model": model,
        "values": _digest(*varied, *same),
        "options": _digest(*(line.encode() for line in options), job.times.tobytes(), bytes([job.series])),
        "variables": list(job.names),
        "runs": rows.count,
    }


def _digest(*parts: bytes) -> str:
    made = hashlib.sha256()
    for part in parts:
        made.update(len(part).to_bytes(8, "little"))
        made.update(part)
    return made.hexdigest()


def _words(value: object) -> str:
    return repr(list(value)) if isinstance(value, (tuple, list, np.ndarray)) else repr(value)


def _content(name: str, value: object) -> bytes:
    """Return bytes that say what a value is.

    Raises
    ------
    ModelError
        E0667: it is something of which that cannot be said, such as a function.
    """
    if value is None or isinstance(value, (bool, int, float, np.number)):
        return repr(value).encode()
    if isinstance(value, str):
        path = Path(value)
        table = path.read_bytes() if path.suffix and path.is_file() else b""
        return value.encode() + table
    if isinstance(value, np.ndarray) and value.dtype != object:
        return repr((value.shape, value.dtype.str)).encode() + value.tobytes()
    if isinstance(value, Mapping):
        return b"".join(key.encode() + b"\0" + _content(f"{name}.{key}", own) for key, own in sorted(value.items()))
    if isinstance(value, (tuple, list)):
        return b"\1".join(_content(name, own) for own in value)
    message = f"'{name}' is a {type(value).__name__}, of which a store cannot tell whether it is the same next time"
    raise _refusal("E0667", message, "give numbers, formulas in time, or tables; or leave the store out")


def _refusal(code: str, message: str, hint: str = "") -> ModelError:
    return ModelError([Diagnostic(code, message, hint=hint)])
