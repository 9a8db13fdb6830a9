"""Settings and the inputs of the blocks that they become."""

import math
from dataclasses import replace
from itertools import product

import pytest

from dtwin.commands.cell.run import Run
from dtwin.controller.ports import MODEL, TUNING
from dtwin.controller.settings import LAWS, USUAL_GAINS, Compensation, ControlSettings, usual_gains
from dtwin.errors import ParameterError
from dtwin.parameters import ArmParameters, Gains, PayloadModel
from dtwin.run.settings import sequence_of
from tests.support.driven import Application

GAINS = Gains((1.0, 2.0, 3.0), (4.0, 5.0, 6.0), (7.0, 8.0, 9.0))
ARM = ArmParameters.from_vector(tuple(0.1 + k / 100 for k in range(21)))
SIDES: tuple[PayloadModel, ...] = ("point", "weight")


@pytest.mark.parametrize(("law", "side"), list(product(LAWS, SIDES)))
def test_inputs_are_the_settings(law: str, side: PayloadModel) -> None:
    settings = ControlSettings(1.5, GAINS, LAWS[LAWS.index(law)], ARM, 0.19, side)
    assert ControlSettings.from_inputs(settings.inputs()) == settings
    assert settings.differing(settings) == set()


def test_a_message_changes_its_inputs_and_no_others() -> None:
    settings = ControlSettings(1.5, GAINS, "computed_torque", ARM, 0.19, "point")
    inputs = ControlSettings().inputs()
    tuned = ControlSettings.from_inputs(inputs | {name: settings.inputs()[name] for name in TUNING})
    assert tuned.differing(ControlSettings()) == set(TUNING)
    assert (tuned.gains, tuned.target_time) == (GAINS, 1.5)
    modelled = ControlSettings.from_inputs(inputs | {name: settings.inputs()[name] for name in MODEL})
    assert modelled.differing(ControlSettings()) == set(MODEL)
    assert modelled.model == ARM


def test_fifteen_digits_are_the_same_settings() -> None:
    inputs = ControlSettings().inputs()
    written = {name: float(f"{value:.15g}") for name, value in inputs.items()}
    assert written != inputs
    assert ControlSettings.from_inputs(written).differing(ControlSettings()) == set()


@pytest.mark.parametrize(("name", "value"), [("CONTROLLER.LAW", 3), ("CONTROLLER.M1", -1.0), ("PLANNER.T", 0.0)])
def test_blocks_may_have_what_no_settings_are(name: str, value: float) -> None:
    with pytest.raises(ParameterError, match=f"got {value}"):
        ControlSettings.from_inputs(ControlSettings().inputs() | {name: value})


def test_compensation_reaches_its_inputs_and_has_its_limits() -> None:
    told = Compensation(0.004, 0.2, 150.0, (20, 0, 50), (0.4, 1.0, 0.25))
    settings = ControlSettings(law="cascade", compensation=told)
    inputs = settings.inputs()
    assert (inputs["OBSERVER.DELAY"], inputs["CONTROLLER.DEAD_ZONE"], inputs["OBSERVER.BANDWIDTH"]) == (
        0.004,
        0.2,
        150,
    )
    assert [inputs[f"OBSERVER.REPEATS{joint}"] for joint in (1, 2, 3)] == [20, 0, 50]
    assert [inputs[f"OBSERVER.PULL{joint}"] for joint in (1, 2, 3)] == [0.4, 1.0, 0.25]
    assert ControlSettings.from_inputs(inputs) == replace(settings, payload_model="point")
    for wrong in (
        {"delay": 0.011},
        {"dead_zone": -0.1},
        {"bandwidth": 400.0},
        {"bandwidth": math.nan},
        {"repeats": (0, 0, 301)},
        {"pull": (1.0, 0.0, 1.0)},
        {"pull": (1.0, 1.0, 1.1)},
    ):
        with pytest.raises(ParameterError, match="expected"):
            Compensation(**wrong)


def test_gains_belong_to_a_law() -> None:
    for law in LAWS:
        assert ControlSettings(law=law).gains == usual_gains(law) == USUAL_GAINS[law]
    assert ControlSettings(law="cascade").gains != ControlSettings().gains
    given = usual_gains("cascade", kp=(1.0, 2.0, 3.0))
    assert given == Gains((1.0, 2.0, 3.0), USUAL_GAINS["cascade"].ki, USUAL_GAINS["cascade"].kd)
    assert replace(ControlSettings(gains=given), law="cascade").gains == given
    with pytest.raises(TypeError, match="kp"):
        Gains()  # type: ignore[call-arg]
    with pytest.raises(ParameterError, match="law: expected computed_torque, row_sum or cascade, got 'none'"):
        usual_gains("none")  # type: ignore[arg-type]


def test_the_program_as_it_is_drawn_has_the_settings_of_a_run() -> None:
    options = Run()
    usual = options.control().inputs() | sequence_of(options.settings()).inputs()
    drawn = Application().resource
    assert {name: drawn.read(name) for name in usual} == usual
