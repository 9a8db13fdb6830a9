"""What a box weighs on a machine that was identified without one, in synthetic work of the same twin."""

from collections.abc import Callable
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from dtwin.identification.machine.load import Load, load_on, weighed
from dtwin.identification.machine.record import USUAL_BOX, MachineRecord
from dtwin.logs.log import Log
from dtwin.twin.effects import NO_EFFECTS
from tests.support.records import recorded

TORQUES = ("K", "m", "I", "D", "mu")


def scaled(record: MachineRecord, factor: float) -> MachineRecord:
    """The record of a machine whose torques all have a factor, which an empty arm does not show."""
    numbers = {
        name: msgspec.structs.replace(number, value=number.value * (factor if name.rstrip("123") in TORQUES else 1.0))
        for name, number in record.numbers.items()
    }
    return msgspec.structs.replace(record, numbers=numbers)


@pytest.fixture(scope="module")
def work(run_cell: Callable[..., Log]) -> Log:
    return run_cell(duration=60.0, seed=3, noise=0.0005)


@pytest.mark.parametrize("factor", [0.9, 1.0, 1.08])
def test_boxes_tell_the_scale_of_torques(work: Log, factor: float) -> None:
    masses = work.columns["payload_mass"]
    mass = masses[masses > 0.0].mean()
    scale = load_on(scaled(recorded(NO_EFFECTS), factor), work).scale
    assert scale == pytest.approx(factor * mass / USUAL_BOX, rel=0.01)


def test_boxes_of_another_kind_tell_nothing(work: Log) -> None:
    assert load_on(scaled(recorded(NO_EFFECTS), 2.0), work).scale is None


def test_work_without_boxes_tells_nothing(work: Log) -> None:
    none = {"box_gripped": np.zeros(len(work), bool)}
    assert load_on(recorded(NO_EFFECTS), replace(work, columns={**work.columns, **none})).scale is None


@pytest.mark.parametrize(("scale", "grade"), [(0.72, "approximate"), (0.95, "identified"), (1.28, "approximate")])
def test_a_scale_beyond_the_data_sheet_is_told_and_costs_the_grade(scale: float, grade: str) -> None:
    record = msgspec.structs.replace(recorded(NO_EFFECTS), grade="identified")
    found = weighed(record, Load(scale))
    assert (found.grade, found.load) == (grade, scale)
    told = [remark for remark in found.remarks if f"like one of {200 * scale:.0f} g" in remark]
    assert len(told) == (grade != "identified")


def test_a_scale_makes_no_grade_better() -> None:
    record = msgspec.structs.replace(recorded(NO_EFFECTS), grade="unusable")
    assert weighed(record, Load(1.3)).grade == "unusable"
    assert weighed(record, Load(None)).grade == "unusable"
