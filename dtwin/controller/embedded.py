"""Binds samples and commands to the function-block application; the control law itself is in the blocks alone."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, get_args

from dtwin.errors import ParameterError, choices
from dtwin.iec61499.files.mapping import resource_network
from dtwin.iec61499.library import Library
from dtwin.iec61499.runtime.resource import Resource
from dtwin.parameters import ROOT, ArmParameters, Gains, Law, PayloadModel, Triple
from dtwin.signals import Sensors, Voltages

BLOCKS: Final = ROOT / "fb"
"""Folder of the function-block library."""
SYSTEM: Final = "dtwin.sys"
"""The system in that folder which holds the application."""
DIGITS: Final = 1e-14
"""relative difference of a number and what a FORTE writes of it"""

LAWS: Final[tuple[Law, ...]] = get_args(Law)
"""In the order of the input LAW of the controller block."""
_NEEDED: Final[dict[Law, PayloadModel]] = {"default": "point", "seed": "weight"}

TUNING: Final = (*(f"CONTROLLER.{kind}{joint}" for kind in ("KP", "KI", "KD") for joint in (1, 2, 3)), "PLANNER.T")
"""Inputs that one message changes together: gains and target time, in the order of the message."""
MODEL: Final = tuple(f"CONTROLLER.{kind}{joint}" for kind in "KMILCD" for joint in (1, 2, 3))
"""Inputs that another one changes together: the model."""


@dataclass(frozen=True, slots=True)
class ControlSettings:
    """Values for the data inputs of the control application.

    Attributes:
        target_time: T, duration of every motion, s.
        gains: of the computed-torque law.
        law: "default" feeds back through the mass matrix, "seed" through its row sums, without damping term.
        model: the arm as the controller believes it to be; its Coulomb friction is not compensated.
        payload: assumed mass of a box, kg.
        payload_model: how a held box counts; if not given, as the law needs it to hold a box everywhere: as a
            point mass for the default law, by its weight alone for the seed's.

    Raises:
        ParameterError: a value is out of range.
    """

    target_time: float = 2.0
    gains: Gains = field(default_factory=Gains)
    law: Law = "default"
    model: ArmParameters = field(default_factory=ArmParameters)
    payload: float = 0.2
    payload_model: PayloadModel | None = None

    def __post_init__(self) -> None:
        if not (math.isfinite(self.target_time) and self.target_time > 0):
            raise ParameterError(f"target time: expected a finite number of seconds above 0, got {self.target_time}")
        if not (math.isfinite(self.payload) and self.payload >= 0):
            raise ParameterError(f"payload: expected a finite mass of at least 0 kg, got {self.payload}")
        if self.law not in LAWS:
            raise ParameterError(f"law: expected {choices(LAWS)}, got {self.law!r}")
        if self.payload_model not in (None, *get_args(PayloadModel)):
            raise ParameterError(
                f"payload model: expected {choices(get_args(PayloadModel))}, got {self.payload_model!r}"
            )

    @property
    def box_counts(self) -> PayloadModel:
        """How a held box counts."""
        return self.payload_model or _NEEDED[self.law]

    def inputs(self) -> dict[str, float | int]:
        """The values by the name of the block's input, `BLOCK.INPUT`."""
        gains, model = self.gains, self.model
        by_name: dict[str, Triple] = {
            "KP": gains.kp,
            "KI": gains.ki,
            "KD": gains.kd,
            "K": model.voltage_constant,
            "M": model.mass,
            "I": model.inertia,
            "L": model.length,
            "C": model.com,
            "D": model.damping,
        }
        values: dict[str, float | int] = {
            f"CONTROLLER.{name}{joint}": value
            for name, triple in by_name.items()
            for joint, value in enumerate(triple, 1)
        }
        values["CONTROLLER.LAW"] = LAWS.index(self.law)
        values["CONTROLLER.PAYLOAD_MASS"] = self.payload
        values["CONTROLLER.WEIGHT_ONLY"] = self.box_counts == "weight"
        values["PLANNER.T"] = self.target_time
        return values

    @classmethod
    def from_inputs(cls, values: Mapping[str, float]) -> ControlSettings:
        """The settings of blocks whose inputs have these values: the inverse of `inputs`.

        Raises:
            ParameterError: a value is out of range.
        """

        def triple(name: str) -> Triple:
            first, second, third = (values[f"CONTROLLER.{name}{joint}"] for joint in (1, 2, 3))
            return first, second, third

        law = round(values["CONTROLLER.LAW"])
        if law not in range(len(LAWS)):
            raise ParameterError(f"CONTROLLER.LAW: expected 0 to {len(LAWS) - 1}, got {law}")
        return cls(
            values["PLANNER.T"],
            Gains(triple("KP"), triple("KI"), triple("KD")),
            LAWS[law],
            ArmParameters(*map(triple, "KMILCD")),
            values["CONTROLLER.PAYLOAD_MASS"],
            "weight" if values["CONTROLLER.WEIGHT_ONLY"] else "point",
        )

    def differing(self, other: ControlSettings) -> set[str]:
        """Names of the inputs in which a controller can tell two settings apart: a FORTE writes 15 digits."""
        mine, its = self.inputs(), other.inputs()
        return {name for name in mine if not math.isclose(mine[name], its[name], rel_tol=DIGITS)}


class EmbeddedController:
    """The control application of `blocks` in the embedded runtime, stepped by calls.

    Attributes:
        resource: the running application, for reading and writing block variables between steps.

    Raises:
        FunctionBlockError: the library or its application cannot be used.
    """

    def __init__(self, settings: ControlSettings | None = None, blocks: Path = BLOCKS) -> None:
        library = Library([blocks])
        self.resource = Resource(resource_network(library.load_system(blocks / SYSTEM)), library)
        for name, value in (settings or ControlSettings()).inputs().items():
            self.resource.write(name, value)
        server = self.resource.server("EMULATOR")
        self.resource.start()
        self._exchange = server.exchange
        self._target = self.resource.reader([f"PLANNER.THETA_D{joint}" for joint in (1, 2, 3)])

    def step(self, sensors: Sensors) -> Voltages:
        """The application's answer to a sample: one IND of its server block, run until idle.

        Raises:
            FunctionBlockError: a block failed. CommunicationError: the application did not answer.
        """
        values = (*sensors.theta, sensors.gripper, sensors.box_present, sensors.box_colour)
        v_1, v_2, v_3, v_gripper, gripped = self._exchange(values)
        return Voltages(sensors.sequence, sensors.time, (v_1, v_2, v_3, v_gripper), gripped)

    def target(self) -> Triple:
        """The path's angles (rad) of the last step."""
        theta_1, theta_2, theta_3 = self._target()
        return (theta_1, theta_2, theta_3)
