"""Results in the form of MATLAB files that Dymola and OpenModelica write ("dsres"), which their viewers read.

Matrices of MATLAB's level 4: ``Aclass`` (what it is), ``name`` and ``description`` (a column each), ``dataInfo`` (in
which of the two tables a variable stands, in which row), ``data_1`` (what does not change, at the first and the last
time) and ``data_2`` (what does, at all times), with the time as the first row of both.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

_TEXT, _INTEGER, _REAL = 51, 20, 0  # kinds of matrices of MATLAB's level 4, little-endian
_CONSTANT, _CHANGING = 1, 2
_LINEAR, _NONE = 0, -1  # between the times, and beyond them


def write_trajectory(path: Path, columns: Mapping[str, np.ndarray], descriptions: Mapping[str, str]) -> None:
    """Write a run: `columns` by name, the time first; equal ones stand in the file once."""
    time = columns["time"]
    tables: dict[int, list[np.ndarray]] = {_CONSTANT: [time[[0, -1]]], _CHANGING: [time]}
    rows: dict[bytes, int] = {}
    info = [(0, 1, _LINEAR, _NONE)]
    for name, values in columns.items():
        if name == "time":
            continue
        own = np.asarray(values, float)
        table = _CONSTANT if (own == own[0]).all() else _CHANGING
        key = own.tobytes()
        if key not in rows:
            tables[table].append(own[[0, -1]] if table == _CONSTANT else own)
            rows[key] = len(tables[table])
        info.append((table, rows[key], _LINEAR, _NONE))
    names = ["time", *(name for name in columns if name != "time")]
    with path.open("wb") as file:
        file.write(_texts("Aclass", ["Atrajectory", "1.1", "", "binTrans"], across=True))
        file.write(_texts("name", names))
        file.write(_texts("description", [descriptions.get(name, "") for name in names]))
        file.write(_matrix("dataInfo", np.array(info, "<i4").T, _INTEGER))
        for table, own_rows in tables.items():
            file.write(_matrix(f"data_{table}", np.array(own_rows, "<f8"), _REAL))


def _texts(name: str, texts: Sequence[str], across: bool = False) -> bytes:
    """A matrix of letters with a text in each column, or `across`, in each row."""
    lines = [text.encode() for text in texts]
    length = max(map(len, lines))
    letters = np.frombuffer(b"".join(line.ljust(length) for line in lines), np.uint8).reshape(len(lines), length)
    return _matrix(name, letters if across else letters.T, _TEXT)


def _matrix(name: str, values: np.ndarray, kind: int) -> bytes:
    head = struct.pack("<5i", kind, *values.shape, 0, len(name) + 1)
    return head + name.encode() + b"\0" + values.tobytes("F")
