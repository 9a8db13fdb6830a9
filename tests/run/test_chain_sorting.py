"""Any arm sorts boxes, on a machine that its controller does not know."""

import json
from pathlib import Path

import numpy as np
import pytest

from dtwin.arm.sorting import Sorting, read_sorting
from dtwin.cli import main
from dtwin.emulation.chain.arms import arm_of
from dtwin.emulation.chain.boxes import Boxes
from dtwin.errors import ParameterError, UnreachableError
from dtwin.run.chain import sorting_poses

TASK = """
pick = [0.3, 0.0, 0.2]
height = 0.1
mass = [0.2, 0.4]
every = 0.5
[places]
blue = [0.0, 0.0, 0.4]
red = [-0.3, 0.0, 0.1]
"""


def test_boxes_are_brought_to_their_places(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "task.toml").write_text(TASK)
    words = ["run", "--arm", "planar-2r", "--sort", str(tmp_path / "task.toml"), "--duration", "40"]
    assert main([*words, "--machine", "4", "--json"]) == 0
    boxes = json.loads(capsys.readouterr().out)["boxes"]
    assert boxes["delivered"] >= 6  # 4 where the arm waits above places as well
    assert boxes["within_5_mm"] == boxes["delivered"]
    assert boxes["missed"] == 0
    assert boxes["arrived"] == boxes["delivered"] + boxes["held"] + boxes["waiting"]


def test_a_box_is_caught_only_where_it_waits() -> None:
    task = Sorting(np.zeros(3), {"blue": np.ones(3)}, mass=(1.0, 1.0), every=2.0)
    boxes = Boxes(task)
    assert boxes.waiting(0.0) == 1
    boxes.grip(True, np.array([0.0, 0.0, 0.02]), 0.0)
    assert (boxes.held, boxes.counts.missed) == (0.0, 1)
    boxes.grip(False, np.zeros(3), 0.1)
    boxes.grip(True, np.array([0.0, 0.0, 0.005]), 0.2)
    assert (boxes.held, boxes.counts.picked, boxes.waiting(0.3)) == (1.0, 1, 0)
    boxes.grip(False, np.array([1.0, 1.0, 1.003]), 1.0)
    assert boxes.counts.errors == pytest.approx([0.003])
    assert (boxes.waiting(2.9), boxes.waiting(3.0)) == (0, 1)


def test_a_place_out_of_reach_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "task.toml").write_text(TASK.replace("-0.3, 0.0", "-0.9, 0.0"))
    with pytest.raises(UnreachableError, match=r"^red: arm planar-2r: the tool does not reach"):
        sorting_poses(arm_of("planar-2r"), read_sorting(tmp_path / "task.toml"))


def test_a_box_that_no_drive_holds_at_a_place_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "task.toml").write_text(TASK.replace("[0.2, 0.4]", "[0.2, 9.0]"))
    with pytest.raises(
        UnreachableError, match=r"^pick: the drive of \w+ gives [\d.]+ N m, and [\d.]+ N m hold a box of 9"
    ):
        sorting_poses(arm_of("planar-2r"), read_sorting(tmp_path / "task.toml"))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("pick", "take", "take: unknown key: expected .*pick"),
        ("[0.3, 0.0, 0.2]", "[0.3]", "pick: expected 3 finite numbers"),
        ("[0.2, 0.4]", "[0.4, 0.2]", "mass: expected two masses"),
        ("height = 0.1", "height = -1", "height, every: expected at least 0"),
        ("height = 0.1", "direction = [0, 0, 0]", "direction: expected a direction"),
        ("[places]", "[spots]", "spots: unknown key"),
        ("every = 0.5", "every = ", "expected a sorting task"),
    ],
)
def test_wrong_tasks_say_what_was_expected(old: str, new: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "task.toml").write_text(TASK.replace(old, new, 1))
    with pytest.raises(ParameterError, match=words) as caught:
        read_sorting(tmp_path / "task.toml")
    assert "task.toml" in str(caught.value)
