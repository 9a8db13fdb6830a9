"""Files of other tools are told by name, in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from dtwin.cli import main

EAE = "is a file of EcoStruxure Automation Expert or nxtStudio: expected"
PLCOPEN = "is PLCopen XML of IEC 61131-10"
FIRST = "is a model of 4diac IDE 1.x (EMF)"
JAVA = "is a type in Java, as FBDK compiles it"


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.sys", '<System xmlns="https://www.se.com/LibraryElements" ID="1" Name="S"/>', EAE),
        ("a.fbt", '<FBType xmlns="https://www.se.com/LibraryElements" Name="a"><InterfaceList/></FBType>', EAE),
        ("a.fbt", '<CAT xmlns="http://www.nxtcontrol.com/IEC61499.xsd" Name="a"/>', EAE),
        ("a.sys", '<project xmlns="http://www.plcopen.org/xml/tc6_0201"><fileHeader/></project>', PLCOPEN),
        ("a.fbt", '<Project xmlns="www.iec.ch/public/TC65SC65BWG7TF10" schemaVersion="1.0"/>', PLCOPEN),
        ("a.sys", '<l:AutomationSystem xmlns:l="org.fordiac.ide.model.libraryElement" name="a"/>', FIRST),
        ("a.fbt", "/* made by\n FBDK */\npackage fb.rt;\nimport fb.*;\npublic class a extends FBInstance {}", JAVA),
    ],
)
def test_a_file_of_another_tool_is_told_by_name(
    name: str, text: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / name).write_text(text)
    assert main(["fb", "check", str(tmp_path)]) != 0
    out = capsys.readouterr().out
    assert f"{tmp_path / name}" in out
    assert said in out
    assert len(out.splitlines()) == 2, "one line, and the sum"
