"""What is kept between processes: used where it fits, made again where it does not, never trusted when damaged."""

import os
import sys
from pathlib import Path

import pytest

import lmoc
from lmoc.sources import library
from lmoc.sources.kept import unpacked
from lmoc.support import cache
from lmoc.syntax import tables
from lmoc.syntax.node import alike


def load_again() -> tuple:
    library._load.cache_clear()
    return library.load()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("LMOC_CACHE", str(tmp_path / "kept"))
    return tmp_path / "kept"


def test_what_is_written_is_read(folder: Path) -> None:
    assert cache.read("name", b"key") is None
    cache.write("name", b"key", b"payload")
    assert cache.read("name", b"key") == b"payload"
    assert cache.read("name", b"another key") is None and cache.read("name", b"ke") is None


def test_a_damaged_file_is_not_trusted(folder: Path) -> None:
    cache.write("name", b"key", b"payload" * 10)
    (file,) = folder.iterdir()
    whole = file.read_bytes()
    for damaged in (whole[:-1], whole[:-1] + b"?", b"", whole[:3], whole + b"more"):
        file.write_bytes(damaged)
        assert cache.read("name", b"key") is None


def test_a_folder_that_cannot_be_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("not a folder")
    monkeypatch.setenv("LMOC_CACHE", str(tmp_path / "file"))
    cache.write("name", b"key", b"payload")
    assert cache.read("name", b"key") is None


def test_a_write_leaves_no_traces(folder: Path) -> None:
    cache.write("name", b"key", b"one")
    cache.write("name", b"key", b"two")
    assert len(list(folder.iterdir())) == 1 and cache.read("name", b"key") == b"two"


def test_the_library_from_the_cache_is_the_library_parsed(folder: Path) -> None:
    parsed = load_again()
    kept = load_again()
    assert kept is not parsed and len(kept) == len(parsed)
    for a, b in zip(parsed, kept, strict=True):
        assert alike(a, b)
        assert [c.span.text for c in a.classes] == [c.span.text for c in b.classes]
        assert a.classes[0].name_span.line == b.classes[0].name_span.line


def test_a_library_that_cannot_be_unpacked_is_parsed(folder: Path) -> None:
    parsed = load_again()
    assert unpacked(b"no pickle") is None
    for file in folder.iterdir():
        file.write_bytes(b"nonsense")
    assert all(map(alike, parsed, load_again()))


def test_a_package_is_left_out_where_nobody_names_it(folder: Path) -> None:
    names = lambda files: {c.name for file in files for c in file.classes}  # noqa: E731
    seldom = {c.name for file in library._load("machines.lmo") for c in file.classes}
    assert names(library.load()) - names(library.load(["model A Mass m; end A;"])) == {"Planar"} | seldom
    assert names(library.load(["model A", "import Planar.*;"])) == names(library.load()) - seldom


def test_the_tables_from_the_cache_are_the_tables_made(folder: Path) -> None:
    made = tables.load.__wrapped__()
    kept = tables.load.__wrapped__()
    assert (made.steps, made.gotos, made.rules, made.patterns) == (kept.steps, kept.gotos, kept.rules, kept.patterns)


@pytest.mark.parametrize("chosen", ["", "relative", "~/somewhere"])
def test_a_relative_folder_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, chosen: str) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("LMOC_CACHE", chosen)
    cache.write("name", b"key", b"payload")
    assert cache.folder() is None and cache.read("name", b"key") is None and not list(tmp_path.iterdir())


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="the places of Linux")
def test_without_a_home_nothing_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import pwd

    def unknown(_: int) -> None:
        raise KeyError

    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("LMOC_CACHE", raising=False)
    monkeypatch.delenv("HOME", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setattr(pwd, "getpwuid", unknown)
    assert cache.folder() is None
    cache.write("name", b"key", b"payload")
    assert not list(tmp_path.iterdir())
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache.folder() == str(tmp_path / "lmoc")


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="owners are those of Unix")
def test_what_others_could_have_written_is_not_read(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cache.write("name", b"key", b"payload")
    (file,) = folder.iterdir()
    assert file.stat().st_mode & 0o077 == 0 and folder.stat().st_mode & 0o077 == 0
    file.chmod(0o666)
    assert cache.read("name", b"key") is None
    file.chmod(0o600)
    folder.chmod(0o775)  # by a umask that lets the group write: mended, since the folder is one's own
    assert cache.read("name", b"key") == b"payload" and folder.stat().st_mode & 0o022 == 0
    monkeypatch.setattr(os, "getuid", lambda: folder.stat().st_uid + 1)
    assert cache.read("name", b"key") is None
    cache.write("other", b"key", b"payload")
    assert len(list(folder.iterdir())) == 1


def test_a_file_of_a_package_is_parsed_again_when_its_text_changes(folder: Path, tmp_path: Path) -> None:
    place = tmp_path / "library" / "P"
    place.mkdir(parents=True)
    (place / "package.mo").write_text("package P end P;")
    for value in (3, 3, 4):
        (place / "A.mo").write_text(f"within P;\nmodel A\n  Real y = {value};\nend A;\n")
        assert lmoc.compile("P.A", path=tmp_path / "library").simulate(stop=1)["y"][-1] == value
    assert len(list(folder.glob("file-*"))) == 2


def test_what_is_wrong_with_a_kept_file_is_said_each_time(folder: Path, tmp_path: Path) -> None:
    place = tmp_path / "library" / "P"
    place.mkdir(parents=True)
    (place / "package.mo").write_text("package P end P;")
    (place / "A.mo").write_text("within P;\nmodel A\n  Real y = ;\nend A;\n")
    for _ in range(2):
        with pytest.raises(lmoc.ModelError, match="E01"):
            lmoc.compile("P.A", path=tmp_path / "library")
