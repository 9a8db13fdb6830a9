"""What a user of an FMU does wrong at first: each mistake is named, with what was expected, and costs nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from dtwin.cli import main
from dtwin.fmu.sources import Version
from tests.fmu.conftest import Made
from tests.support.fmi import DISCARD, ERROR, OK, Instance, Library
from tests.support.iec61499.c_harness import needs_compiler

pytestmark = [needs_compiler, pytest.mark.parametrize("version", ["3.0", "2.0"])]


@pytest.fixture
def twin(made: Made, version: Version) -> Instance:
    return Library(made("twin", version)).instantiate()


@pytest.fixture
def cell(made: Made, version: Version) -> Instance:
    return Library(made("cell", version)).instantiate()


def told(instance: Instance, text: str) -> None:
    assert text in instance.told
    assert instance.call("Reset") == OK
    assert instance.begin().step(0.0) == OK, "nothing was lost"
    instance.free()


def test_milliseconds(twin: Instance) -> None:
    """The longest step is 2.5 ms."""
    assert twin.set(longest_step=2.5) == DISCARD
    told(twin, "longest_step: expected 1e-05 to 1, got 2.5")


def test_grams(cell: Instance) -> None:
    assert cell.set(box_mass=200.0) == DISCARD
    told(cell, "box_mass: expected 0 to 100, got 200")


def test_step_numbers_for_times(twin: Instance) -> None:
    twin.begin()
    assert [twin.step(0), twin.step(1)] == [OK, ERROR]
    told(twin, "expected the communication point 0.01 s, got 1")


def test_a_step_that_is_done_twice(twin: Instance) -> None:
    twin.begin()
    assert [twin.step(0.0), twin.step(0.0)] == [OK, ERROR]
    told(twin, "expected the communication point 0.01 s, got 0")


def test_the_end_for_the_duration(twin: Instance) -> None:
    """The second number is how long the step takes, not where it ends; with a stop time that is seen."""
    twin.begin(0.0, 0.03)
    assert [twin.step(0.0, 0.01), twin.step(0.01, 0.02), twin.step(0.03, 0.03)] == [OK, OK, ERROR]
    told(twin, "expected a step that ends by the stop time 0.03 s, got 0.06")


def test_a_start_value_after_the_start(twin: Instance) -> None:
    twin.begin()
    assert twin.set(theta1_start=0.5) == ERROR
    told(twin, "theta1_start: can be set until the initialization ends")


def test_an_output_that_is_set(twin: Instance) -> None:
    assert twin.set(theta1=0.5) == ERROR
    told(twin, "theta1: expected an input or a parameter, got an output")


def test_a_real_number_for_an_integer(cell: Instance) -> None:
    law = cell.library.variables["CONTROLLER.LAW"].reference
    assert cell.put("Float64", [law], [2.0]) == ERROR
    told(cell, "CONTROLLER.LAW: expected a real variable, got an integer one")


def test_a_law_that_is_none(cell: Instance) -> None:
    assert cell.set(CONTROLLER__LAW=3) == DISCARD
    told(cell, "CONTROLLER.LAW: expected 0 to 2, got 3")


def test_a_gain_of_another_law(cell: Instance) -> None:
    assert cell.set(CONTROLLER__KP1=1e6) == DISCARD
    told(cell, "CONTROLLER.KP1: expected 0 to 100000, got 1000000")


def test_no_initialization(twin: Instance) -> None:
    assert twin.step(0.0) == ERROR
    told(twin, "cannot be called before the initialization")


def test_no_experiment(twin: Instance, version: Version) -> None:
    """In FMI 2.0 a function of its own says when the start is."""
    if version == "2.0":
        assert twin.call("EnterInitializationMode") == ERROR
        assert "expected fmi2SetupExperiment before" in twin.told
    assert twin.begin(5.0).step(5.0) == OK
    assert twin.step(5.01) == OK
    twin.free()


def test_a_run_after_the_end(twin: Instance) -> None:
    assert (twin.begin().call("Terminate"), twin.step(0.0)) == (OK, ERROR)
    told(twin, "cannot be called after the end")


def test_stops_that_are_swapped(twin: Instance) -> None:
    """Both can be set in either order, so that they are compared when they count."""
    assert twin.set(gripper_closed_at=0.9, gripper_open_at=0.4) == OK
    assert (twin.enter(), twin.call("ExitInitializationMode")) == (OK, ERROR)
    assert "expected gripper_closed_at up to gripper_open_at" in twin.told
    assert twin.set(gripper_open_at=1.0) == OK
    assert twin.call("ExitInitializationMode") == OK
    assert twin.set(gripper_open_at=0.5) == OK
    assert twin.step(0.0) == ERROR
    assert twin.set(gripper_open_at=1.0) == OK
    assert twin.step(0.0) == OK
    twin.free()


def test_more_volts_than_there_are(twin: Instance) -> None:
    """A strong law is clipped, as by the amplifier, not refused."""
    other = twin.library.instantiate()
    for instance, volts in ((twin, 8.0), (other, 5000.0)):
        instance.begin()
        assert instance.set(V1=volts) == OK
        assert instance.step(0.0) == OK
    assert twin.get("theta1", "omega1", "alpha1") == other.get("theta1", "omega1", "alpha1")
    twin.free()
    other.free()


def test_the_token_of_the_other_version(made: Made, version: Version) -> None:
    other: Version = "2.0" if version == "3.0" else "3.0"
    refused = Library(made("twin", version)).instantiate(token=Library(made("twin", other)).token)
    assert refused.handle is None
    assert "expected a co-simulation with the token of modelDescription.xml" in refused.told


def test_an_arm_that_no_fmu_can_hold(version: Version, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What the command starts with is checked before anything is written: a mass in grams."""
    arguments = ["fmu", "twin", str(tmp_path / "twin.fmu"), "--fmi", version, "--set", "m2=116.04"]
    assert main(arguments) == 2
    assert "m2: an FMU takes 0.0001 to 100 kg, got 116.04" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
