"""Our dataclasses against those of the standard library: what a class or an instance answers is the same."""

import copy
import dataclasses
import inspect
import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import FrozenInstanceError, field

import pytest

from lmoc.numerics.observe.event import Event
from lmoc.support import records


def both(body):
    """The same class, decorated by either."""
    return body(dataclasses.dataclass), body(records.dataclass)


def shapes(dataclass):
    @dataclass(frozen=True)
    class Point:
        x: float
        y: float = 2.0
        names: list[str] = field(default_factory=list, compare=False)
        secret: int = field(default=7, repr=False, kw_only=True)

        def __post_init__(self):
            if self.x < 0:
                raise ValueError("negative")

    @dataclass(frozen=True)
    class Weighted(Point):
        weight: float = 1.0

    @dataclass(eq=False)
    class Open:
        x: float

    return Point, Weighted, Open


THEIRS, OURS = both(shapes)


@pytest.mark.parametrize("k", range(3))
def test_the_signature_and_the_fields_are_the_same(k):
    theirs, ours = THEIRS[k], OURS[k]
    assert [p.name for p in inspect.signature(ours).parameters.values()] == list(inspect.signature(theirs).parameters)
    kinds = [[p.kind for p in inspect.signature(c).parameters.values()] for c in (theirs, ours)]
    assert kinds[0] == kinds[1]
    assert [f.name for f in dataclasses.fields(ours)] == [f.name for f in dataclasses.fields(theirs)]
    assert ours.__match_args__ == theirs.__match_args__
    assert ours.__init__.__qualname__ == theirs.__init__.__qualname__


@pytest.mark.parametrize("k", range(2))
def test_values_equality_hash_and_text_are_the_same(k):
    calls = [((1.0,), {}), ((1.0, 3.0), {"secret": 4}), ((1.0,), {"y": 2.0, "names": ["a"]}), ((float("nan"),), {})]
    theirs, ours = ([c[k](*a, **n) for a, n in calls] for c in (THEIRS, OURS))
    assert [repr(i) for i in ours] == [repr(i) for i in theirs]
    assert [dataclasses.asdict(i) for i in ours[:-1]] == [dataclasses.asdict(i) for i in theirs[:-1]]
    assert [[a == b for b in ours] for a in ours] == [[a == b for b in theirs] for a in theirs]
    assert ours[0] == ours[2] and hash(ours[0]) == hash(ours[2]) and ours[0] != ours[1]
    assert ours[0].names is not ours[1].names


def test_instances_of_a_base_and_of_a_derived_class_differ():
    point, weighted, _ = OURS
    assert point(1.0) != weighted(1.0) and weighted(1.0).__eq__(1) is NotImplemented


def test_a_frozen_instance_stays_what_it_is():
    for item in (OURS[0](1.0), OURS[1](1.0)):
        with pytest.raises(FrozenInstanceError, match="assign to field 'x'"):
            item.x = 2.0
        with pytest.raises(FrozenInstanceError, match="delete field 'x'"):
            del item.x
    item = OURS[2](1.0)
    item.x = 2.0
    assert item.x == 2.0 and item != OURS[2](2.0) and hash(item) == hash(item)


def test_a_class_that_can_change_has_no_hash():
    @records.dataclass
    class Changing:
        x: int

    assert Changing(1) == Changing(1)
    with pytest.raises(TypeError, match="unhashable"):
        hash(Changing(1))


def test_wrong_arguments_are_refused_in_the_same_words():
    for arguments, named in (((), {}), ((1, 2, [], 3), {}), ((1,), {"unknown": 2})):
        texts = []
        for point in (THEIRS[0], OURS[0]):
            with pytest.raises(TypeError) as caught:
                point(*arguments, **named)
            texts.append(str(caught.value))
        assert texts[0] == texts[1]


def test_what_is_checked_after_construction_is_checked():
    for k in range(2):
        with pytest.raises(ValueError, match="negative"):
            OURS[k](-1.0)
        with pytest.raises(ValueError, match="negative"):
            dataclasses.replace(OURS[k](1.0), x=-1.0)


def test_a_record_with_other_values_is_that_of_the_standard_library():
    item = Event(1.0, "string", "taut", impulse=2.0)
    assert records.replace(item, time=3.0, kind="slack") == dataclasses.replace(item, time=3.0, kind="slack")
    assert item == Event(1.0, "string", "taut", impulse=2.0)
    object.__setattr__(item, "found", 7)  # as a cached property does: of this item alone
    assert not hasattr(records.replace(item, time=3.0), "found")
    with pytest.raises(TypeError, match="no field instant"):
        records.replace(item, instant=3.0)
    with pytest.raises(TypeError, match="fields alone"):  # what the constructor checks would go unchecked
        records.replace(OURS[0](1.0), x=-1.0)


def test_copies_and_pickles_are_equal_also_before_the_first_instance_is_made():
    item = Event(1.0, "string", "taut")
    assert copy.copy(item) == copy.deepcopy(item) == pickle.loads(pickle.dumps(item)) == item
    program = (
        f"import pickle; item = pickle.loads({pickle.dumps(item)!r}); print(item == type(item)(1.0, 'string', 'taut'))"
    )
    found = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert found.stdout == "True\n"


def test_a_constructor_of_ones_own_is_kept():
    @records.dataclass
    class Own:
        x: int

        def __init__(self, text):
            self.x = int(text)

        def __repr__(self):
            return "own"

    assert Own("3").x == 3 and repr(Own("3")) == "own"


def test_many_threads_may_make_the_first_instance():
    for _ in range(50):

        @records.dataclass(frozen=True)
        class Late:
            x: int
            more: list = field(default_factory=list)

        with ThreadPoolExecutor(8) as pool:
            found = list(pool.map(Late, range(16)))
        assert [item.x for item in found] == list(range(16)) and len({id(item.more) for item in found}) == 16
