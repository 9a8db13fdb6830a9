"""The options of the cell, and the command lines that services are started with."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.emulation.encoders import NoiseKind
from dtwin.emulation.machine.files import machine_of
from dtwin.emulation.machine.sections import IDEAL
from dtwin.errors import ModelError
from dtwin.options import arguments, parse_options
from dtwin.parameters import Law
from dtwin.run.options import ArmOptions, ControlOptions, PlantOptions
from services.controller import Options as ControllerOptions
from services.emulator import Options as EmulatorOptions
from services.recorder import Options as RecorderOptions

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
