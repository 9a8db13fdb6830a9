"""Margins of arms whose gears yield, and how they are controlled."""

from dataclasses import replace

import numpy as np
import pytest

from dtwin.arm.chain import Arm, Transmission
from dtwin.controller.chain.application import Control
from dtwin.emulation.chain.arms import arm_of
from dtwin.emulation.chain.machine import machine_of
from dtwin.equations.rigid import usual_inertia
from dtwin.run.arm_cell import ArmCell
from dtwin.run.chain import ChainRun, run
from dtwin.run.margins.chain import margins, posed_plants
from dtwin.run.margins.gears import control_of

ARM = arm_of("planar-2r")


def geared(hertz: float) -> Arm:
    """The arm with rotors of half of its usual inertia, and gears on which both oscillate against each other."""
    joints = []
    for joint, own in zip(ARM.joints, usual_inertia(ARM).tolist(), strict=True):
        rotor, w = 0.5 * own, 2.0 * np.pi * hertz
        both = rotor * own / (rotor + own)
        gear = Transmission(w**2 * both, 0.06 * w * both, 0.0)
        joints.append(replace(joint, actuator=replace(joint.actuator, rotor=rotor), transmission=gear))
    return replace(ARM, joints=tuple(joints))


def worked(arm: Arm, control: Control) -> ChainRun:
    """Five seconds of it."""
    settings = ArmCell(arm="planar-2r").settings(5.0, 1)
    return run(replace(settings, arm=arm, machine=machine_of("nominal", arm), control=control))


def test_gears_that_hardly_yield_change_no_margin() -> None:
    stiff = geared(2000.0)
    rigid = replace(stiff, joints=tuple(replace(joint, transmission=None) for joint in stiff.joints))
    for one, other in zip(margins(stiff, Control(), 2), margins(rigid, Control(), 2), strict=True):
        assert one.modulus == pytest.approx(other.modulus, abs=1e-3)
        assert one.delay == pytest.approx(other.delay, rel=1e-2)


def test_an_arm_whose_gears_oscillate_under_the_usual_feedback_gets_a_slower_one() -> None:
    """The linear loop and the emulation with all its friction say the same of both."""
    arm = geared(30.0)
    control = control_of(arm)
    assert [joint.stable for joint in margins(arm, Control(), 4)] == [False, False]
    assert all(joint.stable for joint in margins(arm, control, 4))
    assert worked(arm, Control()).stop, "its blocks stop an arm that oscillates"
    calm = worked(arm, control)
    assert not calm.stop
    assert np.abs(calm.error[-100:]).max() < 0.02


def test_an_arm_of_whose_gears_nothing_is_told_is_controlled_as_usual() -> None:
    assert control_of(ARM) == Control()
    assert control_of(ARM, 1) == Control(delay=ARM.period)
    assert control_of(arm_of("servo-2r")) == Control()


@pytest.mark.parametrize("late", [0, 1])
@pytest.mark.parametrize("hertz", [30.0, 200.0])
def test_a_control_keeps_a_modulus_where_its_margins_have_it(hertz: float, late: int) -> None:
    arm = geared(hertz)
    for pole, observer in ((13.7, 100.0), (9.0, 60.0), (7.0, 45.0)):
        control = Control(pole, observer, late * arm.period)
        for plant in posed_plants(arm, 3, late=late):
            found = plant.margins(control)
            least = min(one.modulus for one in found)
            stable = all(one.stable for one in found)
            assert plant.keeps(control, least) == stable
            assert not plant.keeps(control, least * (1.0 + 1e-9))
