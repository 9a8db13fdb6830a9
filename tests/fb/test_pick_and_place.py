"""PICK_AND_PLACE: the sequence of the cell under scripted sensors."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.parameters import PICKUP, PLACES
from tests.support.driven import Driven, triple

OPEN, CLOSED = 0.9, 0.39265


class FedBlock:
    """Feeds the block; sensors keep their values until they are changed."""

    def __init__(self) -> None:
        self.block = Driven("PICK_AND_PLACE")
        self.sensors: dict[str, Any] = {
            **triple("THETA", PICKUP.theta),
            **triple("THETA_T", PICKUP.theta),
            "GRIPPER": OPEN,
            "BOX_PRESENT": False,
            "COLOUR": "",
            "MOVING": False,
            "HOLD": False,
        }

    def tick(self, **sensors: Any) -> str:
        """Gives the block one sample and returns the chart's state after it."""
        self.sensors |= sensors
        self.events = self.block.fire("REQ", **self.sensors)
        return str(self.block["$ECC"])

    def ticks_until(self, state: str, limit: int, **sensors: Any) -> int:
        for count in range(1, limit + 1):
            if self.tick(**sensors) == state:
                return count
        raise AssertionError(f"{state} not reached in {limit} samples, but {self.block['$ECC']}")

    def advance_to(self, state: str, colour: str = "red") -> None:
        """Goes through the sequence up to a state, with a box of the colour waiting."""
        for name, change in (
            ("RETURN", {}),
            ("CLOSE", {"BOX_PRESENT": True, "COLOUR": colour}),
            ("GRIP", {"GRIPPER": CLOSED}),
            ("CARRY", {"BOX_PRESENT": False, "COLOUR": ""}),
            ("OPEN", {}),
            ("RETURN", {"GRIPPER": OPEN}),
        ):
            self.ticks_until(name, 40, **change)
            if name == state:
                return


def test_first_sample_sends_the_arm_to_the_pickup_point_with_an_open_gripper() -> None:
    cell = FedBlock()
    assert cell.tick() == "RETURN"
    assert cell.events == ["TARGET", "CNF"]
    assert (cell.block["DESTINATION"], cell.block["V_GRIPPER"], cell.block["GRIPPED"]) == ("pickup", 3.0, False)


def test_every_sample_is_confirmed_once_and_counted() -> None:
    cell = FedBlock()
    for tick in range(300):
        cell.tick(BOX_PRESENT=tick > 100, COLOUR="blue", GRIPPER=CLOSED if tick > 150 else OPEN)
        assert cell.events.count("CNF") == 1
        assert cell.block["SYSTEM_TIME"] == pytest.approx(0.01 * tick, abs=1e-12)


@pytest.mark.parametrize("colour", sorted(PLACES))
def test_a_box_goes_to_the_place_of_its_colour(colour: str) -> None:
    cell = FedBlock()
    cell.advance_to("CLOSE", colour)
    assert cell.block["V_GRIPPER"] == -3.0
    assert not cell.block["GRIPPED"]
    assert cell.tick(GRIPPER=CLOSED) == "GRIP"
    assert cell.events == ["TARGET", "CNF"]
    assert (cell.block["DESTINATION"], cell.block["GRIPPED"]) == (colour, True)
    # the next box, already waiting, does not change where this one goes
    assert cell.tick(COLOUR="green", MOVING=True) == "CARRY"
    assert cell.block["DESTINATION"] == colour
    cell.ticks_until("OPEN", 40, MOVING=False)
    assert (cell.block["V_GRIPPER"], cell.block["GRIPPED"]) == (3.0, True)
    assert cell.tick() == "OPEN"
    assert cell.tick(GRIPPER=OPEN) == "RETURN"
    assert cell.events == ["TARGET", "CNF"]
    assert (cell.block["DESTINATION"], cell.block["GRIPPED"]) == ("pickup", False)


@pytest.mark.parametrize("colour", ["", "yellow", "Red"])
def test_a_box_of_unknown_colour_waits(colour: str) -> None:
    cell = FedBlock()
    for _ in range(200):
        cell.tick(BOX_PRESENT=True, COLOUR=colour)
    assert cell.block["$ECC"] == "APPROACH"


def test_the_arm_is_settled_when_it_has_stayed_at_the_target_for_30_samples() -> None:
    cell = FedBlock()
    cell.tick()
    for _ in range(100):
        assert cell.tick(MOVING=True, BOX_PRESENT=True, COLOUR="red") == "APPROACH"
    assert cell.ticks_until("CLOSE", 40, MOVING=False) == 31


@given(error=st.floats(0.0021, 1.0), joint=st.integers(1, 3), sign=st.sampled_from([-1, 1]))
def test_an_arm_beside_the_target_never_grips(error: float, joint: int, sign: int) -> None:
    cell = FedBlock()
    cell.tick()
    cell.tick(**{f"THETA{joint}": PICKUP.theta[joint - 1] + sign * error}, MOVING=True)
    for _ in range(100):
        cell.tick(BOX_PRESENT=True, COLOUR="red", MOVING=False)
    assert cell.block["$ECC"] == "APPROACH"


@pytest.mark.parametrize("seed", range(5))
def test_noise_of_the_encoders_does_not_keep_the_arm_from_settling(seed: int) -> None:
    generator = np.random.default_rng(seed)
    cell = FedBlock()
    cell.tick()
    states = []
    for _ in range(150):
        noisy = np.array(PICKUP.theta) + generator.uniform(-0.0025, 0.0025, 3)
        states.append(cell.tick(**triple("THETA", noisy), BOX_PRESENT=True, COLOUR="red"))
    assert "CLOSE" in states


@pytest.mark.parametrize(("error", "after"), [(0.04, "OPEN"), (0.06, "CARRY")])
@pytest.mark.parametrize("joint", [1, 2, 3])
def test_an_arm_that_leaves_the_place_while_the_gripper_opens_closes_it_again(
    error: float, after: str, joint: int
) -> None:
    cell = FedBlock()
    cell.advance_to("OPEN")
    there = cell.sensors[f"THETA{joint}"]
    assert cell.tick(**{f"THETA{joint}": there - error}, GRIPPER=0.5) == after
    assert cell.block["GRIPPED"]
    if after == "CARRY":
        assert cell.block["V_GRIPPER"] == -3.0
        assert cell.tick(GRIPPER=OPEN) == "CARRY", "it has not come back"
        cell.ticks_until("OPEN", 200, **{f"THETA{joint}": there}, GRIPPER=CLOSED)
    assert cell.tick(**{f"THETA{joint}": there}, GRIPPER=OPEN) == "RETURN"


def test_a_held_arm_neither_grips_nor_releases() -> None:
    cell = FedBlock()
    cell.advance_to("CLOSE")
    assert cell.tick(HOLD=True, GRIPPER=CLOSED) == "APPROACH"
    assert (cell.block["V_GRIPPER"], cell.block["GRIPPED"]) == (3.0, False)
    for _ in range(100):
        assert cell.tick() == "APPROACH"
    assert cell.tick(HOLD=False) == "CLOSE"
    cell.tick()
    cell.ticks_until("OPEN", 40)
    assert cell.tick(HOLD=True, GRIPPER=OPEN) == "CARRY"
    assert (cell.block["V_GRIPPER"], cell.block["GRIPPED"]) == (-3.0, True)
    for _ in range(100):
        assert cell.tick() == "CARRY"
