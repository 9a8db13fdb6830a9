"""The ways of the cell keep clear of everything, as the blocks plan them."""

from pathlib import Path

import msgspec
import pytest

from dtwin.emulation import MODEL_FILE
from dtwin.emulation.contact.clearance import Clearance
from dtwin.errors import ModelError
from dtwin.parameters import HANGING, PICKUP, PLACES
from evidence.clearance import (
    Clearances,
    LegClearance,
    StartUps,
    clearance_report,
    is_free,
    keeps_clear,
    random_poses,
    start_ups,
    sweep,
)


def test_every_way_is_free() -> None:
    legs = sweep(Clearance())
    assert {leg.place for leg in legs} == {"", *PLACES}
    for leg in legs:
        assert is_free(leg), leg
        if not leg.carries and "pickup" not in (leg.start, leg.end):
            assert leg.distance > 0.005, leg
    for colour in PLACES:
        way = [leg.end for leg in legs if leg.place == colour and leg.carries]
        assert way == ["above pickup", "between", "behind", f"near {colour}", f"above {colour}", colour]


def test_what_is_in_the_way_is_found(tmp_path: Path) -> None:
    file = tmp_path / "arm.xml"
    wall = '<geom name="wall" class="cell" type="box" pos="0.26 0 0.05" size="0.01 0.1 0.05"/>'
    file.write_text(MODEL_FILE.read_text().replace('<body name="rack"', f'{wall}<body name="rack"'))
    touched = [leg for leg in sweep(Clearance(file)) if not is_free(leg)]
    assert touched
    assert {leg.other for leg in touched} == {"wall"}


def test_a_way_is_found_from_anywhere_or_help_is_called_for() -> None:
    shapes = Clearance()
    poses = random_poses(shapes, 10, seed=1)
    assert poses == random_poses(shapes, 10, seed=1)
    found = start_ups(shapes, [*poses, HANGING, PLACES["blue"].theta, PICKUP.theta])
    assert (found.poses, found.free, found.helpless, found.touching) == (13, 13, 0, 0)
    assert found.distance > 0.002
    under_the_belt = (-1.33, 0.541, 0.34)
    assert shapes.nearest(under_the_belt, 0.9, False, ()).distance > 0
    stuck = start_ups(shapes, [under_the_belt])
    assert (stuck.free, stuck.helpless, stuck.touching) == (0, 1, 0)


def test_distances_are_those_of_the_shapes() -> None:
    shapes = Clearance()
    nearest = shapes.nearest(PICKUP.theta, 0.5, True, ())
    assert (nearest.arm, nearest.other) == ("box_held", "conveyor_belt")
    assert nearest.distance == pytest.approx(0.0, abs=1e-4)
    lifted = shapes.nearest(PLACES["red"].theta, 0.5, True, ())
    assert (lifted.arm, lifted.other) == ("box_held", "red_tray")
    assert lifted.distance == pytest.approx(0.0025, abs=1e-4)


def test_a_file_that_is_no_model_is_named(tmp_path: Path) -> None:
    file = tmp_path / "arm.xml"
    file.write_text("<mujoco/>")
    with pytest.raises(ModelError, match=r"arm\.xml"):
        Clearance(file)


def test_the_page_tells_every_leg_and_what_is_touched_is_told() -> None:
    lifted = LegClearance("red", "pickup", "above pickup", True, 0.0, "box_held", "conveyor_belt")
    away = LegClearance("red", "above red", "near red", False, 0.012, "jaw", "red_tray")
    ups = StartUps(3, 2, 1, 0, 0.004, "jaw", "belt")
    found = Clearances([lifted, away], ups, ups)
    assert keeps_clear(found)
    assert "| red | above red | near red |  | 12.0 | jaw and red_tray |" in clearance_report(found).text
    assert clearance_report(found).page("").count("<svg") == 1
    assert not keeps_clear(Clearances([lifted, msgspec.structs.replace(away, distance=-0.001)], ups, ups))
    assert not keeps_clear(Clearances([lifted, away], ups, msgspec.structs.replace(ups, touching=1)))
