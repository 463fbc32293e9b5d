"""What the tests of FMUs leave out of an export where they do not look at it: it takes more time than all the rest."""

from collections.abc import Iterator

import pytest

from lmoc.export import fmu


@pytest.fixture(scope="module", autouse=True)
def without_icons() -> Iterator[None]:
    """FMUs have no pictures, but for the tests that ask for `icons`."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fmu, "_pictures", lambda *_: None)
        yield


_PICTURES = fmu._pictures


@pytest.fixture
def icons(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fmu, "_pictures", _PICTURES)


@pytest.fixture
def fixed_parameters(monkeypatch: pytest.MonkeyPatch) -> None:
    """No parameter can be set: nothing is tried out to find which can."""
    monkeypatch.setattr("lmoc.export.settable.MOST_TRIED", 0)
