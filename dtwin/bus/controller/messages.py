"""What the controller's blocks are told and asked: settings, and the signal that excites the arm."""

from __future__ import annotations

from typing import Annotated

import msgspec

from dtwin.parameters import JOINTS, ONE_A_JOINT, ArmParameters, CellJoints, Gains, Law, PayloadModel, every_joint
from dtwin.signals import SCHEMA, Count


class SettingsRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="schema", tag=SCHEMA):
    """Other settings for the controller's blocks: gains, a target time or both in one tick, a model in one tick, the
    mass of a box, or offsets of the encoders.

    The simulation service alone sends it, after its checks; everybody else sends it an UploadRequest.

    Attributes:
        gains: gains of the law in force.
        target_time: duration of every motion from the next one on, s.
        model: the arm as the controller shall believe it to be, alone; its Coulomb friction is not compensated.
        payload: mass of a box as the controller shall assume it, kg, alone.
        encoder_offset: offsets that are taken off what the encoders read, rad, alone.
    """

    gains: Gains | None = None
    target_time: float | None = None
    model: ArmParameters | None = None
    payload: float | None = None
    encoder_offset: CellJoints | None = None


class SettingsInForce(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """All settings that the controller's blocks have.

    Attributes:
        gains: gains of the law in force.
        target_time: duration of the next motion, s.
        model: the arm as the controller believes it to be.
        law: computed_torque, row_sum or cascade.
        payload: assumed mass of a box, kg.
        payload_model: how a held box counts: as a point mass or by its weight alone.
        delay: time from a sample until its voltages act that the cascade counts on, s.
        dead_zone: voltage lost in every amplifier that the cascade counts on, V.
        bandwidth: double pole of the cascade's observer, rad/s.
        encoder_offset: known offsets of the encoders, which are taken off what they read, rad.
        repeats: repetitions of a reading that the noise of each encoder makes impossible; 0 where it does not.
        pull: share of the torque of unknown drives and encoders that leaves the readings of each joint as they are.
    """

    gains: Gains
    target_time: float
    model: ArmParameters
    law: Law
    payload: float
    payload_model: PayloadModel
    delay: float = 0.01
    dead_zone: float = 0.0
    bandwidth: float = 100.0
    encoder_offset: CellJoints = every_joint(0.0)
    repeats: Annotated[tuple[int, ...], ONE_A_JOINT] = (0,) * JOINTS
    pull: CellJoints = every_joint(1.0)


class SignalRequest(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """The blocks shall play the identification signal from the next sample on, or end it."""

    run: bool


class IdentificationSignal(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """The 3-2-1-1 signal that the blocks play on request.

    Attributes:
        amplitude: V.
        unit: unit of time of the signal, ticks.
        delay: how much later each joint starts, ticks.
        samples: length, ticks.
    """

    amplitude: CellJoints
    unit: Count
    delay: Annotated[tuple[Count, ...], ONE_A_JOINT]
    samples: Count
