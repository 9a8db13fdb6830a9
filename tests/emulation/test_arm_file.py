"""An MJCF file as the arm that is simulated: its values count, and what does not count is refused."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.emulation import MODEL_FILE
from dtwin.emulation.arm_file import read_arm
from dtwin.errors import ModelError
from dtwin.identification.mjcf import export_mjcf
from dtwin.parameters import PARAMETER_NAMES, ArmParameters
from dtwin.run.cell import Cell
from dtwin.run.options import PlantOptions


def written(path: Path, change: Callable[[str], str]) -> Path:
    text = MODEL_FILE.read_text()
    assert change(text) != text
    path.write_text(change(text))
    return path


def test_the_file_of_the_project_is_the_arm_of_the_data_sheet() -> None:
    assert read_arm(MODEL_FILE) == ArmParameters()


@given(factors=st.lists(st.floats(0.5, 2.0), min_size=21, max_size=21), rubs=st.booleans())
def test_what_is_exported_is_read_back(
    tmp_path_factory: pytest.TempPathFactory, factors: list[float], rubs: bool
) -> None:
    arm = ArmParameters()
    values = dict(zip(PARAMETER_NAMES, factors, strict=True))
    made = arm.with_values({name: arm.get(name) * factor for name, factor in values.items()})
    made = replace(made, coulomb=(0.01, 0.02, 0.03)) if rubs else made
    path = tmp_path_factory.mktemp("arm") / "arm.xml"
    export_mjcf(made, path)
    assert read_arm(path) == made


def test_a_run_of_the_file_is_one_of_its_values(tmp_path: Path) -> None:
    export_mjcf(ArmParameters().with_values({"m2": 0.13}), tmp_path / "heavy.xml")
    logs = []
    for options in (PlantOptions(mjcf=tmp_path / "heavy.xml"), PlantOptions(set=("m2=0.13",)), PlantOptions()):
        cell = Cell(replace(options.settings(), duration=3.0))
        cell.run()
        logs.append(cell.log.freeze().columns["theta_2"])
    assert (logs[0] == logs[1]).all()
    assert not (logs[0] == logs[2]).all()


GRIPPER = 'name="gripper" type="hinge" axis="0 0 -1" damping='


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        (GRIPPER + '"0.05"', GRIPPER + '"0.06"', "damping of the gripper is 0.06, expected 0.05"),
        ('<site name="red"', '<site name="reddish"', "no site is named 'red'"),
    ],
)
def test_what_would_not_count_is_refused(tmp_path: Path, old: str, new: str, complaint: str) -> None:
    path = written(tmp_path / "other.xml", lambda text: text.replace(old, new))
    with pytest.raises(ModelError, match=rf"other\.xml: {complaint}"):
        read_arm(path)


def test_a_place_that_was_moved_is_refused(tmp_path: Path) -> None:
    old = '<site name="pickup" class="visual"/>'
    path = written(tmp_path / "moved.xml", lambda text: text.replace(old, old[:-2] + ' pos="0.05 0 0"/>'))
    with pytest.raises(ModelError, match=r"moved\.xml: site 'pickup' is at .*: the boxes of the cell stay"):
        read_arm(path)
