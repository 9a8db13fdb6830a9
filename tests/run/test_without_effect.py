"""What was asked of a run and came to nothing is told at its end."""

import math
from dataclasses import replace
from typing import Any

import pytest

from dtwin.controller.settings import Compensation, ControlSettings
from dtwin.emulation.faults import parse_fault
from dtwin.emulation.machine.sections import IDEAL
from dtwin.parameters import ArmParameters
from dtwin.run.cell import Cell
from dtwin.run.out_of_place import out_of_place
from dtwin.run.settings import CellSettings
from dtwin.task import DEFAULT_TASK
from dtwin.twin.kinematics import forward

EARLIER = ControlSettings(compensation=Compensation(delay=0.005))


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({}, []),
        ({"faults": ("D2*=1.5@0.5",)}, []),
        ({"faults": ("K2*=0.5@90",)}, ["fault K2*=0.5@90: the run ends before it, at 1 s"]),
        ({"faults": ("slip@0.5",)}, ["fault slip@0.5: no box was held then"]),
        ({"faults": ("payload*=2@0",)}, ["fault payload*=2@0: no box was held then"]),
        (
            {"control": EARLIER},
            ["delay 0.005: only the cascade takes it into account, the law was computed_torque"],
        ),
        ({"noise_kind": "gaussian"}, ["noise kind gaussian: the noise was 0"]),
    ],
)
def test_what_came_to_nothing_is_told(settings: dict[str, Any], expected: list[str]) -> None:
    faults = tuple(parse_fault(text) for text in settings.get("faults", ()))
    cell = Cell(CellSettings(duration=1.0, **{**settings, "faults": faults}))
    cell.run()
    summary = cell.summary(cell.log.freeze())
    assert summary.without_effect == expected
    assert summary.placement_error_mm is None


def test_places_that_the_arm_does_not_come_to_are_told_with_the_distance() -> None:
    longer = replace(ArmParameters(), length=(0.2, 0.35, 0.1))
    missed = out_of_place(DEFAULT_TASK, longer)
    assert [text.partition(":")[0] for text in missed] == list(DEFAULT_TASK.all_places)
    x, y, _ = forward(DEFAULT_TASK.pickup.theta, longer)
    distance = 1000 * math.dist((x, y), (DEFAULT_TASK.pickup.x, DEFAULT_TASK.pickup.y))
    assert f"misses the place by {distance:.0f} mm, expected at most 20 mm" in missed[0]
    assert not out_of_place(DEFAULT_TASK, ArmParameters())
    cell = Cell(CellSettings(duration=1.0, arm=longer))
    cell.run()
    assert cell.summary(cell.log.freeze()).without_effect == missed


def test_places_at_which_the_drives_do_not_hold_the_heaviest_box_are_told() -> None:
    weak = replace(ArmParameters(), voltage_constant=(0.24, 0.06, 0.16))
    missed = out_of_place(DEFAULT_TASK, weak)
    assert [text.partition(":")[0] for text in missed] == ["blue", "red", "green"]
    assert missed[1] == "red: joint 2 of this arm would need 16.8 V to hold 0.21 kg there, expected at most 8 V"


def test_the_arm_is_judged_as_it_was_made() -> None:
    machine = replace(IDEAL, structure=replace(IDEAL.structure, length=(1.1, 1.1, 1.1)))
    cell = Cell(CellSettings(duration=1.0, machine=machine))
    cell.run()
    assert "misses the place by 28 mm" in cell.summary(cell.log.freeze()).without_effect[0]
