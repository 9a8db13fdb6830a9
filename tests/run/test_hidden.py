"""The hidden truth of a run, tick by tick."""

import msgspec
import numpy as np
import pytest

from dtwin.emulation.contact.touch import Grip, Touch
from dtwin.emulation.hidden import Drives, Hidden
from dtwin.emulation.machine.files import machine_of
from dtwin.errors import ModelError
from dtwin.parameters import ArmParameters
from dtwin.run.cell import Cell
from dtwin.run.hidden import HiddenLog
from dtwin.run.settings import CellSettings, arm_of, metadata


def touch(held: int | None, offset: tuple[float, float, float], contacts: int) -> Hidden:
    poses = np.zeros((1, 7))
    return Hidden(None, Touch(np.ones((contacts, 6)), Grip(1.0, 2.0, 3.0, 4.0), ("red",), poses, held, offset))


def test_slip_counts_along_the_pads_from_the_begin_of_each_grip() -> None:
    log = HiddenLog()
    for held, offset in (
        (None, (0.0, 0.0, 0.0)),
        (2, (0.001, 0.5, 0.002)),
        (2, (0.004, 0.9, 0.006)),
        (3, (0.1, 0.0, 0.1)),
        (3, (0.1, 0.1, 0.1)),
        (None, (0.0, 0.0, 0.0)),
        (3, (0.2, 0.0, 0.0)),
    ):
        log.append(touch(held, offset, 0))
    touches = log.touches()
    assert touches is not None
    assert touches.slip == pytest.approx([0.0, 0.0, 0.005, 0.0, 0.0, 0.0, 0.0], abs=1e-12)


def test_contacts_and_boxes_follow_one_another_with_their_counts() -> None:
    log = HiddenLog()
    for contacts in (0, 3, 1):
        log.append(touch(None, (0.0, 0.0, 0.0), contacts))
    touches = log.touches()
    assert touches is not None
    assert touches.contacts.tolist() == [0, 3, 1]
    assert touches.forces.shape == (4, 6)
    assert touches.boxes.tolist() == [1, 1, 1]
    assert touches.colours == ("red",) * 3
    assert touches.grip.tolist() == [[1.0, 2.0, 3.0, 4.0]] * 3
    assert log.drives() is None


def test_drives_are_columns() -> None:
    log = HiddenLog()
    for volt in (1.0, 2.0):
        log.append(Hidden(Drives((volt, 0.0, 0.0), (0.0, volt, 0.0), (0.0, 0.0, volt)), None))
    drives = log.drives()
    assert drives is not None
    assert drives.volts.tolist() == [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]
    assert drives.friction[:, 1].tolist() == drives.motors[:, 2].tolist() == [1.0, 2.0]
    assert log.touches() is None


def test_a_cell_collects_a_row_a_tick() -> None:
    hidden = HiddenLog()
    cell = Cell(CellSettings(machine=machine_of("servo"), duration=0.1), hidden=hidden)
    cell.run()
    drives = hidden.drives()
    assert drives is not None
    assert drives.volts.shape == drives.friction.shape == drives.motors.shape == (len(cell.log), 3)
    assert hidden.touches() is None


def test_the_metadata_of_a_log_tells_how_long_the_links_of_its_machine_are() -> None:
    settings = CellSettings(machine=machine_of("servo"), arm=ArmParameters(length=(0.2, 0.1, 0.1)))
    notes = msgspec.json.decode(msgspec.json.encode(metadata(settings)))
    assert arm_of(notes).length == pytest.approx((0.2002, 0.0999, 0.1001), abs=1e-12)
    assert arm_of({}) == ArmParameters()
    with pytest.raises(ModelError, match="metadata of the log: arm"):
        arm_of({"arm": {"length": "long"}})
    with pytest.raises(ModelError, match="expected a machine with the sections"):
        arm_of({"machine": 17})
