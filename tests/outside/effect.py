"""What lies around the seam of a plant: small parts that change its readings, its commands, or push its joints.

The generator of machines knows none of this: parts act between the plant and `Sensors` or `Voltages` only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from msgspec.structs import replace

from dtwin.parameters import JointVector
from dtwin.signals import Sensors, Truth, Voltages

Reading = Callable[[Sensors, Truth], Sensors]
"""A sample as it reaches the controller, from what the plant gave in its true state; called once a tick."""
Command = Callable[[Voltages], Voltages]
"""A command as it reaches the plant; called once a tick."""
Torque = Callable[[Truth, Voltages], JointVector]
"""Torques on the joints (N m) until the next tick, in a true state and under the command that acts."""

_TINY = 1e-6
"""Less than any tick, s: times are sums of ticks."""


@dataclass(frozen=True, slots=True)
class Outside:
    """Parts that act together, each kind in the order given."""

    readings: tuple[Reading, ...] = ()
    commands: tuple[Command, ...] = ()
    torques: tuple[Torque, ...] = ()

    def __add__(self, other: Outside) -> Outside:
        return Outside(self.readings + other.readings, self.commands + other.commands, self.torques + other.torques)


Effect = Callable[[np.random.Generator], Outside]
"""Makes the parts of one run; all that is random in them comes from the generator."""


def together(*effects: Effect) -> Effect:
    """Effects that act at once, those given first nearest to the plant."""

    def make(random: np.random.Generator) -> Outside:
        return sum((effect(random) for effect in effects), Outside())

    return make


def later(effect: Effect, delay: float) -> Effect:
    """An effect for which the time begins later (s), such as in the middle of a motion."""

    def make(random: np.random.Generator) -> Outside:
        parts = effect(random)

        def reading(part: Reading) -> Reading:
            def read(sensors: Sensors, truth: Truth) -> Sensors:
                given = part(replace(sensors, time=sensors.time - delay), truth)
                return replace(given, time=sensors.time)

            return read

        def command(part: Command) -> Command:
            def pass_on(voltages: Voltages) -> Voltages:
                given = part(replace(voltages, time=voltages.time - delay))
                return replace(given, time=voltages.time)

            return pass_on

        def torque(part: Torque) -> Torque:
            return lambda truth, voltages: part(replace(truth, time=truth.time - delay), voltages)

        return Outside(
            tuple(map(reading, parts.readings)),
            tuple(map(command, parts.commands)),
            tuple(map(torque, parts.torques)),
        )

    return make


def since(effect: Effect, start: float) -> Effect:
    """An effect that has none before a time (s), as of a motor that is replaced by another one."""

    def make(random: np.random.Generator) -> Outside:
        parts = effect(random)

        def reading(part: Reading) -> Reading:
            def read(sensors: Sensors, truth: Truth) -> Sensors:
                given = part(sensors, truth)
                return given if sensors.time >= start - _TINY else sensors

            return read

        def command(part: Command) -> Command:
            def pass_on(voltages: Voltages) -> Voltages:
                given = part(voltages)
                return given if voltages.time >= start - _TINY else voltages

            return pass_on

        def torque(part: Torque) -> Torque:
            def push(truth: Truth, voltages: Voltages) -> JointVector:
                given = part(truth, voltages)
                return given if truth.time >= start - _TINY else (0.0, 0.0, 0.0)

            return push

        return Outside(
            tuple(map(reading, parts.readings)),
            tuple(map(command, parts.commands)),
            tuple(map(torque, parts.torques)),
        )

    return make


def nothing(_: np.random.Generator) -> Outside:
    """The plant as it is."""
    return Outside()


def changed(values: JointVector, joints: tuple[int, ...], change: Callable[[int, float], float]) -> JointVector:
    """The values, those of the given joints (1 to 3) changed by a function of index (0 to 2) and value."""
    return tuple(change(i, value) if i + 1 in joints else value for i, value in enumerate(values))
