"""An application that is read once: the same while its files are, and read anew when one of them has changed."""

import shutil
from pathlib import Path

import pytest

from dtwin.controller.kept import _MOST, _kept, application
from dtwin.controller.ports import BLOCKS, MOTION_SYSTEM, SYSTEM
from dtwin.errors import FunctionBlockError


def test_an_application_is_read_anew_when_a_file_of_it_has_changed(tmp_path: Path) -> None:
    blocks = tmp_path / "fb"
    shutil.copytree(BLOCKS, blocks)
    first, library = application(blocks, SYSTEM)
    library.find("PATH_PLANNER")
    again, kept = application(blocks, SYSTEM)
    assert again is first
    assert kept is library
    file = blocks / "PATH_PLANNER.fbt"
    file.write_text(file.read_text() + "<!-- changed -->")
    _, anew = application(blocks, SYSTEM)
    assert anew is not library
    file.write_text("not a block type")
    _, broken = application(blocks, SYSTEM)
    with pytest.raises(FunctionBlockError, match=r"PATH_PLANNER\.fbt"):
        broken.find("PATH_PLANNER")


def test_systems_of_one_folder_are_apart_and_few_are_kept(tmp_path: Path) -> None:
    whole, motion = application(BLOCKS, SYSTEM)[0], application(BLOCKS, MOTION_SYSTEM)[0]
    assert "SEQUENCE" in {block.name for block in whole.blocks} - {block.name for block in motion.blocks}
    for k in range(_MOST):
        shutil.copytree(BLOCKS, tmp_path / str(k))
        application(tmp_path / str(k), SYSTEM)
    assert len(_kept) <= _MOST


def test_a_link_to_nowhere_beside_the_blocks_does_no_harm(tmp_path: Path) -> None:
    blocks = tmp_path / "fb"
    shutil.copytree(BLOCKS, blocks)
    (blocks / "GONE.fbt").symlink_to(tmp_path / "nowhere.fbt")
    first, _ = application(blocks, SYSTEM)
    assert application(blocks, SYSTEM)[0] is first
