"""Models for the blocks of an arm: what they hold, and which ones are refused."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.arm.chain import Arm
from dtwin.arm.model import ArmModel
from dtwin.arm.modelled import with_model
from dtwin.emulation.chain.arms import arm_of
from dtwin.emulation.chain.machine import drawn
from dtwin.errors import ParameterError
from dtwin.simulation.chain.checks import check_model

ARM = arm_of("planar-2r")
SHEET = ArmModel.of(ARM)


def test_a_model_put_into_an_arm_comes_out_again() -> None:
    other = ArmModel.of(drawn(ARM, 5))
    again = ArmModel.of(with_model(ARM, other))
    for name in ("bodies", "constant", "rotor", "viscous", "coulomb", "share"):
        assert np.allclose(getattr(again, name), getattr(other, name), rtol=1e-12, atol=1e-15), name
    assert not np.allclose(other.bodies, SHEET.bodies)


@pytest.mark.parametrize("name", ["planar-2r", "six-axis"])
@given(number=st.integers(0, 10**6))
def test_every_arm_that_is_drawn_within_the_tolerances_is_taken(name: str, number: int) -> None:
    arm: Arm = arm_of(name)
    check_model(arm, ArmModel.of(drawn(arm, number)))


@pytest.mark.parametrize(
    ("model", "words"),
    [
        (replace(SHEET, rotor=(0.0,)), "rotor: expected 2 values, one of each joint, got 1"),
        (replace(SHEET, bodies=(SHEET.bodies[0], SHEET.bodies[1][:9])), "body 2: expected 10 inertial parameters"),
        (replace(SHEET, viscous=(float("nan"), 0.1)), "expected finite numbers"),
        (replace(SHEET, constant=(SHEET.constant[0], -SHEET.constant[1])), "constant of joint 2: expected 0.5 to 2"),
        (replace(SHEET, rotor=(-1e-3, 0.0)), "rotor of joint 1: expected at least 0"),
        (replace(SHEET, coulomb=(1e3, 0.0)), "coulomb of joint 1: expected 0 to"),
        (replace(SHEET, share=(0.0, 0.6)), "share of joint 2: expected 0 to 0.5"),
        (
            replace(SHEET, bodies=(tuple(4.0 * x for x in SHEET.bodies[0]), tuple(4.0 * x for x in SHEET.bodies[1]))),
            "mass of all links: expected",
        ),
        (
            replace(SHEET, bodies=((*SHEET.bodies[0][:4], -1.0, *SHEET.bodies[0][5:]), SHEET.bodies[1])),
            "body 1: no body has such a mass",
        ),
        (replace(SHEET, rotor=(1e3, 0.0)), "inertia at joint 1: expected 0.333 to 3 times"),
    ],
)
def test_what_is_out_of_bounds_is_refused_by_name(model: ArmModel, words: str) -> None:
    with pytest.raises(ParameterError, match=words):
        check_model(ARM, model)
