"""The library: which file holds a type, and which of two types of one name counts."""

from __future__ import annotations

from pathlib import Path

import pytest

from dtwin.errors import FunctionBlockError
from iec61499.library import Library
from tests.support.iec61499.block_files import BASIC, Write


def test_library_finds_types_in_subfolders(write: Write, tmp_path: Path) -> None:
    (tmp_path / "deep" / "er").mkdir(parents=True)
    write("deep/er/SCALE.fbt", BASIC)
    library = Library([tmp_path])
    assert library.names() == ("SCALE",)
    assert library.find("my::package::SCALE") is library.find("SCALE")
    with pytest.raises(FunctionBlockError, match=r"a\.sys:7: unknown block type SCALA: expected SCALE; searched"):
        library.find("SCALA", "a.sys", 7)
    with pytest.raises(FunctionBlockError, match="is not a folder of block types"):
        Library([tmp_path / "SCALE.sub"])


def test_copies_of_a_type_are_one_and_others_are_refused_where_they_are_used(write: Write, tmp_path: Path) -> None:
    (tmp_path / "copy").mkdir()
    write("SCALE.fbt", BASIC)
    write("copy/SCALE.fbt", BASIC)
    write("OTHER.fbt", BASIC, ('Name="SCALE"', 'Name="OTHER"'))
    assert Library([tmp_path]).find("SCALE").header.file == str(tmp_path / "SCALE.fbt")
    write("copy/SCALE.fbt", BASIC, ("2.5", "3.5"))
    library = Library([tmp_path])
    assert library.find("OTHER").header.name == "OTHER"
    message = r"copy/SCALE\.fbt: type SCALE is something else in .*/SCALE\.fbt: expected one file"
    with pytest.raises(FunctionBlockError, match=message):
        library.find("SCALE")


def test_a_file_is_named_after_its_type(write: Write, tmp_path: Path) -> None:
    write("OTHER.fbt", BASIC)
    with pytest.raises(FunctionBlockError, match="holds the type SCALE: expected OTHER, as the file's name says"):
        Library([tmp_path]).find("OTHER")


def test_types_of_a_folder_hide_standard_blocks_if_they_do_something(write: Write, tmp_path: Path) -> None:
    write("E_SWITCH.fbt", BASIC, ('Name="SCALE"', 'Name="E_SWITCH"'))
    basic = BASIC[BASIC.index("  <BasicFB>") : BASIC.index("</BasicFB>") + 10]
    write("E_DELAY.fbt", BASIC, ('Name="SCALE"', 'Name="E_DELAY"'), (basic, ""))
    write("FB_RANDOM.fbt", BASIC, ('Name="SCALE"', 'Name="FB_RANDOM"'), ("<ST Text=", '<Other Language="C" Text='))
    library = Library([tmp_path])
    assert library.find("FB_RANDOM").interface.inputs[0].name == "SEED"
    assert library.find("E_SWITCH").interface.event_inputs[0].name == "REQ"
    assert library.find("E_DELAY").interface.event_inputs[0].name == "START"


def test_a_block_of_a_structure_that_is_not_there_names_the_structure(tmp_path: Path) -> None:
    message = r"a\.sys:3: unknown structure POINT of STRUCT_DEMUX_1POINT: expected a file POINT\.dtp; searched "
    with pytest.raises(FunctionBlockError, match=message):
        Library([tmp_path]).find("STRUCT_DEMUX_1POINT", "a.sys", 3)
