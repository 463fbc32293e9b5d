"""Large scenes: as many objects as declarations, the same equations as one by one."""

from pathlib import Path

import numpy as np
import pytest
from oracles.flattening import equations, flatten_text, sums

from lmoc.semantics import equations as equation_module
from lmoc.semantics.values import array_builtins, constructors

BENCH = sorted((Path(__file__).parents[2] / "models" / "bench").glob("*.lmo"))


def flattened(path: Path, n: int, monkeypatch, long: int):
    for module in (constructors, equation_module, array_builtins):
        monkeypatch.setattr(module, "WRITTEN_OUT", long)
    return flatten_text(path.read_text(encoding="utf-8"), None, {"N": 10 * n})


@pytest.mark.parametrize("path", BENCH, ids=lambda path: path.stem)
def test_loops_at_once_and_round_by_round_give_the_same(path: Path, monkeypatch) -> None:
    at_once = flattened(path, 1, monkeypatch, long=0)
    one_by_one = flattened(path, 1, monkeypatch, long=1000)
    assert sorted(equations(at_once)) == sorted(equations(one_by_one))
    assert sorted(sums(at_once)) == sorted(sums(one_by_one))
    for name in ("starts", "fixed"):
        values = [assigned(d, getattr(d, name)) for d in (at_once, one_by_one)]
        assert np.allclose(*values, rtol=1e-14, equal_nan=True)


def assigned(dae, assignments) -> np.ndarray:
    """Start or fixed values of the declared variables."""
    known = dae.parameter_values()
    result = np.full(next(b.offset for b in dae.blocks if b.path[0][0] in ("literal", "ledger")), np.nan)
    for a in assignments:
        result[a.target] = a.values(known)
    return result


@pytest.mark.parametrize("path", BENCH, ids=lambda path: path.stem)
def test_the_number_of_groups_does_not_grow(path: Path, monkeypatch) -> None:
    small, large = (flattened(path, n, monkeypatch, long=16) for n in (3, 9))
    assert len(small.groups) == len(large.groups)
    assert len(small.blocks) == len(large.blocks)
    assert len(small.parts) == len(large.parts)
    for dae in (small, large):
        unknowns = int(np.sum(dae.kind == 3))
        assert dae.equation_count == unknowns
        assert max(g.slots.shape[1] for g in dae.groups) < 20


@pytest.mark.parametrize("path", BENCH, ids=lambda path: path.stem)
def test_every_column_is_a_variable_of_one_kind(path: Path, monkeypatch) -> None:
    dae = flattened(path, 3, monkeypatch, long=16)
    for group in dae.groups:
        assert group.slots.min() >= 0 and group.slots.max() < dae.count
        kinds = dae.kind[group.slots]
        assert (kinds == kinds[0]).all()
