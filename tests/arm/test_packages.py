"""Models that installed packages bring."""

import sys
from pathlib import Path

import pytest

from dtwin.arm.packages import installed
from dtwin.cli import main
from dtwin.errors import ModelError

URDF = """<robot name="found"><link name="a"/><link name="b"><inertial><mass value="1"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<joint name="one" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package `some-robots` with two files of one name and one of another."""
    names = ("robots/one/arm.urdf", "robots/two/arm.urdf", "robots/two/other.urdf")
    for name in names:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(URDF)
    info = tmp_path / "some_robots-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: some-robots\nVersion: 1.0\n")
    (info / "RECORD").write_text("".join(f"{name},,\n" for name in names))
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    return tmp_path


def test_a_file_is_found_by_the_end_of_its_path(package: Path) -> None:
    assert installed(Path("package://some-robots/other.urdf")) == package / "robots/two/other.urdf"
    assert installed(Path("package://some-robots/one/arm.urdf")) == package / "robots/one/arm.urdf"
    assert installed(Path("arm.urdf")) == Path("arm.urdf")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "package://no-such-robots/arm.urdf",
            "package no-such-robots: is not installed: `pip install no-such-robots`",
        ),
        ("package://some-robots/arm.urdf", "expected one of its files, robots/one/arm.urdf or robots/two/arm.urdf"),
        ("package://some-robots/hand.urdf", "robots/two/other.urdf, got hand.urdf"),
        ("package://some-robots", "expected package://NAME/FILE"),
    ],
)
def test_what_is_not_there_is_told_with_what_is(text: str, said: str, package: Path) -> None:
    with pytest.raises(ModelError, match=said):
        installed(Path(text))


def test_its_arm_is_written_here(package: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    assert main(["arm", "import", "package://some-robots/other.urdf"]) == 0
    assert main(["arm", "show", "other.toml"]) == 0
    assert not (package / "robots/two/other.toml").exists()
