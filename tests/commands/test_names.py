"""Names are checked before they become keys, files or folders: in every command, in messages, and in keys."""

import socket
from pathlib import Path

import pytest

from dtwin.bus.codec import MessageError, Reader, encode
from dtwin.bus.opening import open_peer
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import IdentificationDecision
from dtwin.commands.table import COMMANDS
from dtwin.console.people.users import Users
from dtwin.errors import DtwinError, ModelError, ParameterError
from dtwin.identification.store import ModelStore
from dtwin.names import check_name
from dtwin.parameters import ROOT
from dtwin.services import console, emulator, runfile
from dtwin.services.service import main as service_main
from tests.commands.test_cli import complain
from tests.support.ports import free_port

BAD = [
    *("", ".", "..", "../x", "a/b", "a//b", "/a", "a/", "*", "**", "a*", "$*", "a$*b", "#", "?", "a b", " a", "a\n"),
    *("a\0b", "\x1b[2J", "-a", "_a", ".a", "é", "\u202ea", "x" * 33, "x" * 200, "~", "a\\b", "%2e%2e", "a:b"),
]
WHY = ["--why", "to try"]
WORDS = {
    "bench upload": [],
    "commission": ["--live", "--out", "record.json"],
    "console": [],
    "down": [],
    "fault inject": ["K2*=0.5"],
    "gains set": ["--kp", "1", "1", "1"],
    "history": [],
    "identify live": [],
    "mcp": [],
    "mcp approve": ["1"],
    "mcp decline": ["1"],
    "mcp proposals": [],
    "model diff": ["a", "b"],
    "model export": ["a", "a.json"],
    "model list": [],
    "model set": ["--set", "m1=0.1"],
    "model show": ["a"],
    "monitor acknowledge": [],
    "monitor start": [],
    "monitor stop": [],
    "release": [],
    "simulate": ["--live"],
    "status": [],
    "stop": [],
    "target set": ["--time", "3"],
    "up": ["--duration", "1"],
    "upload arm": [*WHY, "planar-2r"],
    "upload gains": [*WHY, "--kp", "1", "1", "1"],
    "upload model": [*WHY, "--model", "a"],
    "upload rollback": WHY,
    "upload target": [*WHY, "--time", "3"],
    "upload version": [*WHY, "1"],
    "watch": [],
}
"""Every command with the name of a cell, and what else it needs."""
ZENOH = ["--zenoh", str(ROOT / "config" / "routed")]
"""A cell elsewhere, where nobody answers: a name must be refused before it is looked for."""


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A working directory and a runtime folder of its own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "runtime"))


def test_every_command_with_a_cell_is_in_the_table() -> None:
    files = {each.module: ROOT / f"{each.path.replace('.', '/')}.py" for each in COMMANDS.values()}
    with_cell = {module for module, file in files.items() if "    cell: str" in file.read_text()}
    assert with_cell | {"live.up", "live.settings"} == {COMMANDS[command].module for command in WORDS}


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_name_is_no_name(name: str) -> None:
    with pytest.raises(ParameterError, match=r"^thing .*: expected letters, digits, .* first a letter or digit"):
        check_name(name, "thing")
    for good in ("a", "7", "cell-2", "a.b_c", "x" * 32):
        assert check_name(good, "thing") == good


@pytest.mark.parametrize("command", WORDS)
def test_every_command_refuses_the_name_of_a_cell_in_one_line(
    command: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    said = complain(capsys, *command.split(), *WORDS[command], "--cell", "../a//b")
    assert said.startswith("dtwin: cell '../a//b': expected letters, digits")
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


@pytest.mark.parametrize("name", ["a/b", "**", "#", "a//b", "../x", "", "x" * 200, "a\x07b", "$*", "?"])
def test_a_cell_is_neither_started_nor_looked_for_under_a_bad_name(
    name: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    for words in (["up", "--duration", "1"], ["up", "--detach"], ["status"], ["stop", *ZENOH]):
        assert "cell " in complain(capsys, *words, f"--cell={name}")
    for words in (["up", "--duration", "1"], ["console", *ZENOH]):
        assert "arm " in complain(capsys, *words, f"--arm={name}")
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_a_service_refuses_names_before_it_joins_the_bus(caplog: pytest.LogCaptureFixture) -> None:
    meet = f"tcp/127.0.0.1:{free_port()}"
    for flag in ("--cell", "--arm"):
        assert service_main("emulator", emulator.Options, [flag, "a/b", "--meet", meet]) == 2
        assert f"{flag[2:]} 'a/b': expected letters" in caplog.text
    assert service_main("console", console.Options, ["--cell", "**", *ZENOH]) == 2


def test_no_key_is_made_of_a_bad_name() -> None:
    for cell, arm in (("a/b", "arm"), ("cell", "**")):
        session = open_peer(f"tcp/127.0.0.1:{free_port()}")
        with pytest.raises(ParameterError, match="expected letters"):
            Bus(session, cell, arm)
        assert session.is_closed()
    with Bus(open_peer(f"tcp/127.0.0.1:{free_port()}")) as bus:
        for expression in ("a//b", "#", "", "/a", "a$**"):
            with pytest.raises(ParameterError, match="expected a key expression"):
                bus.watch_raw(expression, lambda key, payload: None)


@pytest.mark.parametrize("name", BAD)
def test_no_model_and_no_user_has_a_bad_name(name: str, tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="no model"):
        ModelStore(tmp_path).find(name)
    with pytest.raises(DtwinError, match="expected letters"):
        Users(tmp_path / "users.json").set(name, "viewer", "correct horse battery")
    with pytest.raises(DtwinError, match="expected letters"):
        runfile.find(name)
    decision = encode(IdentificationDecision(True, name))
    with pytest.raises(MessageError, match="matching regex"):
        Reader(IdentificationDecision)(decision)


def test_a_model_is_not_asked_for_under_a_bad_name(capsys: pytest.CaptureFixture[str]) -> None:
    for words in (["identify", "--save", "../x"], ["identify", "live", "--name", "../x"]):
        assert "model name '../x': expected letters" in complain(capsys, *words)


def test_a_console_at_a_taken_port_is_one_error_before_anything_is_joined(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        said = complain(capsys, "console", "--port", port)
        assert f"--port {port}: the console cannot listen at 127.0.0.1: Address already in use" in said
        assert service_main("console", console.Options, ["--port", port, *ZENOH]) == 2
    for port in ("70000", "-1"):
        assert f"--port {port}: expected 0 to 65535" in complain(capsys, "console", "--port", port)
