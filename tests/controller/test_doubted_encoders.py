"""Encoders of any arm that stop, jump or turn round: its blocks alone doubt them, and stop the arm under control."""

from dataclasses import replace
from math import erf, sqrt
from typing import Any

import numpy as np
import pytest

from dtwin.arm.poses import Poses
from dtwin.controller.chain.application import inputs
from dtwin.controller.chain.embedded import ChainController
from dtwin.controller.chain.encoders import repeats
from dtwin.emulation.chain.faults import parse_chain_fault
from dtwin.emulation.chain.plant import ChainPlant
from dtwin.equations.rigid import usual_inertia
from dtwin.run.arm_cell import ArmCell
from dtwin.run.chain import ChainRun, run

BRAKED = 0.6
"""Time within which an arm stands whose encoder lies in motion, s."""


def doubted(arm: str, *faults: str, duration: float, machine: str = "5") -> tuple[ChainRun, int, float]:
    """The run, the number of the joint that was doubted, and the largest count of doubts."""
    told, most = [0], [0.0]

    def look(blocks: Any, *_: Any) -> None:
        told[0] = told[0] or blocks.doubted
        most[0] = max(most[0], *(float(reader()[1]) for reader in blocks._doubts))

    settings = ArmCell(arm=arm, machine=machine, faults=faults).settings(duration, 3)
    return run(settings, beside=look), told[0], most[0]


def test_noise_repeats_no_reading_so_often() -> None:
    step, noise = 6e-6, 1e-5
    same = erf(step / (2.0 * sqrt(2.0) * noise))  # probability that a reading in the middle of a step is repeated
    assert same ** repeats(step, noise) <= 1e-12 < same ** (repeats(step, noise) - 1)
    assert repeats(1e-4, 2e-5) == 0  # in the middle of such a step noise does not show
    assert repeats(1e-4, 0.0) == 0


@pytest.mark.parametrize(
    "fault", ["freeze1@1.2", "freeze2@1.2", "bias2+=0.3@1.2", "scale1*=-1@1.2", "scale2*=0.5@1.2"]
)
def test_an_arm_whose_encoder_lies_in_motion_stands_soon(fault: str) -> None:
    ran, told, _ = doubted("planar-2r", fault, duration=1.2 + BRAKED)
    arm = ran.settings.arm
    parsed = parse_chain_fault(fault, len(arm))
    speed = np.abs(np.diff(ran.true, axis=0)) / arm.period
    assert speed[115:120, parsed.joint].max() > 0.2  # it moved
    assert ran.stop > 0
    assert told == parsed.joint + 1
    assert (speed.max(axis=0) <= [1.05 * joint.speed for joint in arm.joints]).all()


def test_an_encoder_that_stops_at_rest_is_found_by_its_noise() -> None:
    settings = ArmCell(arm="six-axis", machine="5", faults=("freeze5@4.0",)).settings(4.6, 3)
    poses = Poses(settings.poses.positions[:1], 100.0, False)
    still = run(replace(settings, poses=poses))
    assert still.stop > 0
    assert np.abs(np.diff(still.true, axis=0)).max() / settings.arm.period < 0.05


@pytest.mark.parametrize("arm", ["planar-2r", "servo-2r", "six-axis"])
@pytest.mark.parametrize("machine", ["ideal", "8"])
def test_nothing_is_doubted_of_a_sound_arm(arm: str, machine: str) -> None:
    ran, told, most = doubted(arm, duration=4.0, machine=machine)
    assert (ran.stop, told, most) == (0, 0, 0.0)


def test_a_single_wrong_reading_costs_nothing() -> None:
    ran, told, most = doubted("planar-2r", "bias1+=0.4@1.2-1.21", duration=2.0)
    assert (ran.stop, told) == (0, 0)
    assert 1.0 <= most <= 3.0
    assert np.abs(ran.error).max() < 0.02


def test_a_small_jump_is_taken_over_slowly() -> None:
    ran, told, _ = doubted("six-axis", "bias2+=0.03@1.2", duration=2.0)
    speed = np.abs(np.diff(ran.error[118:, 1])) / ran.settings.arm.period
    assert (ran.stop, told) == (0, 0)
    assert speed.max() < 0.2
    assert abs(ran.error[-1, 1] - 0.03) < 0.015


@pytest.mark.parametrize("begin", [1267, 1752, 2431])
def test_blocks_that_begin_anew_in_mid_motion_doubt_no_encoder(begin: int) -> None:
    """As those of a bridge whose predecessor was killed; at these ticks one joint or both are moving."""
    settings = ArmCell(arm="planar-2r", machine="7").settings(30.0)
    poses = settings.poses

    def begun() -> ChainController:
        arm = settings.arm
        return ChainController(len(arm), inputs(arm, usual_inertia(arm), settings.control, poses))

    plant = ChainPlant(settings.machine, poses.positions[0], 0, settings.late, ())
    blocks, read = begun(), plant.read()
    for tick in range(begin + 150):
        before, read = read, plant.read()
        if tick == begin:
            assert np.abs(read - before).max() > 0.3 * settings.arm.period, "it moves"
            blocks = begun()
        plant.apply(blocks.step(read.tolist()))
        plant.advance()
        assert blocks.stop == 0, tick - begin
