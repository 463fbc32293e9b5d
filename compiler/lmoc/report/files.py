"""Tables of a run as files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lmoc.messages.diagnostics import Diagnostic, ModelError
from lmoc.report.trajectory_file import write_trajectory
from lmoc.support.replacing import replace_file

if TYPE_CHECKING:
    from lmoc.report.result import Result

Columns = dict[str, np.ndarray]


def _csv(path: Path, columns: Columns) -> None:
    def quoted(name: str) -> str:
        """A name as in RFC 4180: within quotation marks where it has a comma (m[1,2].q), such a mark or a line end."""
        doubled = name.replace('"', '""')
        return f'"{doubled}"' if any(sign in name for sign in ',"\r\n') else name

    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(",".join(map(quoted, columns)) + "\n")
        for row in zip(*(values.tolist() for values in columns.values()), strict=True):
            file.write(",".join(map(repr, row)) + "\n")


def _npz(path: Path, columns: Columns) -> None:
    """As `numpy.savez_compressed`, which takes names as keywords and so refuses or drops some ('file')."""
    import zipfile  # heavy, and most runs write no such file

    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, values in columns.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.ascontiguousarray(values), allow_pickle=False)


def _parquet(path: Path, columns: Columns) -> None:
    import pandas

    pandas.DataFrame(columns).to_parquet(path)


FORMATS: dict[str, Callable[[Path, Columns], None]] = {".csv": _csv, ".npz": _npz, ".parquet": _parquet}
ENDINGS = (*FORMATS, ".mat")
PICTURES = (".png", ".svg", ".pdf")


def save(run: Result, path: Path, names: Sequence[str] | None = None) -> Path:
    """Write the columns of a run; the ending of the name says how. Errors as `Run.save`."""
    check_target(path, ENDINGS)
    columns, ending = run.columns(names), path.suffix.lower()
    if ending == ".mat":
        texts = {name: _described(run, name) for name in columns}
        return written(path, lambda target: write_trajectory(target, columns, texts))
    return written(path, lambda target: FORMATS[ending](target, columns))


def _described(run: Result, name: str) -> str:
    """What a variable is, with its unit, as the programs that read such files expect it."""
    if name == "time":
        return "Time [s]"
    about = run.about(name)
    unit = about.get("units", "")
    return " ".join(filter(None, (about.get("long_name", ""), f"[{unit}]" if unit else "")))


def written(path: Path, write: Callable[[Path], object]) -> Path:
    """Have a file made, as `replace_file` does.

    Raises
    ------
    ModelError
        E0623 it cannot be written.
    """
    try:
        replace_file(path, write)
    except ImportError as error:
        hint = "pip install pyarrow" if path.suffix.lower() == ".parquet" else ""
        raise _refusal("E0623", f"'{path}' cannot be written: {_first_line(error)}", hint) from None
    except OSError as error:
        raise _refusal("E0623", f"'{path}' cannot be written: {error.strerror or error}") from None
    return path


def check_target(path: Path, endings: Sequence[str]) -> None:
    """Refuse a path that cannot be written to, before work is spent on what should stand there.

    Raises
    ------
    ModelError
        E0623 no such folder, or a folder itself; E0624 unknown ending.
    """
    if path.suffix.lower() not in endings:
        found = f"'{path.suffix}'" if path.suffix else "a name without ending"
        raise _refusal("E0624", f"the format of '{path}' is not known", expected=", ".join(endings), found=found)
    if path.is_dir():
        raise _refusal("E0623", f"'{path}' is a folder")
    if not path.parent.is_dir():
        raise _refusal("E0623", f"'{path}' cannot be written: there is no folder '{path.parent}'")
    _check_permission(path)


def _check_permission(path: Path) -> None:
    """A file is made beside the one that it replaces: both it and its folder must be writable."""
    import os

    places = [path, path.parent] if path.is_file() else [path if path.exists() else path.parent]
    if not all(os.access(place, os.W_OK) for place in places):
        raise _refusal("E0623", f"'{path}' cannot be written: permission denied")


def _first_line(error: Exception) -> str:
    return str(error).strip().splitlines()[0]


def _refusal(code: str, message: str, hint: str = "", **more: str) -> ModelError:
    return ModelError([Diagnostic(code, message, hint=hint, **more)])
