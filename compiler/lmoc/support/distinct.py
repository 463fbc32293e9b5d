"""Distinct numbers of an array: `numpy.unique` imports `numpy.ma` when first called, which takes 8 ms."""

from __future__ import annotations

import numpy as np


def distinct(values: np.ndarray) -> np.ndarray:
    """The distinct values of an array of any shape, ascending."""
    ordered = np.sort(values, axis=None)
    return ordered[_starts(ordered)]


def first_of_each(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The distinct values, ascending, and where each stands first."""
    order = np.argsort(values, kind="stable")
    ordered = values[order]
    start = _starts(ordered)
    return ordered[start], order[start]


def numbered(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The distinct values, ascending, and for each entry the number of its value among them."""
    order = np.argsort(values, kind="stable")
    ordered = values[order]
    start = _starts(ordered)
    number = np.empty(len(values), np.int64)
    number[order] = np.cumsum(start) - 1
    return ordered[start], number


def distinct_rows(table: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where each distinct row of a table stands first, in this order, and for each row the number of its like."""
    order = np.lexsort(table.T)
    ordered = table[order]
    start = np.ones(len(order), bool)
    start[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    first = order[start]
    appearance = np.argsort(first)
    rank = np.empty(len(first), np.int64)
    rank[appearance] = np.arange(len(first))
    number = np.empty(len(table), np.int64)
    number[order] = rank[np.cumsum(start) - 1]
    return first[appearance], number


def _starts(ordered: np.ndarray) -> np.ndarray:
    start = np.ones(len(ordered), bool)
    start[1:] = ordered[1:] != ordered[:-1]
    return start
