"""An emulated cell that can be brought back as it was when its process was killed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import msgspec

from dtwin.emulation.emulation import Emulation, EmulationState
from dtwin.emulation.faults import parse_fault
from dtwin.errors import RecordingError
from dtwin.parameters import PERIOD
from dtwin.run.emulate import emulate
from dtwin.run.settings import CellSettings
from dtwin.services.parts.journal import Journal
from dtwin.services.parts.latch import Latch, Latched
from dtwin.signals import CellDrives, Event, Sensors, Voltages

NO_COMMAND: Final = Voltages(0, 0.0, (0.0, 0.0, 0.0, 0.0), False)
"""What acts before the first command."""


class Checkpoint(msgspec.Struct, frozen=True):
    """The cell at a moment of a tick when its command is set: its state, and volts (V) and grip of the command."""

    cell: EmulationState
    volts: CellDrives
    gripped: bool


class JournaledCell:
    """The cell, with every tick's command and every fault noted in a journal if there is one.

    Args:
        settings: settings of the cell; a journal that holds something brings its own seed.
        journal: journal of the cell, None for none; what it holds is replayed.

    Attributes:
        emulation: emulated cell, to be read; commands, ticks and faults go through this class.
        command: command that the arm obeys.
        latch: stop that is kept until its release, in the journal too.
        replayed: number of entries of the journal that were replayed.

    Raises:
        DtwinError: a setting cannot be used, or the journal's faults or its checkpoint cannot be.
    """

    def __init__(self, settings: CellSettings, journal: Journal | None) -> None:
        self._settings = settings if journal is None else replace(settings, seed=journal.seed)
        self._journal = journal
        self.emulation: Emulation = emulate(self._settings)
        self.command = NO_COMMAND
        entries = [] if journal is None else journal.entries()
        self.replayed = len(entries)
        for entry in entries:
            if isinstance(entry, bytes):
                self._restore(entry)
                continue
            if isinstance(entry, str):
                self.emulation.inject([parse_fault(entry)])
                continue
            volts, gripped = entry
            sensors = self.emulation.read()
            self.obey(Voltages(sensors.sequence, sensors.time, volts, gripped))
            self.emulation.advance(PERIOD)
        if entries:
            self.emulation.drain_events()
        self.latch = Latch(Latched() if journal is None else journal.latched, self._note)
        if self.latch.latched.stop != "none":
            self.stop()

    @property
    def seed(self) -> int:
        """Of boxes and noise."""
        return self._settings.seed

    @property
    def without_command(self) -> str:
        """What becomes of the arm without a command, in words."""
        return "gets 0 V"

    def read(self) -> Sensors:
        """The sample of this tick."""
        return self.emulation.read()

    def obey(self, command: Voltages) -> None:
        """Sets the command until the next one."""
        self.command = command
        self.emulation.apply(command)

    def stop(self, pressing: float = 0.0) -> None:
        """0 V for the arm until the next command; the gripper goes on pressing a held box, which it would lose.

        Args:
            pressing: voltage at the gripper that is asked for, V; it counts where it presses harder (negative).
        """
        self.obey(without_torque(self.command, pressing))

    def hold_off(self, command: Voltages) -> None:
        """0 V for the arm where a command came that may not pass; its gripper may press harder."""
        self.stop(command.volts[3])

    def drain_events(self) -> list[Event]:
        """What happened in the cell since the last call."""
        return self.emulation.drain_events()

    def advance(self) -> None:
        """One tick under the command."""
        if self._journal is not None:
            if self._journal.due:
                command = self.command
                state = Checkpoint(self.emulation.state(), command.volts, command.box_gripped)
                self._journal.checkpoint(msgspec.msgpack.encode(state))
            self._journal.command(self.command.volts, self.command.box_gripped)
        self.emulation.advance(PERIOD)

    def inject(self, faults: Sequence[str]) -> list[str]:
        """Adds faults; returns them with the times they really have.

        Raises:
            FaultError: one cannot be read, is over already, or with the others makes a parameter impossible.
        """
        texts = [str(fault) for fault in self.emulation.inject([parse_fault(text) for text in faults])]
        if self._journal is not None:
            for text in texts:
                self._journal.fault(text)
        return texts

    def drain_news(self) -> list[str]:
        """What happened to the journal's file since the last call, in words."""
        if self._journal is None or not self._journal.news:
            return []
        news, self._journal.news = self._journal.news, []
        return news

    def restart(self, seed: int) -> None:
        """Starts anew at time 0, with the boxes and the noise of a seed.

        A latched stop stays, with the torque off: another arm stands there now.

        Raises:
            ParameterError: The seed is out of range; the cell goes on as it was.
        """
        settings = replace(self._settings, seed=seed)
        emulation = emulate(settings)
        self.latch.harden()
        if self._journal is not None:
            self._journal.restart(seed)
        self._settings, self.emulation = settings, emulation
        self.command = NO_COMMAND

    def _note(self, latched: Latched) -> None:
        if self._journal is not None:
            self._journal.latch(latched)

    def _restore(self, data: bytes) -> None:
        """Goes on from a checkpoint of the journal."""
        try:
            state = msgspec.msgpack.decode(data, type=Checkpoint)
        except msgspec.MsgspecError as error:
            raise RecordingError(f"journal: expected the state of an emulated cell: {error}") from None
        self.emulation.restore(state.cell)
        sensors = state.cell.sensors
        self.command = Voltages(sensors.sequence, sensors.time, state.volts, state.gripped)


def without_torque(command: Voltages, pressing: float) -> Voltages:
    """The same command with 0 V for the arm, and for a gripper without a box."""
    gripper = min(command.volts[3], pressing) if command.box_gripped else 0.0
    return Voltages(command.sequence, command.time, (0.0, 0.0, 0.0, gripper), command.box_gripped)
