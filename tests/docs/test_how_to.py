"""Everything that the how-to pages show is done here, page by page, in a folder of its own."""

import re
import shlex

import pytest
from conftest import ROOT

from lmoc.cli.main import main

PAGES = sorted((ROOT / "docs" / "how-to").glob("*.md"))
_BLOCK = re.compile(r"```(\w+)(?: (\S+))?\n(.*?)```", re.DOTALL)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_what_a_page_shows_works(page, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "models").symlink_to(ROOT / "models")
    variables: dict = {}
    before = set()
    for language, name, text in _BLOCK.findall(page.read_text(encoding="utf-8")):
        if name:
            (tmp_path / name).write_text(text, encoding="utf-8")
        elif language == "sh":
            for line in text.strip().splitlines():
                verb, *arguments = shlex.split(line)
                assert verb == "lmoc"
                assert main(arguments) == 0, (line, capsys.readouterr().err)
        elif language == "python":
            exec(compile(text, str(page), "exec"), variables)  # noqa: S102
        before |= set(re.findall(r'[-\w]+\.(?:png|svg|pdf|html)\b', text))
    missing = [name for name in before if "#" not in name and not (tmp_path / name).is_file()]
    assert not missing, "named on the page, but not made"


def test_the_list_names_every_page():
    text = (ROOT / "docs" / "how-to" / "README.md").read_text(encoding="utf-8")
    listed = set(re.findall(r"\]\(([-\w]+)\.md\)", text))
    assert listed == {p.stem for p in PAGES} - {"README"}


def test_the_fit_finds_what_the_data_were_made_with(tmp_path, monkeypatch):
    page = (ROOT / "docs" / "how-to" / "fit.md").read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    variables: dict = {}
    for language, name, text in _BLOCK.findall(page):
        if name:
            (tmp_path / name).write_text(text, encoding="utf-8")
        elif language == "python" and "least_squares" in text:
            exec(compile(text, "fit.md", "exec"), variables)  # noqa: S102
    assert variables["k"] == pytest.approx(40, rel=0.05) and variables["c"] == pytest.approx(1.2, rel=0.15)
