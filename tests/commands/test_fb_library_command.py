"""`dtwin fb check`, `export` and `deploy`."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from dtwin.cli import main
from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.remote import RemoteController
from dtwin.parameters import ROOT
from dtwin.run.cell import Cell
from dtwin.run.settings import CellSettings
from iec61499 import model
from iec61499.deploy.device_type import DeviceType
from iec61499.library import Library
from tests.commands.test_fb_command import device
from tests.support.driven import DEPLOYED
from tests.support.iec61499.lua_bench import LuaBench

BLOCKS = ROOT / "fb"


def changed(name: str, folder: Path, *replacements: tuple[str, str]) -> Path:
    """A copy of a file of the library, changed."""
    text = (BLOCKS / name).read_text()
    for old, new in replacements:
        assert old in text
        text = text.replace(old, new)
    (folder / name).write_text(text)
    return folder / name


def test_the_project_library_has_no_problems(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fb", "check"]) == 0
    assert re.fullmatch(r"files: \d\d, problems: 0\n", capsys.readouterr().out)


def test_every_problem_is_a_line_with_its_place(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = changed(
        "EVENT_COUNTER.fbt",
        tmp_path,
        ("COUNT := COUNT + 1;", "COUNT := CONT + 1;"),
        ("COUNT := 0;", "COUNT := TRUE;"),
        ('"REQ[COUNT + 1 &gt;= COUNT_LIMIT]"', '"REQ[COUNT + 1]"'),
    )
    lines = file.read_text().splitlines()
    place = {what: next(n for n, line in enumerate(lines, 1) if what in line) for what in ("CONT", "TRUE;", "+ 1]")}
    assert main(["fb", "check", str(file)]) == 1
    *problems, summary = capsys.readouterr().out.splitlines()
    assert summary == "files: 1, problems: 5"
    expected = "expected COUNT or COUNT_LIMIT, or a constant that is imported"
    assert f"{file}:{place['CONT']}:10: unknown variable CONT: {expected}" in problems
    assert any(problem.startswith(f"{file}:{place['TRUE;']}:10: ") for problem in problems)
    assert any(problem.startswith(f"{file}:{place['+ 1]']}: condition 'COUNT + 1', column ") for problem in problems)


@pytest.mark.parametrize(
    ("name", "replacement", "complaint"),
    [
        (
            "DIGITAL_TWIN.fbt",
            ('Destination="MONITORING.THETA_T2"', 'Destination="MONITORING.THETA_T9"'),
            "has no data input THETA_T9",
        ),
        ("DIGITAL_TWIN.fbt", ('Source="INIT"', 'Source="THETA1"'), "it is another kind of port"),
        (
            "DIGITAL_TWIN.fbt",
            ('"SYSTEM_MONITORING"', '"SYSTEM_MONITORINGS"'),
            "unknown block type SYSTEM_MONITORINGS: expected SYSTEM_MONITORING",
        ),
        (
            "DIGITAL_TWIN.fbt",
            ('Name="COUNT_LIMIT" Type="DINT"', 'Name="COUNT_LIMIT" Type="STRING"'),
            "STRING does not fit DINT",
        ),
        ("dtwin.sys", ('Name="T" Value="2.0"', 'Name="T" Value="soon"'), "'soon' is not a LREAL"),
        ("dtwin.sys", ('"CELL.PLANNER"', '"CELL.PLANER"'), "mapping of unknown block 'CELL.PLANER'"),
        ("DATA_SELECTOR.fbt", ("<BasicFB>", "<BasicFB><Method/>"), "<Method> needs the attribute Name"),
        ("DATA_SELECTOR.fbt", ("</BasicFB>", ""), "not well-formed XML"),
        (
            "DATA_SELECTOR.fbt",
            ('Name="DATA_SELECTOR"', 'Name="SELECTOR"'),
            "expected DATA_SELECTOR, as the file's name says",
        ),
    ],
)
def test_mistakes_are_found(
    name: str, replacement: tuple[str, str], complaint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = changed(name, tmp_path, replacement)
    assert main(["fb", "check", str(file), "--blocks", str(BLOCKS)]) == 1
    first = capsys.readouterr().out.splitlines()[0]
    assert re.match(rf"{re.escape(str(file))}:\d+: |{re.escape(str(file))}:\d+:\d+: ", first)
    assert complaint in first


def test_what_cannot_be_checked_is_a_problem(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "wrong.fboot").write_text(";<Request ID='1' Action='SING'/>\n")
    arguments = [str(tmp_path / "missing.fbt"), str(ROOT / "README.md"), str(tmp_path)]
    assert main(["fb", "check", *arguments]) == 1
    missing, readme, boot, summary = capsys.readouterr().out.splitlines()
    assert "missing.fbt: cannot be read" in missing
    assert "expected a file that ends in .fbt, .sub, .sys or .fboot" in readme
    assert boot.startswith(f"{tmp_path / 'wrong.fboot'}:1: ")
    assert summary == "files: 3, problems: 3"


def test_lua_files_hold_the_types(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fb", "export", "--format", "lua", str(tmp_path / "lua")]) == 0
    files = [Path(line) for line in capsys.readouterr().out.splitlines()]
    assert sorted(file.stem for file in files) == [
        "BOX_TRACKING",
        "CHAIN_LINK",
        "COMPUTED_TORQUE_CONTROL_3",
        "DATA_SELECTOR",
        "ENCODER_OFFSET",
        "EVENT_COUNTER",
        "JOINT_BRAKE",
        "JOINT_DRIVE",
        "JOINT_FEEDBACK",
        "JOINT_OBSERVER",
        "JOINT_PATH",
        "JOINT_READING",
        "NEWEST_MESSAGE",
        "ORDER_DISPATCH",
        "ORDER_EXECUTION",
        "PATH_PLANNER",
        "PICK_AND_PLACE",
        "POSE_SEQUENCE",
        "RESTART_DETECTOR",
        "SAFE_STOP",
        "STATE_OBSERVER_3",
        "STATION_SETUP",
        "SYS_IDENT_3211SIG",
        "TRACK_ROUTER",
    ]
    counter = Library([BLOCKS]).find("EVENT_COUNTER")
    assert isinstance(counter, model.BasicFBType)
    bench = LuaBench(DeviceType("COUNTER", (tmp_path / "lua" / "EVENT_COUNTER.lua").read_text(), counter))
    assert [bench.fire("REQ", COUNT_LIMIT=3) for _ in range(6)] == [[], [], ["CNT_CMP"]] * 2


def test_c_files_are_a_unit_of_the_resource(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    system = str(BLOCKS / "motion.sys")
    assert main(["fb", "export", "--format", "c", str(tmp_path), "--system", system]) == 0
    assert [Path(line).name for line in capsys.readouterr().out.splitlines()] == ["fb.h", "motion.h", "motion.c"]
    assert "int32_t motion__exchange__ARM(struct motion *unit" in (tmp_path / "motion.h").read_text()


def test_a_boot_file_runs_the_cell(tmp_path: Path) -> None:
    system = tmp_path / "cell.sys"
    system.write_text(re.sub(r"localhost:615\d\d", "localhost:0", (BLOCKS / "dtwin.sys").read_text()))
    (tmp_path / "types").mkdir()
    for file in BLOCKS.glob("*.fbt"):
        text = re.sub(r"localhost:615\d\d", "localhost:0", file.read_text())
        (tmp_path / "types" / file.name).write_text(text)
    blocks = str(tmp_path / "types")
    assert main(["fb", "export", str(tmp_path / "boot"), "--system", str(system), "--blocks", blocks]) == 0
    boot = tmp_path / "boot" / "FORTE_PC.fboot"
    assert main(["fb", "check", str(boot)]) == 0
    settings = CellSettings(duration=5.0, seed=3, control=DEPLOYED)
    with (
        device(boot, "--blocks", blocks) as (_, addresses),
        RemoteController(addresses["CELL.EMULATOR"], EmbeddedController(settings.control)) as controller,
    ):
        Cell(settings, controller).run()
        assert controller.largest_difference == 0.0


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["deploy", "127.0.0.1:1"], "127.0.0.1:1: cannot connect"),
        (["deploy", "127.0.0.1:1", "--device", "PLC"], "--device 'PLC': expected FORTE_PC"),
        (["deploy", "127.0.0.1:1", "--system", "missing.sys"], "missing.sys: cannot be read"),
        (["deploy", "nowhere"], "nowhere"),
        (["export", "README.md"], "README.md: cannot be made a folder"),
    ],
)
def test_bad_input_is_one_line(
    arguments: list[str], complaint: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    assert main(["fb", *arguments]) == 2
    error = capsys.readouterr().err
    assert complaint in error
    assert error.count("\n") == 1


def test_deploying_twice_from_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    types = tmp_path / "types"
    types.mkdir()
    for file in BLOCKS.iterdir():
        if file.suffix in (".fbt", ".sys"):
            (types / file.name).write_text(re.sub(r"localhost:615\d\d", "localhost:0", file.read_text()))
    with device("--blocks", types) as (_, addresses):
        arguments = [str(addresses["management"]), "--system", str(types / "dtwin.sys")]
        for _ in range(2):
            assert main(["fb", "deploy", *arguments]) == 0
            assert re.fullmatch(r"EMB_RES runs: \d+ block types, \d+ requests\n", capsys.readouterr().out)
        assert main(["fb", "watch", arguments[0], "CELL.EMULATOR.STATUS", "--count", "1"]) == 0
        assert capsys.readouterr().out.endswith("\nOK\n")
