"""Logs of healthy, odd and faulty arms, and ways to spoil them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dtwin.emulation.faults import parse_fault
from dtwin.emulation.machine.files import machine_of
from dtwin.logs.log import Log
from dtwin.parameters import PERIOD
from dtwin.run.cell import Cell
from dtwin.run.options import ControlOptions
from dtwin.run.settings import CellSettings

Columns = dict[str, NDArray[Any]]
SECONDS = 30.0
FAULTS = (
    "K2*=0.5@12",
    "late@8",
    "cut1@15",
    "freeze2@12",
    "scale3*=1.2@5",
    "lock1@10-20",
    "payload*=1.5@5",
    "supply*=0.7@10",
    "D2*=6@6",
    "bias1+=0.2@10",
    "K1*=0.3@10",
    "drift2+=0.01@5",
    "mu3+=0.1@5",
    "freeze3@1",
    "push1+=0.5@10-15",
)


def made(machine: str = "ideal", noise: float = 0.001, faults: tuple[str, ...] = (), seed: int = 3) -> Log:
    """The log of a cell at work for SECONDS."""
    cell = Cell(
        CellSettings(
            duration=SECONDS,
            seed=seed,
            noise=noise,
            noise_kind="gaussian",
            control=ControlOptions().control(),
            machine=machine_of(machine),
            faults=tuple(map(parse_fault, faults)),
        )
    )
    cell.run()
    return cell.log.freeze()


def spoiled(log: Log, way: Callable[[Columns], Columns]) -> Log:
    """A log whose columns somebody has mixed up."""
    return replace(log, columns=MappingProxyType(way(dict(log.columns))))


def times(factor: float, *names: str) -> Callable[[Columns], Columns]:
    """Columns times a factor."""
    return lambda columns: {**columns, **{name: factor * columns[name] for name in names}}


def moved(**whence: str) -> Callable[[Columns], Columns]:
    """Columns that come from others."""
    return lambda columns: {**columns, **{name: columns[source] for name, source in whence.items()}}


def late(ticks: int) -> Callable[[Columns], Columns]:
    """Commands that stand so many rows behind the samples that they answer, or, below 0, before them."""

    def way(columns: Columns) -> Columns:
        names = [f"volts_{motor}" for motor in (1, 2, 3, 4)]
        rows = slice(ticks, None) if ticks > 0 else slice(None, ticks)
        return {name: np.roll(each, ticks if name in names else 0)[rows] for name, each in columns.items()}

    return way


def inverted(columns: Columns) -> Columns:
    """A switch that is read the wrong way round."""
    return {**columns, "box_gripped": ~columns["box_gripped"]}


def velocities(columns: Columns) -> Columns:
    """Velocities where angles belong: the differences of the readings."""
    return {**columns, **{name: np.gradient(columns[name], PERIOD) for name in MEASURED}}


MEASURED = ("measured_1", "measured_2", "measured_3")
VOLTS = ("volts_1", "volts_2", "volts_3")
SPOILINGS: Mapping[str, tuple[Callable[[Columns], Columns], str]] = {
    "box_gripped inverted": (inverted, "box_gripped looks inverted"),
    "velocities": (velocities, "measured_1 to 3 look like velocities"),
    "degrees": (times(180.0 / np.pi, *MEASURED), "angles look like degrees"),
    "degrees of one joint": (times(180.0 / np.pi, "measured_2"), "angles of joint 2 look like degrees"),
    "turns": (times(0.5 / np.pi, *MEASURED), "angles look like turns"),
    "milliradians": (times(1e3, *MEASURED), "angles look like milliradians"),
    "shares of the supply": (times(0.125, *VOLTS), "voltages look like shares of the supply"),
    "kilovolts": (times(1e-3, *VOLTS), "voltages look like kilovolts"),
    "angle 1 reversed": (times(-1.0, "measured_1"), "joint 1 looks reversed: the angle"),
    "angle 2 reversed": (times(-1.0, "measured_2"), "joint 2 looks reversed: the angle"),
    "angle 3 reversed": (times(-1.0, "measured_3"), "joint 3 looks reversed: the angle"),
    "all angles reversed": (times(-1.0, *MEASURED), "joints 1, 2 and 3 look reversed: the angle"),
    "voltage 1 reversed": (times(-1.0, "volts_1"), "joint 1 looks reversed: the voltage"),
    "voltage 2 reversed": (times(-1.0, "volts_2"), "joint 2 looks reversed: the voltage"),
    "voltage 3 reversed": (times(-1.0, "volts_3"), "joint 3 looks reversed: the voltage"),
    "joint 2 reversed": (times(-1.0, "measured_2", "volts_2"), "joint 2 looks reversed, angle and voltage"),
    "angles 1 and 2 swapped": (
        moved(measured_1="measured_2", measured_2="measured_1"),
        "joints look swapped: measured_1 to 3 should be measured_2, 1, 3",
    ),
    "voltages 2 and 3 swapped": (
        moved(volts_2="volts_3", volts_3="volts_2"),
        "joints look swapped: volts_1 to 3 should be volts_1, 3, 2",
    ),
    "joints 1 and 3 swapped": (
        moved(measured_1="measured_3", measured_3="measured_1", volts_1="volts_3", volts_3="volts_1"),
        "joints look swapped: joints 1 to 3 should be joints 3, 2, 1",
    ),
    "1 tick late": (late(1), "commands seem 1 tick late"),
    "1 tick early": (late(-1), "commands seem 1 tick early"),
    "3 ticks late": (late(3), "commands seem 3 ticks late"),
    "7 ticks early": (late(-7), "commands seem 7 ticks early"),
}
"""Ways to spoil a log, and what the check has to say of it."""
