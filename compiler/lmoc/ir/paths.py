"""Dotted names with subscripts: from the path of a declared name to texts, and back.

A path is a tuple of (name, dimensions): ``seg[3].m[2].q`` belongs to ``(("seg", (N,)), ("m", (M,)), ("q", ()))``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lmoc.support.quoted import partition, split

Subscript = int | tuple[int, int | None]  # an index, or a range: its last None where it is open
NamePath = tuple[tuple[str, tuple[int, ...]], ...]


def dims_of(path: NamePath) -> tuple[int, ...]:
    """Return all dimensions of a path, outermost first."""
    return tuple(n for _, dims in path for n in dims)


def element_name(path: NamePath, position: int) -> str:
    """Return the dotted name of one element; positions count from 0, in row-major order of all dimensions."""
    dims = dims_of(path)
    indices = np.unravel_index(position, dims) if dims else ()
    return _text(path, [int(i) + 1 for i in indices])


def pattern(path: NamePath) -> str:
    """Return the name of all elements at once: ``m[1:10000].q``."""
    return _text(path, [f"1:{n}" if n != 1 else "1" for n in dims_of(path)])


def _text(path: NamePath, indices: Sequence[object]) -> str:
    text, at = [], 0
    for name, dims in path:
        own = indices[at : at + len(dims)]
        at += len(dims)
        text.append(f"{name}[{','.join(map(str, own))}]" if own else name)
    return ".".join(text)


def parse_name(name: str) -> list[tuple[str, tuple[Subscript, ...]]] | None:
    """Split ``a.b[2].c[1:3]`` into names and subscripts; a range is a pair, ``:`` is (1, None). None if no name."""
    if not isinstance(name, str):
        return None
    result = []
    for part in split(name):
        base, bracket, rest = partition(part, "[")
        items: list[Subscript] = []
        if bracket:
            if not rest.endswith("]"):
                return None
            for text in rest[:-1].split(","):
                low, colon, high = (s.strip() for s in text.partition(":"))
                try:
                    if not colon:
                        items.append(int(low))
                    else:
                        items.append((int(low) if low else 1, int(high) if high else None))
                except ValueError:
                    return None
        result.append((base.strip(), tuple(items)))
    return result
