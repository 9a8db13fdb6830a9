"""The library: which file holds a type, and which of two types of one name counts."""

from __future__ import annotations

from pathlib import Path

import pytest

from dtwin.errors import FunctionBlockError
from dtwin.iec61499.library import Library
from tests.support.iec61499.block_files import BASIC, Write


def test_library_finds_types_in_subfolders(write: Write, tmp_path: Path) -> None:
    (tmp_path / "deep" / "er").mkdir(parents=True)
    write("deep/er/SCALE.fbt", BASIC)
    library = Library([tmp_path])
    assert library.names() == ("SCALE",)
    assert library.find("my::package::SCALE") is library.find("SCALE")
    with pytest.raises(FunctionBlockError, match=r"a\.sys:7: unknown block type SCALA: expected SCALE; searched"):
        library.find("SCALA", "a.sys", 7)
    write("SCALE.sub", BASIC)
    with pytest.raises(FunctionBlockError, match=r"SCALE.*type SCALE is also in .*: expected one file"):
        Library([tmp_path])
    with pytest.raises(FunctionBlockError, match="is not a folder of block types"):
        Library([tmp_path / "SCALE.sub"])


def test_a_file_is_named_after_its_type(write: Write, tmp_path: Path) -> None:
    write("OTHER.fbt", BASIC)
    with pytest.raises(FunctionBlockError, match="holds the type SCALE: expected OTHER, as the file's name says"):
        Library([tmp_path]).find("OTHER")


def test_types_of_a_folder_hide_standard_blocks_if_they_do_something(write: Write, tmp_path: Path) -> None:
    write("E_SWITCH.fbt", BASIC, ('Name="SCALE"', 'Name="E_SWITCH"'))
    basic = BASIC[BASIC.index("  <BasicFB>") : BASIC.index("</BasicFB>") + 10]
    write("E_DELAY.fbt", BASIC, ('Name="SCALE"', 'Name="E_DELAY"'), (basic, ""))
    library = Library([tmp_path])
    assert library.find("E_SWITCH").interface.event_inputs[0].name == "REQ"
    assert library.find("E_DELAY").interface.event_inputs[0].name == "START"
