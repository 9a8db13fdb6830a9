"""Blocks as Python that is kept for the next process."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from iec61499 import model
from iec61499.errors import FunctionBlockError
from iec61499.library import Library
from iec61499.runtime.kept import block_text
from iec61499.runtime.kept.block_text import LEAST, BlockText, text_of
from tests.support.driven import FOLDER


def blocks() -> Iterator[model.BasicFBType | model.SimpleFBType]:
    library = Library([FOLDER])
    for name in library.names():
        kind = library.find(name)
        if isinstance(kind, model.BasicFBType | model.SimpleFBType):
            yield kind


@pytest.fixture
def block() -> model.BasicFBType | model.SimpleFBType:
    found = Library([FOLDER]).find("PICK_AND_PLACE")
    assert isinstance(found, model.BasicFBType)
    return found


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder for what is kept."""
    kept = tmp_path / "kept"
    kept.mkdir(mode=0o700)
    monkeypatch.setenv("DTWIN_CACHE_DIR", str(kept))
    return kept


@pytest.fixture
def written(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the blocks that are written anew."""
    names = []

    def note(kind: model.BasicFBType | model.SimpleFBType) -> BlockText:
        names.append(kind.header.name)
        return write(kind)

    write = block_text._written
    monkeypatch.setattr(block_text, "_written", note)
    return names


def test_what_is_kept_is_what_was_written(folder: Path) -> None:
    for kind in blocks():
        fresh = block_text._written(kind)
        assert text_of(kind) == fresh
        assert text_of(kind) == fresh
    assert len(list(folder.iterdir())) > 5


def test_a_block_is_written_once(
    folder: Path, written: list[str], block: model.BasicFBType | model.SimpleFBType
) -> None:
    for _ in range(3):
        text_of(block)
    assert written == [block.header.name]
    assert [path.name.partition("-")[0] for path in folder.iterdir()] == [block.header.name]


def test_another_text_code_or_place_is_another_file(
    folder: Path,
    written: list[str],
    block: model.BasicFBType | model.SimpleFBType,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    text_of(block)
    text_of(replace(block, header=replace(block.header, file="elsewhere.fbt")))  # which its errors name
    monkeypatch.setattr(block_text, "_code", lambda: "another version")
    text_of(block)
    assert len(written) == len(list(folder.iterdir())) == 3


@pytest.mark.parametrize("damage", [lambda text: text[:-9], lambda text: text.replace("_s", "_t"), lambda text: "?"])
def test_a_damaged_file_is_made_anew(
    folder: Path, written: list[str], block: model.BasicFBType | model.SimpleFBType, damage: object
) -> None:
    assert callable(damage)
    first = text_of(block)
    (path,) = folder.iterdir()
    whole = path.read_text()
    path.write_text(damage(whole))
    assert text_of(block) == first
    assert len(written) == 2
    assert path.read_text() == whole


def test_where_nothing_can_be_kept_all_is_written(
    written: list[str],
    block: model.BasicFBType | model.SimpleFBType,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    file = tmp_path / "file"
    file.touch()
    monkeypatch.setenv("DTWIN_CACHE_DIR", str(file))
    assert text_of(block) == text_of(block)
    assert len(written) == 2


def test_short_blocks_and_wrong_ones_are_not_kept(
    folder: Path, block: model.BasicFBType | model.SimpleFBType
) -> None:
    short = next(kind for kind in blocks() if sum(len(each.source.text) for each in kind.algorithms) < LEAST)
    text_of(short)
    first, *others = block.algorithms
    source = replace(first.source, text=first.source.text + "\nNOWHERE := 1;")
    with pytest.raises(FunctionBlockError, match="NOWHERE"):
        text_of(replace(block, algorithms=(replace(first, source=source), *others)))
    assert not list(folder.iterdir())
