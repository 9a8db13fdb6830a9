"""dtwin doctor and dtwin completion."""

import json
import shutil
import socket
import subprocess
from pathlib import Path

import pytest

from dtwin.bus.opening import RENDEZVOUS
from dtwin.cli import main
from dtwin.commands.setup import doctor
from dtwin.commands.table import COMMANDS

SHELLS = ("bash", "zsh", "fish")


def printed(capsys: pytest.CaptureFixture[str], *words: str, status: int = 0) -> str:
    assert main(words) == status
    return capsys.readouterr().out


def parts(capsys: pytest.CaptureFixture[str], status: int = 0) -> dict[str, dict[str, str]]:
    return {part["name"]: part for part in json.loads(printed(capsys, "doctor", "--json", status=status))}


def test_the_doctor_finds_what_the_tests_run_with(capsys: pytest.CaptureFixture[str]) -> None:
    found = parts(capsys)
    for name in ("numpy", "mujoco", "eclipse-zenoh", "extra console", "extra test", "Rerun viewer"):
        assert found[name]["state"] == "present"


def test_a_library_that_dtwin_needs_is_missed(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor.importlib.metadata, "requires", lambda name: ["absent-library", "numpy"])
    found = parts(capsys, status=1)
    assert found["absent-library"] == {
        "name": "absent-library",
        "state": "needed",
        "found": "",
        "advice": "pip install absent-library",
    }
    assert found["numpy"]["state"] == "present"


def test_a_program_that_is_named_and_not_there_is_said(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("FORTE", str(tmp_path / "forte"))
    assert parts(capsys)["4diac FORTE"]["state"] == "missing"
    (tmp_path / "forte").write_text("#!/bin/sh\n")
    (tmp_path / "forte").chmod(0o755)
    assert parts(capsys)["4diac FORTE"]["found"] == str(tmp_path / "forte")


def test_a_program_on_the_path_does_not_hide_a_wrong_name(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "forte").write_text("#!/bin/sh\n")
    (tmp_path / "forte").chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("FORTE", raising=False)
    assert parts(capsys)["4diac FORTE"]["found"] == str(tmp_path / "forte")
    monkeypatch.setenv("FORTE", "elsewhere")
    assert parts(capsys)["4diac FORTE"]["advice"] == "FORTE is elsewhere, which is no program"


def test_what_the_viewer_reads_from_the_environment_names_no_program(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RERUN", "off")
    assert parts(capsys)["Rerun viewer"]["state"] == "present"


def test_a_port_that_somebody_has_is_taken() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        assert doctor.examine_port("somebody", port).state == "taken"
    assert doctor.examine_port("nobody", port).state == "free"


def test_a_folder_of_somebody_else_is_needed_otherwise(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "dtwin").write_text("")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert "XDG_RUNTIME_DIR" in parts(capsys, status=1)["folder of cells"]["advice"]


def test_the_ports_are_those_of_a_cell(capsys: pytest.CaptureFixture[str]) -> None:
    assert f"port {RENDEZVOUS.rpartition(':')[2]}" in parts(capsys)


def completed(script: str, *words: str) -> list[str]:
    """What bash offers for the last word."""
    asked = f"{script}\nCOMP_WORDS=({' '.join(repr(word) for word in words)})\nCOMP_CWORD={len(words) - 1}\n"
    asked += f"_shtab_dtwin {' '.join(repr(word) for word in (words[0], words[-1], words[-2]))}\n"
    asked += 'printf "%s\\n" "${COMPREPLY[@]}"'
    done = subprocess.run(["bash", "-c", asked], capture_output=True, text=True, check=True)
    return done.stdout.split()


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_bash_completes_commands_options_and_choices(capsys: pytest.CaptureFixture[str]) -> None:
    script = printed(capsys, "completion", "bash")
    assert set(completed(script, "dtwin", "")) == {name.split()[0] for name in COMMANDS}
    assert set(completed(script, "dtwin", "--")) == {"--help", "--version"}
    assert completed(script, "dtwin", "mach") == ["machine"]
    assert {"check", "run", "trace"} <= set(completed(script, "dtwin", "fb", ""))
    assert completed(script, "dtwin", "up", "--pac") == ["--pace"]
    assert completed(script, "dtwin", "up", "--pace", "") == ["realtime", "lockstep", "free"]
    assert completed(script, "dtwin", "upload", "gains", "--who", "") != ["gains"]
    assert "start" in completed(script, "dtwin", "monitor", "s")


@pytest.mark.parametrize("shell", SHELLS)
def test_every_command_is_in_every_script_and_the_shell_reads_it(
    capsys: pytest.CaptureFixture[str], shell: str
) -> None:
    script = printed(capsys, "completion", shell)
    for word in {word for name in COMMANDS for word in name.split()}:
        assert word in script
    if program := shutil.which(shell):
        subprocess.run([program, "-n"], input=script, text=True, check=True, capture_output=True)
