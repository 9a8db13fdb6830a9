"""Rows of docs/architecture.md, walked with what the page says and nothing else; and the paths that it names."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import get_type_hints

import pytest

from dtwin.arm.model import ArmSettings
from dtwin.bus.chain.messages import JointModel, JointUploadRequest
from dtwin.bus.controller.messages import SettingsInForce, SettingsRequest
from dtwin.bus.twin_messages import UploadRequest
from dtwin.controller.settings import ControlSettings
from dtwin.parameters import ROOT
from dtwin.settings.change import Settings
from iec61499.library import Library
from iec61499.runtime.resource import Resource
from tests.support.iec61499.networks import network

PAGE = (ROOT / "docs" / "architecture.md").read_text()


def section(title: str) -> str:
    """The text under a title."""
    return PAGE.partition(f"### {title}\n")[2].partition("\n### ")[0]


def blocks(title: str, language: str) -> list[str]:
    """The listings in a language under a title."""
    return re.findall(rf"```{language}\n(.*?)```", section(title), re.DOTALL)


def test_every_path_of_the_page_exists() -> None:
    outside = {word for word in re.findall(r"`([\w./]+/[\w.]*)`", PAGE) if "NAME" not in word}
    made = set(re.findall(r"This is `([\w./]+)`", PAGE))
    assert made == {"fb/LIMITER.fbt", "services/counter.py"}
    missing = [word for word in outside - made if not any((ROOT / part / word).exists() for part in ("", "dtwin"))]
    assert not missing


@pytest.mark.parametrize(
    ("settings", "messages"),
    [
        (ControlSettings, (UploadRequest, SettingsRequest, SettingsInForce)),
        (ArmSettings, (JointUploadRequest, JointModel)),
    ],
)
def test_a_setting_has_its_field_in_all_requests_and_in_the_page_on_them(
    settings: type[Settings], messages: tuple[type, ...]
) -> None:
    told = (ROOT / "docs" / "zenoh.md").read_text()
    for message in messages:
        rows = told.partition(f"### {message.__name__}\n")[2].partition("\n### ")[0]
        for name in (name for names in settings.GROUPS for name in names):
            assert name in get_type_hints(message), (message, name)
            assert f"| `{name}` |" in rows, (message, name)


@pytest.fixture(scope="module")
def extended(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of block types with the one of the page in it."""
    folder = tmp_path_factory.mktemp("extended") / "fb"
    shutil.copytree(ROOT / "fb", folder)
    (listing,) = blocks("A block type", "xml")
    (folder / "LIMITER.fbt").write_text(listing)
    return folder


def test_a_block_type_is_added_by_its_file(extended: Path) -> None:
    check = [sys.executable, "-m", "dtwin", "fb", "check", str(extended)]
    assert subprocess.run(check, cwd=ROOT, capture_output=True, text=True).returncode == 0


@pytest.mark.parametrize(("value", "limited"), [(9.5, 8.0), (-9.5, -8.0), (1.25, 1.25)])
def test_the_added_block_type_limits(extended: Path, value: float, limited: float) -> None:
    use = network("START: E_RESTART; L: LIMITER", "START.COLD -> L.REQ", "", {"L.IN": str(value)})
    resource = Resource(use, Library([extended]))
    resource.start()
    assert resource.read("L.OUT") == limited


def test_a_service_is_added_by_its_file_and_its_line(tmp_path: Path) -> None:
    for folder in ("dtwin", "services", "fb", "models", "config", "machines"):
        shutil.copytree(ROOT / folder, tmp_path / folder, symlinks=True)
    module, line = blocks("A service", "python")
    (tmp_path / "services" / "counter.py").write_text(module)
    launch = tmp_path / "services" / "launch.py"
    text = launch.read_text()
    assert text.count("        return programs\n") == 1
    launch.write_text(text.replace("        return programs\n", f"{line}        return programs\n"))
    environment = {"PATH": "", "PYTHONPATH": str(tmp_path), "XDG_RUNTIME_DIR": str(tmp_path)}
    command = [sys.executable, "-m", "dtwin", "up", "--pace", "lockstep", "--duration", "30", "--json"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    counter = json.loads(done.stdout)["services"]["counter"]
    assert counter["restarts"] == 0
    assert counter["rate_hz"] > 0


COMMAND = '''"""Says a word."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Greet:
    """Say a word."""

    word: str = "well"

    def execute(self) -> int:
        print(self.word)
        return 0
'''
EXPERIMENT = '''"""Counts words."""

from dataclasses import dataclass
from typing import Any, ClassVar

from dtwin.campaign.spread import Progress
from evidence.experiment import ExperimentCommand
from evidence.report import Report, page


@dataclass(frozen=True)
class ExperimentGreet(ExperimentCommand[int]):
    """Count words."""

    name: ClassVar = "greet"

    def measure(self, progress: Progress) -> int:
        return 7

    def report(self, result: int) -> Report:
        return page("Words", f"There are {result} words.")

    def figures(self, result: int) -> dict[str, Any]:
        return {"words": result}
'''


@pytest.fixture(scope="module")
def copied(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of what is changed, with a command, an experiment and a name for notebooks, each where its row says."""
    root = tmp_path_factory.mktemp("copied")
    for folder in ("dtwin", "services", "evidence", "fb", "models", "iec61499"):
        shutil.copytree(ROOT / folder, root / folder, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
    added = {
        "dtwin/commands/greet.py": COMMAND,
        "evidence/greet.py": EXPERIMENT,
        "dtwin/api/greet.py": '"""Says a word."""\n\n\ndef greet() -> str:\n    """A word."""\n    return "well"\n',
    }
    lines = {
        "dtwin/commands/table.py": (
            '    "the cell": {\n',
            '        "greet": Subcommand("greet", "Greet", "say a word"),\n',
        ),
        "evidence/table.py": (
            "= {\n",
            '    "experiment greet": Subcommand("evidence.greet", "ExperimentGreet", "count words; report"),\n',
        ),
        "dtwin/__init__.py": ("_MODULES = {\n", '    "greet": "api.greet",\n'),
    }
    for name, text in added.items():
        (root / name).write_text(text)
    for name, (before, line) in lines.items():
        text = (root / name).read_text()
        assert text.count(before) == 1, name
        (root / name).write_text(text.replace(before, before + line))
    return root


def said_by(root: Path, *arguments: str) -> str:
    environment = {"PATH": "", "PYTHONPATH": str(root), "XDG_RUNTIME_DIR": str(root), "HOME": str(root)}
    command = [sys.executable, *arguments]
    done = subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_command_is_added_by_its_module_and_its_line(copied: Path) -> None:
    assert said_by(copied, "-m", "dtwin", "greet", "--word", "good") == "good\n"
    assert "say a word" in said_by(copied, "-m", "dtwin", "--help")


def test_an_experiment_is_added_by_its_module_and_its_line(copied: Path) -> None:
    assert json.loads(said_by(copied, "-m", "dtwin", "experiment", "greet", "--json"))["words"] == 7
    assert "There are 7 words." in (copied / "experiment-greet" / "report.html").read_text()


def test_a_name_for_notebooks_is_added_by_its_module_and_its_line(copied: Path) -> None:
    assert said_by(copied, "-c", "import dtwin; print(dtwin.greet(), 'greet' in dir(dtwin))") == "well True\n"
