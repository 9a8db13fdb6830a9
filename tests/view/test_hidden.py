"""The hidden truth in a recording: what was logged can be read back from the file."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader

from dtwin.cli import main
from dtwin.emulation.contact.touch import Grip, Touch
from dtwin.emulation.hidden import Drives, Hidden
from dtwin.logs.collecting import RunLog
from dtwin.logs.log import Log
from dtwin.parameters import ArmParameters
from dtwin.run.hidden import HiddenLog
from dtwin.signals import Sensors, StepRecord, Truth, Voltages
from dtwin.view.write import write_recording
from tests.view.test_write import MODEL, Contents, at, contents, ranges_of

TICKS = 5
POSE = (0.1, 0.2, 0.3, 0.5, 0.5, -0.5, 0.5)


def log() -> Log:
    run = RunLog()
    for tick in range(TICKS):
        t, theta = 0.01 * tick, (0.1 * tick, 0.0, 0.0)
        truth = Truth(t, theta, (0.5, 0.0, -1.0), 0.5, 0.0)
        sensors = Sensors(tick, t, (theta[0], 0.002, 0.0), 0.5, False, "")
        run.append(StepRecord(truth, sensors, theta, Voltages(tick, t, (1.0 + tick, 0.0, 0.0, 0.0), False)))
    return run.freeze()


def truth_of(tick: int) -> Hidden:
    """Two contacts in even ticks, one of them a blow; the box slips by 1 mm a tick."""
    forces = np.array([(0.0, 0.0, 0.1, 0.0, 0.0, 2.0), (0.0, 0.0, 0.2, 0.0, 90.0, 0.0), (0.0,) * 6])
    return Hidden(
        Drives((0.5 * tick, 0.0, 0.0), (0.03, 0.0, 0.0), (0.1 * tick + 0.004, 0.0, 0.0)),
        Touch(forces, Grip(3.7, 3.8, 2.0, 4.5), ("blue",), np.array([POSE]), 0, (0.001 * tick, 0.0, 0.0)),
    )


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    hidden = HiddenLog()
    for tick in range(TICKS):
        hidden.append(truth_of(tick))
    path = tmp_path_factory.mktemp("recording") / "run.rrd"
    write_recording(log(), MODEL, path, ArmParameters(), hidden)
    return path


@pytest.fixture(scope="module")
def recording(path: Path) -> Contents:
    return contents(path)


def series(recording: Contents, entity: str) -> Any:
    return np.array([value for _, _, value in recording[entity]["Scalars:scalars"]]).squeeze()


def test_what_acts_stands_beside_the_command_that_it_answers(recording: Contents) -> None:
    assert series(recording, "/drive/voltage/joint_1/commanded").tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert series(recording, "/drive/voltage/joint_1/acting").tolist() == [0.0, 0.5, 1.0, 1.5, 2.0]


def test_friction_stands_beside_that_of_the_data_sheet(recording: Contents) -> None:
    assert series(recording, "/drive/friction/joint_1/acting") == pytest.approx([0.03] * TICKS)
    for joint, omega in ((1, 0.5), (2, 0.0), (3, -1.0)):
        assert series(recording, f"/drive/friction/joint_{joint}/believed") == pytest.approx([0.05 * omega] * TICKS)


def test_motors_and_encoders_are_shown_ahead_of_the_joints(recording: Contents) -> None:
    assert series(recording, "/drive/gear") == pytest.approx(np.tile([4.0, 0.0, 0.0], (TICKS, 1)))
    assert series(recording, "/drive/encoder") == pytest.approx(np.tile([0.0, 2.0, 0.0], (TICKS, 1)))


def test_grip_and_slip_are_plotted(recording: Contents) -> None:
    assert series(recording, "/contact/grip").tolist() == [[3.7, 3.8, 2.0, 4.5]] * TICKS
    assert series(recording, "/contact/slip") == pytest.approx([0.0, 1.0, 2.0, 3.0, 4.0])


def test_forces_are_arrows_at_their_points_and_a_blow_is_cut(recording: Contents) -> None:
    forces = recording["/cell/forces"]
    assert len(forces["Arrows3D:vectors"]) == 3
    np.testing.assert_allclose(at(forces["Arrows3D:origins"], 2), [(0, 0, 0.1), (0, 0, 0.2)], atol=1e-6)
    np.testing.assert_allclose(at(forces["Arrows3D:vectors"], 2), [(0, 0, 0.04), (0, 0.1, 0)], atol=1e-6)


def test_boxes_are_drawn_where_they_are_instead_of_from_the_log(recording: Contents) -> None:
    boxes = recording["/cell/boxes/bodies"]
    np.testing.assert_allclose(at(boxes["Boxes3D:centers"], 4), [POSE[:3]], atol=1e-6)
    np.testing.assert_allclose(at(boxes["Boxes3D:quaternions"], 4), [(*POSE[4:], POSE[3])], atol=1e-6)
    assert at(boxes["Boxes3D:colors"], 4) == [0x3470ECFF]
    assert not {"/cell/boxes/held", "/cell/boxes/waiting", "/cell/boxes/placed", "/cell/counts"} & set(recording)


def test_every_further_view_has_something_to_show(path: Path, recording: Contents) -> None:
    reader = RrdReader(path)
    [layout] = reader.blueprints()
    origins: set[str] = set()
    for chunk in reader.stream(store=layout).to_chunks():
        batch = chunk.to_record_batch()
        if "ViewBlueprint:space_origin" in batch.schema.names:
            origins |= {value for values in batch["ViewBlueprint:space_origin"].to_pylist() for value in values}
    found = {origin.strip("/") for origin in origins if origin.strip("/").partition("/")[0] in ("drive", "contact")}
    joints = {f"drive/{kind}/joint_{joint}" for kind in ("voltage", "friction") for joint in (1, 2, 3)}
    assert found == {"contact/grip", "contact/slip", "drive/gear", "drive/encoder"} | joints
    for origin in found:
        assert any(entity == f"/{origin}" or entity.startswith(f"/{origin}/") for entity in recording), origin


def test_every_plot_has_a_range_that_holds_its_lines(path: Path) -> None:
    ranges = ranges_of(path)
    assert ranges["contact/slip"] == pytest.approx((0.0, 5.25))
    assert ranges["contact/grip"] == (0.0, 10.5)
    assert ranges["drive/gear"] == pytest.approx((-21.0, 21.0))
    assert ranges["drive/encoder"] == pytest.approx((-5.25, 5.25))
    for joint in (1, 2, 3):
        assert ranges[f"drive/voltage/joint_{joint}"] == pytest.approx((-10.5, 10.5))
        assert ranges[f"drive/friction/joint_{joint}"] == pytest.approx((-0.525, 0.525))


def test_a_run_records_what_its_machine_hides_and_how_long_its_links_are(tmp_path: Path) -> None:
    file = tmp_path / "run.rrd"
    assert main(["run", "--machine", "servo", "--duration", "0.1", "--record", str(file), "--json"]) == 0
    found = contents(file)
    assert len(found["/drive/gear"]["Scalars:scalars"]) == 10
    assert "/contact/grip" not in found
    [(x, _, z)] = at(found["/cell/bodies/link_2"]["Transform3D:translation"], 9)
    assert np.hypot(x, z) == pytest.approx(1.001 * 0.15786938, rel=1e-6)
    assert main(["run", "--duration", "0.1", "--record", str(file), "--json"]) == 0
    assert not [entity for entity in contents(file) if entity.startswith(("/drive", "/contact", "/cell/forces"))]
