"""Boot files: printed, read, and refused by line."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.errors import FunctionBlockError
from iec61499.management.bootfile import Command, load_boot_file, parse_boot_file, print_boot_file
from iec61499.management.protocol import (
    ManagedType,
    Request,
    RequestAction,
)
from tests.support.iec61499.requests import names, subjects

BOOT = """;<Request ID="1" Action="CREATE"><FB Name="R" Type="EMB_RES" /></Request>
R;<Request ID="2" Action="CREATE"><FBType Name="X">line one
line two</FBType></Request>

R;<Request ID="3" Action="START"/>
"""


def test_a_boot_file_reads_and_prints() -> None:
    commands = parse_boot_file(BOOT)
    assert [(command.resource, command.line) for command in commands] == [("", 1), ("R", 2), ("R", 5)]
    assert commands[1].request.subject == ManagedType("X", "line one\nline two")
    assert parse_boot_file(BOOT.replace("\n", "\r\n"))[2].request == Request("3", "START")
    assert print_boot_file(commands) == BOOT.replace("\n\n", "\n")


@given(
    st.lists(st.builds(Command, names, st.builds(Request, names, st.sampled_from(get_args(RequestAction)), subjects)))
)
def test_printed_boot_files_read_back(commands: list[Command]) -> None:
    read = parse_boot_file(print_boot_file(commands))
    assert [(c.resource, c.request) for c in read] == [(c.resource, c.request) for c in commands]


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ('<Request ID="1" Action="START"/>', r"^app\.fboot:2: expected RESOURCE;<Request"),
        (
            'R;<Request ID="1" Action="GO"/>',
            r"^app\.fboot:2: expected <Request> with the Action CREATE, .* 'GO'$",
        ),
        ('R;<Request ID="1"', r"^app\.fboot:2: .*not well-formed"),
    ],
)
def test_errors_in_boot_files_name_the_line(line: str, complaint: str) -> None:
    with pytest.raises(FunctionBlockError, match=complaint):
        parse_boot_file(BOOT.splitlines()[0] + "\n" + line + "\n", "app.fboot")


def test_unreadable_boot_files(tmp_path: Path) -> None:
    with pytest.raises(FunctionBlockError, match=r"missing\.fboot: cannot be read: No such file"):
        load_boot_file(tmp_path / "missing.fboot")
    binary = tmp_path / "binary.fboot"
    binary.write_bytes(b"\xff\xfe")
    with pytest.raises(FunctionBlockError, match=r"binary\.fboot: is not UTF-8 at byte 0"):
        load_boot_file(binary)
