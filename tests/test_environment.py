"""The environment of the checkout: whatever ends its making, the next call has a whole one."""

import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from dtwin.parameters import ROOT


class Pip:
    """Stands for the installation.

    Attributes:
        runs: times that it was called.
        ends: what it is ended by, if anything.
    """

    def __init__(self, environment: Path) -> None:
        self.runs = 0
        self.ends: type[BaseException] | None = None
        self._environment = environment

    def __call__(self, target: str, lock: int) -> int:
        self.runs += 1
        (self._environment / f"half-{self.runs}").touch()
        if self.ends is not None:
            raise self.ends
        return 0


@pytest.fixture
def scripts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """scripts/environment.py for an empty checkout, with venvs that hold a python alone."""
    specification = importlib.util.spec_from_file_location("environment", ROOT / "scripts" / "environment.py")
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)

    def create(folder: Path, *, with_pip: bool) -> None:
        (folder / "bin").mkdir(parents=True)
        (folder / "bin" / "python").touch()

    monkeypatch.setattr(module, "ROOT", tmp_path)
    monkeypatch.setattr(module, "VENV", tmp_path / ".venv")
    monkeypatch.setattr(module.venv, "create", create)
    return module


@pytest.fixture
def pip(scripts: ModuleType, monkeypatch: pytest.MonkeyPatch) -> Pip:
    found = Pip(scripts.VENV)
    monkeypatch.setattr(scripts, "install", found)
    return found


def test_an_environment_whose_making_was_interrupted_is_made_anew(scripts: ModuleType, pip: Pip) -> None:
    stamp = f"{scripts.ROOT} 1"
    pip.ends = KeyboardInterrupt
    assert scripts.main("", stamp) == 130
    pip.ends = None
    assert scripts.main("", stamp) == 0
    assert not (scripts.VENV / "half-1").exists()
    assert scripts.main("", stamp) == 0
    assert pip.runs == 2


def test_an_update_that_was_interrupted_counts_as_nothing(scripts: ModuleType, pip: Pip) -> None:
    assert scripts.main("", f"{scripts.ROOT} 1") == 0
    pip.ends = KeyboardInterrupt
    assert scripts.main("test", f"{scripts.ROOT} 1") == 130
    assert not list(scripts.VENV.glob("stamp-*"))


def test_another_extra_is_added_to_what_is_there(scripts: ModuleType, pip: Pip) -> None:
    stamp = f"{scripts.ROOT} 1"
    assert scripts.main("", stamp) == 0
    assert scripts.main("test", stamp) == 0
    assert scripts.main("", stamp) == 0
    assert pip.runs == 2
    assert (scripts.VENV / "half-1").exists()


def test_an_environment_of_another_path_is_made_anew(scripts: ModuleType, pip: Pip) -> None:
    assert scripts.main("", "elsewhere 1") == 0
    assert scripts.main("", f"{scripts.ROOT} 1") == 0
    assert not (scripts.VENV / "half-1").exists()


def test_a_full_disk_is_told_in_one_line(scripts: ModuleType, pip: Pip, capsys: pytest.CaptureFixture[str]) -> None:
    pip.ends = OSError
    assert scripts.main("", f"{scripts.ROOT} 1") == 1
    assert "cannot be made" in capsys.readouterr().err.splitlines()[-1]


def test_what_pip_says_is_shown_when_it_fails(
    scripts: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    python = scripts.VENV / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text("#!/bin/sh\necho Collecting one\necho ERROR: no such package\nexit 3\n")
    python.chmod(0o755)
    with (tmp_path / "lock").open("w") as lock:
        assert scripts.install("target", lock.fileno()) == 3
    assert "ERROR: no such package" in capsys.readouterr().err


def test_a_folder_of_the_name_beside_a_script_does_not_hide_the_package(tmp_path: Path) -> None:
    (tmp_path / "dtwin").mkdir()
    script = tmp_path / "script.py"
    script.write_text("import dtwin\nprint(dtwin.__version__)\n")
    ran = subprocess.run([sys.executable, str(script)], cwd=tmp_path, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr


@pytest.mark.parametrize(
    ("words", "extras"),
    [
        ("run --machine servo", ["console,sbom"]),
        ("mcp", ["console,sbom", "mcp"]),
        ("mcp approve 1", ["console,sbom", "mcp"]),
        ("film run.parquet run.mp4 --end 3", ["console,sbom", "film"]),
        ("film run.parquet run.gif", ["console,sbom"]),
    ],
)
def test_what_few_commands_need_is_installed_when_they_are_called(
    words: str, extras: list[str], tmp_path: Path
) -> None:
    """environment.sh stands for itself: it says what it is asked for, and its python says the words."""
    shutil.copy(ROOT / "scripts" / "dtwin", tmp_path)
    (tmp_path / "environment.sh").write_text('prepare() { echo "$1"; }\npython=echo\n')
    done = subprocess.run(["sh", tmp_path / "dtwin", *words.split()], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [*extras, f"-m dtwin {words}"]


@pytest.mark.parametrize(("given", "found"), [("C", "C.UTF-8"), ("C.UTF-8", "C.UTF-8")])
def test_without_a_locale_paths_are_read_as_utf_8(given: str, found: str, tmp_path: Path) -> None:
    """Python would else not start in a checkout whose path is not ASCII."""
    shutil.copy(ROOT / "scripts" / "environment.sh", tmp_path)
    script = tmp_path / "show"
    script.write_text('. "$(dirname "$0")/environment.sh"\necho "$LC_ALL"\n')
    command = ["sh", str(script)]
    shown = subprocess.run(command, env={"LC_ALL": given, "PATH": "/usr/bin:/bin"}, capture_output=True, check=True)
    assert shown.stdout.decode().strip() == found
