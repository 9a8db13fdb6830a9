"""Settings of the controller that were designed for one arm, as its record or the file of a search keeps them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec

from dtwin.controller.settings import ControlSettings
from dtwin.errors import ModelError
from dtwin.parameters import Gains, Law

NotNegative = Annotated[float, msgspec.Meta(ge=0.0)]


class LeastMargins(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The least of each margin over some poses, boxes and delays; all are 0 where the loop is not stable.

    Attributes:
        disk: disk margin of all motors at once.
        gain: gain margin of any one motor, dB.
        phase: phase margin of any one motor, degrees.
        delay: delay margin of all motors at once, ticks.
        torque: share of its torque by which any one motor may be weaker or stronger.
    """

    disk: NotNegative
    gain: NotNegative
    phase: NotNegative
    delay: NotNegative
    torque: NotNegative


class ProposedSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Settings of the controller for one arm, and how far they may be trusted.

    Attributes:
        control: the settings.
        late: least and greatest time after which the arm may obey a command, ticks.
        places: least margins at the places of the cell.
        workspace: least margins at the places and at poses of the whole workspace.
        noise: largest standard deviation of a voltage that the noise of the encoders makes, V.
        refused: why the settings must not be used, "" if nothing speaks against them.
        remarks: what a person should know of them, in words.
    """

    control: ControlSettings
    late: tuple[NotNegative, NotNegative]
    places: LeastMargins
    workspace: LeastMargins
    noise: NotNegative
    refused: str
    remarks: list[str]


class SavedTuning(msgspec.Struct, frozen=True, kw_only=True):
    """What `dtwin optimise --save` writes.

    Attributes:
        target_time: duration of every motion, s; None for that in force.
        gains: gains of the control law.
        law: that law; None if it is not known.
    """

    target_time: float | None = None
    gains: Gains
    law: Law | None = None


class _Record(msgspec.Struct):
    """What the record of an arm says of settings."""

    settings: ProposedSettings


def read_settings(path: Path) -> ControlSettings:
    """The settings that the record of an arm proposes.

    Raises:
        ModelError: the file is missing or no such record, or its settings are refused.
    """
    try:
        proposed = msgspec.json.decode(path.read_bytes(), type=_Record).settings
    except OSError as error:
        raise ModelError(f"{path}: {error.strerror}") from None
    except msgspec.MsgspecError as error:
        raise ModelError(f"{path}: expected a record of `dtwin commission` with settings: {error}") from None
    if proposed.refused:
        raise ModelError(f"{path}: its settings must not be used: {proposed.refused}")
    return proposed.control


def read_tuning(path: Path) -> SavedTuning:
    """The gains and the target time that an optimisation has saved.

    Raises:
        ModelError: the file is missing or no such file.
    """
    try:
        return msgspec.json.decode(path.read_bytes(), type=SavedTuning)
    except OSError as error:
        raise ModelError(f"{path}: {error.strerror}") from None
    except msgspec.MsgspecError as error:
        raise ModelError(f"{path}: expected gains as dtwin optimise saves them: {error}") from None
