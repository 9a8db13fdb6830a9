"""What is known of the healthy arm before a recovery: a model of an ideal one, the record of any other."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from dtwin.commissioning.procedure import commission
from dtwin.commissioning.stages import Stages
from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.settings import ControlSettings
from dtwin.emulation.machine.sections import IDEAL
from dtwin.identification.excitation.rig import Rig
from dtwin.identification.machine.record import MachineRecord, read_record, write_record
from dtwin.identification.model import write_model
from dtwin.identification.result import from_estimate
from dtwin.parameters import PERIOD, ArmParameters
from dtwin.run.cell import Cell
from dtwin.run.settings import CellSettings, sequence_of
from dtwin.services.launch import CellOptions
from dtwin.simulation.proposal import controllable
from evidence.identification.standard import standard_estimate

WATCHED: Final = 300.0
"""Plant time of the work that the monitor is calibrated with, s."""
IDENTIFIED_FROM: Final = 120.0
"""Plant time of its first part, from which the arm is identified, s."""
_OTHER_WORK: Final = 1 << 20
"""What the number of the generators of that work differs by from that of the cell."""


@dataclass(frozen=True)
class KnownArm:
    """The healthy arm as it is known.

    Attributes:
        arm: its parameters.
        file: file of its model or record.
        record: record of an arm that was commissioned; None of one that obeys the equations of motion.
    """

    arm: ArmParameters
    file: Path
    record: MachineRecord | None = None

    @property
    def model(self) -> ArmParameters:
        """The model that the controller is to have."""
        return self.arm if self.record is None else controllable(self.record)

    def used(self, options: CellOptions) -> CellOptions:
        """Options of a cell whose monitor, simulation and controller begin with what is known."""
        if self.record is None:
            return replace(options, model=str(self.file))
        proposed = self.record.settings
        tuned = self.file if proposed is not None and not proposed.refused else None
        return replace(options, commissioned=self.file, tuned=tuned)

    def control(self, options: CellOptions) -> ControlSettings:
        """The settings of a cell that is used with what is known, once its controller has the model of the arm."""
        return replace(self.used(options).control(), model=self.model)


def known_arm(settings: CellSettings, folder: Path, generator: np.random.Generator) -> KnownArm:
    """Identifies the arm of a cell, an ideal one in an experiment, any other one from its work.

    Args:
        settings: what the cell is run with.
        folder: folder for the file.
        generator: random generator of the experiment.

    Raises:
        IdentificationError: the arm cannot be identified.
    """
    file = folder / "arm.json"
    if settings.machine == IDEAL:
        estimate = standard_estimate(Rig(noise=settings.noise, machine=settings.machine), generator)
        model = from_estimate(estimate, np.ones(3), "simulated experiment")
        write_model(model, file)
        return KnownArm(model.arm, file)
    work = replace(settings, duration=WATCHED, seed=settings.seed + _OTHER_WORK, faults=())
    cell = Cell(work, EmbeddedController(work.control, work.blocks, sequence_of(work)))
    cell.run()
    log = cell.log.freeze()
    motion = log.part(0, round(IDENTIFIED_FROM / PERIOD))
    stages = Stages(None, "", lambda text: None)
    record = commission(stages, motion, lambda: log, ArmParameters(), "its work", lambda text: None).record
    write_record(record, file)
    return KnownArm(record.arm, file, record)


def recorded_arm(file: Path) -> KnownArm:
    """The arm of a cell that was commissioned before.

    Raises:
        ModelError: the file is no record.
    """
    record = read_record(file)
    return KnownArm(record.arm, file, record)
