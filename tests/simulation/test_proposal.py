"""Settings for an identified arm: what they are made of, their margins on that arm, and when they are refused."""

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from dtwin.commands.simulation.upload import UploadGains, UploadModel
from dtwin.controller.proposed import read_settings
from dtwin.controller.settings import Compensation
from dtwin.errors import ModelError, ParameterError
from dtwin.identification.machine.record import EncoderCheck, MachineRecord, read_record, write_record
from dtwin.parameters import ArmParameters
from dtwin.run.cell_file import cell_of
from dtwin.run.options import ControlOptions
from dtwin.simulation import proposal
from dtwin.simulation.margins import design
from dtwin.simulation.margins.demands import MARGINS
from dtwin.simulation.margins.loop import linear_arm
from dtwin.simulation.margins.poses import places
from dtwin.simulation.proposal import compensation, controllable, dead_zone, held, lateness, propose, pull, repeats
from dtwin.twin.dynamics import forward_dynamics, mass_matrix
from dtwin.twin.effects import NO_EFFECTS, Effects
from dtwin.twin.machine import machine_acceleration, vector_of
from tests.support.records import recorded

DEAD_ZONES = ("dead_zone1", "dead_zone2", "dead_zone3")
GEARED = Effects(rotor_inertia=(0.001, 0.0008, 0.0012), lag=(0.004, 0.003, 0.005), delay=0.002)


@pytest.fixture(autouse=True)
def few_poles() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(design, "POSITION_POLES", (9.0, 13.0))
        patch.setattr(design, "VELOCITY_POLES", (15.0,))
        patch.setattr(proposal, "poses", places)
        yield


def told(record: MachineRecord, told: bool, *names: str) -> MachineRecord:
    """The record with some numbers that the data tell, or do not tell."""
    changed = {name: msgspec.structs.replace(record.numbers[name], told=told) for name in names}
    return msgspec.structs.replace(record, numbers={**record.numbers, **changed})


def test_without_effects_the_machine_accelerates_as_the_twin() -> None:
    arm = ArmParameters()
    state, volts = np.array([0.3, -1.0, 0.7, 0.5, -2.0, 1.0]), np.array([2.0, -1.0, 0.5])
    expected = forward_dynamics(state, volts, np.array(arm.vector()), 0.2, False)
    found = machine_acceleration(vector_of(arm, NO_EFFECTS), state, volts, 0.2)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_rotors_are_part_of_the_linear_arm() -> None:
    arm, theta = ArmParameters(), (0.4, -1.2, 0.8)
    rotors = np.diag(GEARED.rotor_inertia)
    M = mass_matrix(np.array(theta), np.array(arm.vector()), 0.2) + rotors
    plant = linear_arm(arm, 0.2, theta, GEARED)
    np.testing.assert_allclose(plant.B[3:], np.linalg.solve(M, np.diag(arm.voltage_constant)), rtol=1e-6)


def test_settings_have_the_margins_that_are_demanded_on_the_arm_of_the_record() -> None:
    found = propose(recorded(GEARED), lambda done, of: None)
    assert found.refused == ""
    for name in ("disk", "gain", "phase", "delay", "torque"):
        assert getattr(found.places, name) >= getattr(MARGINS, name), name
    assert found.control.law == "cascade"
    assert found.control.gains in (design.gains_of(9.0, 15.0), design.gains_of(13.0, 15.0))
    assert 0.0 < found.noise < 3.0


def test_an_arm_that_obeys_late_gets_no_settings_and_is_told_why() -> None:
    found = propose(recorded(replace(GEARED, delay=0.06)), lambda done, of: None)
    assert " a box: " in found.refused
    assert "expected" in found.refused
    assert found.remarks[0].startswith("no gains have the reserve of the design")


def test_a_model_that_does_not_predict_gets_no_settings() -> None:
    record = msgspec.structs.replace(recorded(GEARED), grade="unusable")
    assert propose(record, lambda done, of: None).refused == "the model of the arm does not predict its motion"


def test_the_controller_counts_rotors_as_links_and_only_friction_that_is_told() -> None:
    record = recorded(GEARED)
    friction = msgspec.structs.replace(record.numbers["mu2"], value=0.02)
    record = msgspec.structs.replace(record, numbers={**record.numbers, "mu2": friction, "mu3": friction})
    model = controllable(told(record, False, "mu3"))
    assert model.coulomb == (0.0, 0.02, 0.0)
    assert np.subtract(model.inertia, record.arm.inertia) == pytest.approx(GEARED.rotor_inertia)
    assert replace(model, inertia=record.arm.inertia, coulomb=record.arm.coulomb) == record.arm


def test_what_is_not_told_is_not_compensated() -> None:
    record = recorded(replace(GEARED, dead_zone=(0.2, 0.1, 0.3)))
    assert compensation(record).delay == pytest.approx(0.006)
    assert dead_zone(record) == pytest.approx(0.1 * 0.99)  # its standard deviation is a hundredth of it
    untold = compensation(told(record, False, "delay"))
    assert untold == Compensation(pull=untold.pull)
    assert dead_zone(told(record, False, "dead_zone1")) == 0.0


@pytest.mark.parametrize(
    ("noise", "longest", "expected"),
    [(0.6, 5, 54), (0.6, 30, 60), (0.6, 200, 0), (0.1, 0, 0)],
    ids=["noise", "noise with a memory", "noise with a long memory", "an encoder that stands still at rest"],
)
def test_noise_tells_how_often_a_reading_can_be_repeated(noise: float, longest: int, expected: int) -> None:
    """In the middle of a step, noise of 0.6 of it stays there with the probability 0.595: 54 times in a row 7e-13."""
    step = 1e-3
    spread = step * math.hypot(noise, 1.0 / math.sqrt(12.0))
    assert repeats(EncoderCheck(step, spread, spread, 0.0, 0.002, longest)) == expected


def test_an_encoder_without_steps_or_from_an_old_record_may_repeat_readings() -> None:
    assert repeats(EncoderCheck(None, 1e-3, 1e-3, 0.0, 0.002, 0)) == 0
    assert repeats(EncoderCheck(1e-4, 1e-3, 1e-3, 0.0, 0.002)) == 0


def test_what_holds_a_drive_and_the_steps_of_its_encoder_tell_what_may_pull_at_a_reading_that_stays() -> None:
    step = math.tau / 2**12
    assert pull(0.03, None) == pytest.approx(0.15 + 0.2)  # either way, of 0.3 N m
    assert pull(0.03, step) == pytest.approx(0.15 + 0.25)  # of the steps of 10 bits
    assert pull(0.2, step) == 1.0
    record = recorded(replace(GEARED, dead_zone=(0.2, 0.1, 0.0)))
    constants = ArmParameters().voltage_constant
    most = [number.value + 2.0 * number.deviation for number in map(record.numbers.__getitem__, DEAD_ZONES)]
    expected = [constant * volts for constant, volts in zip(constants, most, strict=True)]
    friction = [
        sum(
            max(record.numbers[f"{name}{joint}"].value + 2.0 * record.numbers[f"{name}{joint}"].deviation, 0.0)
            for name in ("mu", "stiction")
        )
        for joint in (1, 2, 3)
    ]
    assert held(record) == pytest.approx([a + b for a, b in zip(expected, friction, strict=True)])


def test_the_arm_is_as_late_as_its_delay_and_lags_say() -> None:
    least, greatest = lateness(recorded(GEARED))
    assert least == pytest.approx((0.002 - 2e-5 + 0.003) / 0.01)
    assert greatest == pytest.approx((0.002 + 2e-5 + 0.005) / 0.01)


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    record = recorded(GEARED)
    settings = propose(record, lambda done, of: None)
    write_record(msgspec.structs.replace(record, settings=settings), tmp_path / "arm.json")
    return tmp_path / "arm.json"


def test_a_record_gives_its_settings_to_runs_and_uploads(arm: Path) -> None:
    proposed = read_record(arm).settings
    assert proposed is not None
    assert read_settings(arm) == proposed.control
    assert ControlOptions(tuned=arm, target_time=3.0).control() == replace(proposed.control, target_time=3.0)
    with pytest.raises(ParameterError, match="--tuned: expected no --dead-zone beside it"):
        ControlOptions(tuned=arm, dead_zone=0.1).control()
    assert UploadGains(why="", commissioned=arm).change()["gains"] == proposed.control.gains
    assert UploadModel(why="", commissioned=arm).change() == {"model": proposed.control.model}
    with pytest.raises(ParameterError, match="--commissioned: expected no --file beside it"):
        UploadGains(why="", commissioned=arm, file=arm).change()
    for wrong in (UploadModel(why=""), UploadModel(why="", model="arm", commissioned=arm)):
        with pytest.raises(ParameterError, match="expected either --model or --commissioned"):
            wrong.change()


def test_settings_that_are_refused_and_records_without_any_are_not_taken(arm: Path, tmp_path: Path) -> None:
    record = read_record(arm)
    assert record.settings is not None
    settings = msgspec.structs.replace(record.settings, refused="gain margin 1.0 dB, expected at least 6 dB")
    for wrong, message in (
        (msgspec.structs.replace(record, settings=settings), r"must not be used: gain margin 1\.0 dB"),
        (msgspec.structs.replace(record, settings=None), "expected a record of `dtwin commission` with settings"),
    ):
        write_record(wrong, tmp_path / "wrong.json")
        with pytest.raises(ModelError, match=message):
            read_settings(tmp_path / "wrong.json")
    with pytest.raises(ModelError, match=r"none\.json: No such file"):
        read_settings(tmp_path / "none.json")


def test_margins_are_kept_at_the_places_of_the_task() -> None:
    task = cell_of("four-colours").task
    assert (
        propose(recorded(GEARED), lambda done, of: None, task).places
        != propose(recorded(GEARED), lambda done, of: None).places
    )
