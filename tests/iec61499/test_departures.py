"""The table of what 4diac FORTE computes otherwise, and the warnings that it gives."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from dtwin.cli import main
from dtwin.parameters import ROOT
from iec61499.departures.table import DEPARTURES, departures, table
from iec61499.library import Library
from iec61499.runtime.linking.flattening import flatten
from iec61499.runtime.linking.generic_ports import resolve
from tests.support.iec61499.networks import network

SOURCES = (
    "I: F_REAL_TO_INT; R: F_INT_TO_REAL; S: F_INT_TO_STRING; U: F_INT_TO_ULINT; D: F_DT_TO_DATE; B: F_INT_TO_BYTE"
)


def warnings(blocks: str, data: str = "", parameters: dict[str, str] | None = None) -> list[str]:
    """The cases of the block X."""
    net = replace(network(blocks, "", data, parameters or {}), file="x.sys")
    netlist = flatten(net, Library().find)
    resolve(netlist)
    found = [warning.message for warning in departures(netlist)]
    return [text.split(": ")[2] for text in found if text.startswith("warning: X is a ")]


@pytest.mark.parametrize(
    ("block", "data", "case"),
    [
        ("F_ADD", "I.OUT -> X.IN1; R.OUT -> X.IN2", "an integer at the first input"),
        ("F_LIMIT", "R.OUT -> X.MN; I.OUT -> X.IN; I.OUT -> X.MX", "an integer at the first input"),
        ("F_SEL", "I.OUT -> X.IN0; R.OUT -> X.IN1", "an integer at the first input"),
        ("F_GT", "U.OUT -> X.IN1; U.OUT -> X.IN2", "ULINT or LWORD"),
        ("F_GT", "S.OUT -> X.IN1; S.OUT -> X.IN2", "STRING or WSTRING"),
        ("F_EQ", "D.OUT -> X.IN1; D.OUT -> X.IN2", "dates and times of day"),
        ("F_MOVE", "S.OUT -> X.IN", "texts, dates"),
        ("F_SHL", "B.OUT -> X.IN; I.OUT -> X.N", "by 32 and more"),
        ("F_ROR", "B.OUT -> X.IN; I.OUT -> X.N", "by more than the type has bits"),
        ("F_MULTIME", "R.OUT -> X.IN2", "by REAL or LREAL"),
        ("F_DIV", "R.OUT -> X.IN1; R.OUT -> X.IN2", "a REAL or LREAL by 0"),
        ("F_LREAL_TO_DINT", "", "halfway"),
        ("F_TIME_TO_STRING", "", "any duration"),
        ("F_STRING_TO_WORD", "", "a text that is no literal"),
        ("E_RDELAY", "", "START while it waits"),
    ],
)
def test_a_block_that_departs_is_named(block: str, data: str, case: str) -> None:
    (found,) = warnings(f"{SOURCES}; X: {block}", data)
    assert found.startswith(case)


@pytest.mark.parametrize(
    ("block", "data"),
    [
        ("F_ADD", "R.OUT -> X.IN1; I.OUT -> X.IN2"),
        ("F_ADD", "I.OUT -> X.IN1; I.OUT -> X.IN2"),
        ("F_EQ", "S.OUT -> X.IN1; S.OUT -> X.IN2"),
        ("F_DIV", "I.OUT -> X.IN1; I.OUT -> X.IN2"),
        ("F_MULTIME", "I.OUT -> X.IN2"),
        ("F_MOVE", "I.OUT -> X.IN"),
        ("F_INT_TO_REAL", ""),
        ("E_DELAY", ""),
    ],
)
def test_the_others_are_not(block: str, data: str) -> None:
    assert warnings(f"{SOURCES}; X: {block}", data) == []


@pytest.mark.parametrize(
    ("block", "data", "given", "count"),
    [
        ("F_SHL", "B.OUT -> X.IN", {"X.N": "31"}, 0),
        ("F_SHL", "B.OUT -> X.IN", {"X.N": "INT#32"}, 1),
        ("F_ROL", "B.OUT -> X.IN", {"X.N": "8"}, 0),
        ("F_ROL", "B.OUT -> X.IN", {"X.N": "9"}, 1),
        ("F_DIV", "R.OUT -> X.IN1", {"X.IN2": "2.5"}, 0),
        ("F_DIV", "R.OUT -> X.IN1", {"X.IN2": "REAL#0.0"}, 1),
        ("E_CYCLE", "", {"X.DT": "T#10ms"}, 0),
        ("E_CYCLE", "", {"X.DT": "T#1us"}, 1),
    ],
)
def test_literals_tell_whether_a_case_can_occur(block: str, data: str, given: dict[str, str], count: int) -> None:
    assert len(warnings(f"{SOURCES}; X: {block}", data, given)) == count


def test_the_readme_has_the_table() -> None:
    assert table() in (ROOT / "docs" / "blocks.md").read_text()
    assert len(table().splitlines()) == len(DEPARTURES) + 2


def test_the_check_warns_with_file_and_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "SHIFTER.fbt"
    file.write_text(
        '<FBType Name="SHIFTER"><InterfaceList><EventInputs><Event Name="REQ"/>'
        "</EventInputs></InterfaceList>\n"
        '<FBNetwork>\n<FB Name="SHIFT" Type="F_SHL"/>\n'
        '<EventConnections><Connection Source="REQ" Destination="SHIFT.REQ"/></EventConnections>'
        "</FBNetwork></FBType>"
    )
    assert main(["fb", "check", str(file)]) == 0
    assert capsys.readouterr().out == "files: 1, problems: 0\n"
    assert main(["fb", "check", "--target", "forte", str(file)]) == 0
    warning, summary = capsys.readouterr().out.splitlines()
    assert warning.startswith(
        f"{file}:3: warning: SHIFTER.SHIFT is a F_SHL: by 32 and more (LWORD: 64): shifted by N"
    )
    assert summary == "files: 1, problems: 0, warnings: 1"


def test_the_cell_does_not_depart(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fb", "check", "--target", "forte"]) == 0
    assert capsys.readouterr().out.endswith("problems: 0, warnings: 0\n")
