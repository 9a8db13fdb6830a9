"""The options of the cell, and the command lines that services are started with."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.emulation.encoders import NoiseKind
from dtwin.emulation.machine.files import machine_of
from dtwin.emulation.machine.sections import IDEAL
from dtwin.errors import DtwinError, ModelError
from dtwin.options import arguments, parse_apart, parse_options
from dtwin.parameters import Law
from dtwin.run.options import ArmOptions, ControlOptions, PlantOptions
from dtwin.services.controller import Options as ControllerOptions
from dtwin.services.emulator import Options as EmulatorOptions
from dtwin.services.recorder import Options as RecorderOptions

numbers = st.floats(allow_nan=False, allow_infinity=False)
words = st.tuples() | st.tuples(st.just("K2*=0.1@45"), st.just("-1"))


@dataclass(frozen=True, kw_only=True)
class Cell(PlantOptions, ControlOptions):
    """Options of a cell that starts services."""

    other: int = 1
    """What no service knows."""


@given(
    st.builds(
        Cell,
        seed=st.integers(0, 2**63),
        noise=numbers,
        noise_kind=st.sampled_from(get_args(NoiseKind)),
        fault=words,
        set=words,
        step=numbers,
        mjcf=st.sampled_from([Path("/tmp/other.xml"), PlantOptions().mjcf]),
        machine=st.sampled_from(["ideal", "servo", "17", "/tmp/mine.toml"]),
        target_time=numbers,
        delay=numbers,
        friction=st.none() | st.tuples(numbers, numbers, numbers),
        law=st.sampled_from(get_args(Law)),
        other=st.integers(),
    )
)
def test_services_are_started_with_the_options_of_the_cell(cell: Cell) -> None:
    for declared, service in (
        (PlantOptions, EmulatorOptions),
        (ArmOptions, RecorderOptions),
        (ControlOptions, ControllerOptions),
    ):
        read = parse_options(service, "service", arguments(cell, declared))
        for name in declared.__dataclass_fields__:
            assert getattr(read, name) == getattr(cell, name)


def test_paths_of_arguments_hold_in_any_folder() -> None:
    assert arguments(PlantOptions(mjcf=Path("arm.xml")), PlantOptions) == ["--mjcf", str(Path("arm.xml").resolve())]
    assert arguments(PlantOptions(), PlantOptions) == []
    file = ["--machine", str(Path("mine.toml").resolve())]
    assert arguments(PlantOptions(machine="mine.toml"), PlantOptions) == file
    assert arguments(PlantOptions(machine="servo"), PlantOptions) == ["--machine", "servo"]


def test_the_machine_of_the_options_is_that_of_the_cell() -> None:
    assert PlantOptions().settings().machine == IDEAL
    assert PlantOptions(machine="lag").settings().machine == machine_of("lag")
    with pytest.raises(ModelError, match="machine 'oops': expected a file"):
        PlantOptions(machine="oops").settings()


def test_the_arm_of_the_options_is_made_with_the_tolerances_of_its_machine() -> None:
    made = ArmOptions(machine="servo", set=("l1=0.2",)).made()
    assert made.length == pytest.approx((0.2 * 1.001, 0.13246938 * 0.999, 0.1608 * 1.001))
    assert ArmOptions().made() == ArmOptions().parameters()


PLAIN = {
    "controller": "--cell c --listen unix:/x/61499 --target-time 3 --law cascade",
    "recorder": "--notes {} --ports.page 4000 --ports.data 5000 --log /a --resumable --set m1=0.2 --set m2=0",
    "bridge": "--state /s --urgent --processor 1 --sequence straight --wait-for recorder --wait-for emulator",
    "emulator": "--pace lockstep --seed 5 --noise 3e-3 --fault K2*=0.1@45 --duration 20",
}


@pytest.mark.parametrize("service", PLAIN)
def test_plain_options_are_read_without_the_parser_as_with_it(service: str, monkeypatch: pytest.MonkeyPatch) -> None:
    options = import_module(f"dtwin.services.{service}").Options
    words = PLAIN[service].split()
    expected = parse_options(options, service, words)
    monkeypatch.setattr("dtwin.options.os.fork", lambda: pytest.fail("the parser was loaded in a child"))
    assert parse_apart(options, service, words) == expected


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--seed 1.5", "--seed"),
        ("--seed", "--seed"),
        ("--sed 1", "perhaps you meant --seed"),
        ("--pace hurried", "hurried"),
        ("17", "17"),
        ("--seed 1 --seed two", "two"),
    ],
)
def test_options_that_are_not_plain_get_to_the_parser(words: str, said: str) -> None:
    with pytest.raises(DtwinError, match=said):
        parse_apart(import_module("dtwin.services.emulator").Options, "emulator", words.split())
