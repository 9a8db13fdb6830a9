"""`fb watch`, `force`, `trigger`, `start` and `stop`: one device, and all of a system."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from iec61499.cli import main
from iec61499.deploy.watching import opened
from iec61499.library import Library
from tests.support.iec61499.served_device import ANY_PORT, ServedDevice, build

NETWORK = """
N E_CTU PV=3
M INT2INT IN=7
START.COLD -> N.R
N.CUO -> M.REQ
"""
SYSTEM = """<System Name="s"><Application Name="A"><SubAppNetwork/></Application>DEVICES</System>"""
DEVICE = """<Device Name="{}" Type="FORTE_PC"><Parameter Name="MGR_ID" Value="&quot;localhost:{}&quot;"/>
<Resource Name="R" Type="EMB_RES"/></Device>"""


@pytest.fixture
def system(tmp_path: Path) -> Iterator[Path]:
    """Two devices LEFT and RIGHT, each with the network in its resource R; a resource ALONE on RIGHT."""
    started = {}
    for name in ("LEFT", "RIGHT"):
        started[name] = ServedDevice(Library(), ANY_PORT)
        started[name].start()
        with started[name].client() as client:
            build(client, "R", NETWORK)
            client.start("R")
            if name == "RIGHT":
                build(client, "ALONE", "ONLY E_CTU PV=1")
                client.start("ALONE")
    ports = {name: device.management.address.port for name, device in started.items()}
    file = tmp_path / "s.sys"
    file.write_text(SYSTEM.replace("DEVICES", "".join(DEVICE.format(*each) for each in ports.items())))
    yield file
    for device in started.values():
        device.stop()


def said(capsys: pytest.CaptureFixture[str], *words: object) -> list[str]:
    """What a command prints, line for line; it must end well."""
    assert main([str(word) for word in words]) == 0
    return capsys.readouterr().out.splitlines()


def test_all_devices_of_a_system_are_watched(system: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = ("LEFT.N.CU", "LEFT.R.N.CV", "RIGHT.N.CV", "ONLY.PV")
    assert said(capsys, "watch", system, *names, "--count", 1) == ["\t".join(names), "0\t0\t0\t1"]
    assert said(capsys, "trigger", system, "LEFT.N.CU", "LEFT.N.CU", "RIGHT.N.CU")[0] == "LEFT.N.CU happened"
    assert said(capsys, "watch", system, *names[1:], "--count", 1)[1] == "2\t1\t1"
    assert main(["watch", str(system), "N.CV"]) == 2
    assert "N.CV: expected one of LEFT.R.N.CV or RIGHT.R.N.CV" in capsys.readouterr().err
    assert main(["watch", str(system), "LEFT.NONE.CV"]) == 2
    assert "LEFT.NONE.CV: no such block or port" in capsys.readouterr().err


def test_an_application_may_be_called_as_its_device(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    device = ServedDevice(Library(), ANY_PORT)
    device.start()
    with device.client() as client:
        build(client, "R", "PUMP.N E_CTU PV=5")
        client.start("R")
    file = tmp_path / "s.sys"
    file.write_text(SYSTEM.replace("DEVICES", DEVICE.format("PUMP", device.management.address.port)))
    names = ("PUMP.N.PV", "PUMP.PUMP.N.PV", "R.PUMP.N.PV", "PUMP.R.PUMP.N.PV")
    assert said(capsys, "watch", file, *names, "--count", 1)[1] == "5\t5\t5\t5"
    device.stop()


def test_a_forced_value_has_a_mark_and_an_end(system: Path, capsys: pytest.CaptureFixture[str]) -> None:
    seen: list[str] = []

    def look(seconds: float) -> None:
        seen.extend(said_while_forced())

    def said_while_forced() -> list[str]:
        assert main(["watch", str(system), "LEFT.M.IN", "--count", "1"]) == 0
        return capsys.readouterr().out.splitlines()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("iec61499.commands.devices.time.sleep", look)
        assert main(["force", str(system), "LEFT.M.IN=42", "--seconds", "5"]) == 0
    assert seen[-2:] == ["LEFT.M.IN", "42!"]
    assert capsys.readouterr().out == "LEFT.M.IN is free\n"
    assert said(capsys, "watch", system, "LEFT.M.IN", "--count", 1)[1] == "7"
    assert main(["force", str(system), "LEFT.M.IN=1", "LEFT.M.IN=no"]) == 2
    assert said(capsys, "watch", system, "LEFT.M.IN", "--count", 1)[-1] == "7"


def test_a_block_is_stopped_and_started(system: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert said(capsys, "stop", system, "LEFT.N") == ["LEFT.N stopped"]
    said(capsys, "trigger", system, "LEFT.N.CU")
    assert said(capsys, "watch", system, "LEFT.N.CV", "--count", 1)[1] == "0"
    assert said(capsys, "start", system, "LEFT.N") == ["LEFT.N started"]
    said(capsys, "trigger", system, "LEFT.N.CU")
    assert said(capsys, "watch", system, "LEFT.N.CV", "--count", 1)[1] == "1"
    assert said(capsys, "stop", system) == ["R stopped", "R stopped", "ALONE stopped"]
    assert said(capsys, "start", system) == ["R started", "R started", "ALONE started"]


@pytest.mark.parametrize(
    ("value", "members"),
    [
        ("5", [("P", "5")]),
        ("(X:=1,Y:='a,(b)')", [("P.X", "1"), ("P.Y", "'a,(b)'")]),
        ("(A:=(X:=1, Y:=2),B:=[1,2])", [("P.A.X", "1"), ("P.A.Y", "2"), ("P.B", "[1,2]")]),
        ("(not one)", [("P", "(not one)")]),
        ("()", [("P", "()")]),
    ],
)
def test_structures_are_opened(value: str, members: list[tuple[str, str]]) -> None:
    assert opened("P", value) == members


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["watch", "127.0.0.1:1"], "expected the name of at least one port"),
        (["watch", "127.0.0.1:1", "A.B", "--interval", "0"], "--interval: expected at least 0.001 s"),
        (["force", "127.0.0.1:1", "A.B"], "expected NAME=VALUE"),
        (["trigger", "127.0.0.1:1"], "expected the name of at least one event"),
        (["stop", "missing.sys"], "missing.sys: cannot be read"),
    ],
)
def test_bad_words_are_told(words: list[str], complaint: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(words) == 2
    assert complaint in capsys.readouterr().err
