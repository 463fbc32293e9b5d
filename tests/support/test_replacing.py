"""A file is replaced as a whole or not at all."""

import os
from pathlib import Path

import pytest

from lmoc.support import replacing
from lmoc.support.replacing import replace_file, replace_text


def fail_halfway(target: Path) -> None:
    target.write_text("half")
    raise OSError(28, "No space left on device")


def test_the_new_content_takes_the_place_of_the_old(tmp_path: Path) -> None:
    path = tmp_path / "a.lmo"
    replace_text(path, "one\n")
    replace_text(path, "ä\n")
    assert path.read_bytes() == "ä\n".encode() and os.listdir(tmp_path) == ["a.lmo"]


@pytest.mark.parametrize("there", [True, False])
def test_a_failure_leaves_what_was_there(tmp_path: Path, there: bool) -> None:
    path = tmp_path / "a.lmo"
    if there:
        path.write_text("whole")
    with pytest.raises(OSError, match="No space"):
        replace_file(path, fail_halfway)
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == ({"a.lmo": "whole"} if there else {})


def test_an_interruption_leaves_what_was_there(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("whole")

    def interrupted(target: Path) -> None:
        target.write_text("half")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        replace_file(tmp_path / "a", interrupted)
    assert [p.read_text() for p in tmp_path.iterdir()] == ["whole"]


def test_a_disk_that_returns_something_else_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a").write_text("whole")
    monkeypatch.setattr(replacing.Path, "read_bytes", lambda _: b"")
    with pytest.raises(replacing.NotKept):
        replace_text(tmp_path / "a", "new")
    monkeypatch.undo()
    assert (tmp_path / "a").read_text() == "whole"


def test_permissions_and_links_stay(tmp_path: Path) -> None:
    real, link = tmp_path / "real", tmp_path / "link"
    real.write_text("old")
    real.chmod(0o640)
    link.symlink_to(real)
    replace_text(link, "new")
    assert link.is_symlink() and real.read_text() == "new" and real.stat().st_mode & 0o777 == 0o640


def test_a_new_file_has_the_permissions_of_others(tmp_path: Path) -> None:
    (tmp_path / "usual").touch()
    replace_text(tmp_path / "made", "")
    assert (tmp_path / "made").stat().st_mode == (tmp_path / "usual").stat().st_mode


def test_what_is_no_file_is_written_to(tmp_path: Path) -> None:
    written = []
    replace_file(Path(os.devnull), written.append)
    assert written == [Path(os.devnull)]
