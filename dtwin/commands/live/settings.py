"""`dtwin gains|model|target set`: changes the settings of the live controller and prints what was acknowledged."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import msgspec

from dtwin.bus.messages import GAINS, MODEL, TARGET, GainsSetting, ModelSetting, TargetSetting, Topic
from dtwin.bus.session import Bus
from dtwin.parameters import Triple, assignment, load_arm
from services.runfile import join

Setting = TypeVar("Setting", GainsSetting, ModelSetting, TargetSetting)


@dataclass(frozen=True, kw_only=True)
class _Settings:
    """Where the controller is, and how to print."""

    cell: str = "cell"
    """Name of the cell."""
    zenoh: Path | None = None
    """Zenoh configuration file, for a cell on another machine."""

    def bus(self) -> Bus:
        return join(self.cell, self.zenoh)


@dataclass(frozen=True, kw_only=True)
class GainsSet(_Settings):
    """Set gains of the running controller; those not given stay. Prints the gains that are in effect then."""

    kp: Triple | None = None
    """Proportional gains of joints 1 to 3, 1/s^2."""
    ki: Triple | None = None
    """Integral gains, 1/s^3."""
    kd: Triple | None = None
    """Derivative gains, 1/s."""

    def execute(self) -> int:
        with self.bus() as bus:
            given = {name: value for name in ("kp", "ki", "kd") if (value := getattr(self, name)) is not None}
            wanted = replace(bus.ask(GAINS, None, GainsSetting).gains, **given)
            return _apply(bus, GAINS, GainsSetting(wanted))


@dataclass(frozen=True, kw_only=True)
class ModelSet(_Settings):
    """Set the arm model of the running controller; values not given stay. Prints the model that is in effect then."""

    file: Path | None = None
    """JSON object of parameter names and numbers, e.g. {"m1": 0.12}."""
    set: tuple[str, ...] = ()
    """One parameter, e.g. m1=0.12; repeatable."""

    def execute(self) -> int:
        with self.bus() as bus:
            wanted = bus.ask(MODEL, None, ModelSetting).model if self.file is None else load_arm(self.file)
            wanted = wanted.with_values(dict(assignment(text) for text in self.set))
            return _apply(bus, MODEL, ModelSetting(wanted))


@dataclass(frozen=True, kw_only=True)
class TargetSet(_Settings):
    """Set how long every motion takes, from the next one on. Prints the time that is in effect then."""

    time: float
    """s"""

    def execute(self) -> int:
        with self.bus() as bus:
            return _apply(bus, TARGET, TargetSetting(self.time))


def _apply(bus: Bus, topic: Topic, wanted: Setting) -> int:
    print(msgspec.json.encode(bus.ask(topic, wanted, type(wanted))).decode())
    return 0
