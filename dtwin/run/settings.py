"""The settings of a run of the cell, and what a log says of them.

Nothing here loads MuJoCo or a controller: whoever starts a cell reads its options in the same way as whoever runs it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import msgspec

from dtwin import __version__
from dtwin.controller.ports import BLOCKS
from dtwin.controller.sequence import SEQUENCES, SequenceName, SequenceSettings
from dtwin.controller.settings import NO_OFFSET, Compensation, ControlSettings
from dtwin.emulation import MODEL_FILE
from dtwin.emulation.encoders import NoiseKind
from dtwin.emulation.faults import Fault
from dtwin.emulation.machine.files import machine_from
from dtwin.emulation.machine.sections import IDEAL, Machine
from dtwin.errors import ModelError
from dtwin.parameters import PHYSICS_STEP, ArmParameters
from dtwin.task import DEFAULT_TASK, Task, notes_of


@dataclass(frozen=True, slots=True)
class CellSettings:
    """The settings of a run; equal settings give equal logs, byte by byte.

    Attributes:
        duration: plant time of the run, s.
        seed: number of the random generators of boxes and noise, which are independent of each other.
        noise: amplitude (uniform) or standard deviation (gaussian) of the encoder noise, rad.
        arm: parameters that the arm is made to; the controller keeps its own model.
        machine: what the arm has beside its parameters, and how far it is from them.
        step: integration step of the physics, s; the controller period must be a whole multiple of it.
        task: where boxes wait, where those of each colour belong, and how they come.
    """

    duration: float = 120.0
    seed: int = 0
    noise: float = 0.0
    noise_kind: NoiseKind = "uniform"
    faults: tuple[Fault, ...] = ()
    arm: ArmParameters = field(default_factory=ArmParameters)
    control: ControlSettings = field(default_factory=ControlSettings)
    step: float = PHYSICS_STEP
    machine: Machine = IDEAL
    model_file: Path = MODEL_FILE
    blocks: Path = BLOCKS
    task: Task = DEFAULT_TASK


def metadata(settings: CellSettings) -> dict[str, Any]:
    """The metadata of a log: the settings of the run; an ideal machine and the usual task are not named."""
    machine = {} if settings.machine.ideal else {"machine": described(settings.machine)}
    return {
        "version": __version__,
        "seed": settings.seed,
        "noise": settings.noise,
        "noise_kind": settings.noise_kind,
        "faults": [str(fault) for fault in settings.faults],
        "arm": asdict(settings.arm),
        "control": _notes(settings.control),
        "step": settings.step,
        **machine,
        **notes_of(settings.task),
    }


def _notes(control: ControlSettings) -> dict[str, Any]:
    """Settings of a controller as JSON; the usual compensation and offsets of zero are not named."""
    values = asdict(control)
    if control.encoder_offset == NO_OFFSET:
        del values["encoder_offset"]
    if control.compensation == Compensation():
        del values["compensation"]
    return values


def arm_of(notes: Mapping[str, Any]) -> ArmParameters:
    """The parameters of the arm of a log with the tolerances of its machine; the data sheet's where it says nothing.

    Args:
        notes: metadata of the log.

    Raises:
        ModelError: the metadata is not that of a run.
        ParameterError: a number in it is out of range.
    """
    try:
        nominal = msgspec.convert(notes.get("arm", {}), ArmParameters)
    except msgspec.ValidationError as error:
        raise ModelError(f"metadata of the log: arm: {error}") from None
    return machine_from(notes.get("machine", {}), IDEAL.name).arm(nominal)


def sequence_name(settings: CellSettings) -> SequenceName:
    """Name of the sequence in which the controller of a run fetches boxes: as bodies where they are some."""
    return "among_bodies" if settings.machine.contact.enabled else "straight"


def sequence_of(settings: CellSettings) -> SequenceSettings:
    """The sequence in which the controller of a run fetches boxes."""
    return replace(SEQUENCES[sequence_name(settings)], task=settings.task)


def described(machine: Machine) -> dict[str, Any]:
    """A machine as JSON: its name, and by section what it has beside the ideal one."""
    return {"name": machine.name, **machine.effects()}
