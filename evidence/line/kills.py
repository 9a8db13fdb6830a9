"""A line whose control runs as processes that are ended and frozen at random: what goes on, and what comes back."""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar, Final, Literal

import msgspec
import numpy as np

from dtwin.campaign.spread import Progress
from dtwin.commands.frame import at_least
from dtwin.controller.ports import BLOCKS
from dtwin.errors import CommunicationError, DtwinError
from dtwin.line.file import DEFAULT_NAME, line_of
from dtwin.line.line import Line
from dtwin.line.served import Served
from dtwin.line.system import system
from dtwin.line.twins.rehearsal import rehearsed
from dtwin.services.service import held_port
from evidence.experiment import ExperimentCommand
from evidence.line.timed import TimedLine
from evidence.report import Report, page, table
from iec61499.deploy.system_file import system_text
from iec61499.mapping import configured
from iec61499.model import Parameter, System
from iec61499.net.address import LOOPBACK

Trouble = Literal["ended", "frozen"]
AWAY: Final = 8.0
"""Time for which a process is gone or frozen, s."""
AFTERWARDS: Final = 60.0
"""Time after it is back in which boxes must leave, s."""
PATIENCE: Final = 60.0
"""Longest time until all blocks answer again, s."""
_FILLING: Final = 100.0
_ANSWER: Final = 1.0
"""Longest wait for an answer, s of the wall clock."""
_START: Final = 30.0
"""Longest time in which a process starts, s of the wall clock."""


@dataclass(frozen=True, slots=True)
class KillOutcome:
    """What came of one process that was troubled.

    Attributes:
        device: its device of the line's system.
        trouble: what was done to it.
        back: time after it was back until all blocks answered, s; None if that did not happen.
        left: boxes that left the line meanwhile and afterwards.
        lost, collisions: boxes lost and vehicles that touched, since the last outcome.
        unfinished: boxes that left though something was still to be done to them, since then.
    """

    device: str
    trouble: Trouble
    back: float | None
    left: int
    lost: int
    collisions: int
    unfinished: int

    @property
    def kept(self) -> bool:
        """Whether the line went on, and nothing was lost, touched or left unfinished."""
        return self.back is not None and self.left > 0 and not (self.lost or self.collisions or self.unfinished)


def at_ports(whole: System, free: Callable[[int], Sequence[int]]) -> System:
    """A system whose SERVER blocks listen at other ports, and whose devices are at an address of their own.

    Args:
        whole: the system.
        free: gives as many ports as it is asked for.
    """
    (application,) = whole.applications
    names = [block.name for block in application.network.blocks if block.type_name.startswith("SERVER")]
    ports = iter(free(len(names) + len(whole.devices)))
    managed = list(itertools.islice(ports, len(whole.devices)))
    host = _own_host(managed[0])
    devices = tuple(
        replace(device, parameters=(Parameter("MGR_ID", f"'{host}:{port}'"),))
        for device, port in zip(whole.devices, managed, strict=True)
    )
    return configured(replace(whole, devices=devices), {f"{name}.ID": f"localhost:{next(ports)}" for name in names})


def _own_host(port: int) -> str:
    """An address of this machine for the devices of whoever has a port: what they publish goes to ports of that.

    The ports of UDP follow from the system alone, so that two lines on one address would be refused.
    """
    return f"127.1.{port >> 8}.{port & 255}" if sys.platform == "linux" else LOOPBACK


def _free_ports(count: int) -> list[int]:
    """Several ports that nobody has now, all different."""
    with ExitStack() as stack:
        return [stack.enter_context(held_port()) for _ in range(count)]


class Processes:
    """The devices of a system, a process each."""

    def __init__(self, path: Path, names: list[str]) -> None:
        self._path = path
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        for name in names:
            self.start(name)

    def start(self, name: str) -> None:
        """Starts the process of a device."""
        command = [sys.executable, "-m", "dtwin", "fb", "run", str(self._path), "--device", name]
        self._running[name] = subprocess.Popen([*command, "--blocks", str(BLOCKS)], stdout=subprocess.DEVNULL)

    def disturb(self, name: str, trouble: Trouble) -> None:
        """Ends or freezes a process."""
        if trouble == "frozen":
            os.kill(self._running[name].pid, signal.SIGSTOP)
        else:
            self._running[name].kill()
            self._running[name].wait()

    def restore(self, name: str, trouble: Trouble) -> None:
        """Lets it go on, or starts it again."""
        if trouble == "frozen":
            os.kill(self._running[name].pid, signal.SIGCONT)
        else:
            self.start(name)

    def close(self) -> None:
        """Ends all."""
        for process in self._running.values():
            process.kill()
            process.wait()


@contextmanager
def served(line: Line) -> Iterator[tuple[Processes, Served, list[str]]]:
    """The control of a line as processes, connected, and the names of its devices.

    Raises:
        CommunicationError: the processes do not start.
    """
    whole = at_ports(system(line), _free_ports)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "line.sys"
        path.write_text(system_text(whole), encoding="utf-8")
        names = [device.name for device in whole.devices]
        processes = Processes(path, names)
        try:
            with _connected(line, whole) as blocks:
                yield processes, blocks, names
        finally:
            processes.close()


def _connected(line: Line, whole: System) -> Served:
    until = time.monotonic() + _START
    while True:
        try:
            return Served(line, whole, _ANSWER)
        except CommunicationError:
            if time.monotonic() > until:
                raise
            time.sleep(0.2)


def _back(run: TimedLine) -> float | None:
    """Works until all blocks answer; how long that took, s."""
    began, until = run.plant.time, time.monotonic() + _START
    while run.control.absent:
        run.work(1.0)
        if run.plant.time - began > PATIENCE and time.monotonic() > until:
            return None
    return run.plant.time - began


def disturbed(line: Line, events: int, seed: int, progress: Progress = lambda done, of: None) -> list[KillOutcome]:
    """Troubles one process after the other.

    Args:
        line: the line; its arms only take time.
        events: number of troubles.
        seed: number of the random generator that draws them.
        progress: told how many are over.

    Raises:
        DtwinError: a box has vanished, or the processes do not start.
    """
    generator, outcomes = np.random.default_rng(seed), []
    with served(line) as (processes, blocks, names):
        run = TimedLine(line, blocks, {each.name: rehearsed(each, line.source.usual) for each in line.stations})
        run.work(_FILLING)
        for number in range(events):
            name = str(generator.choice(names))
            trouble: Trouble = "ended" if generator.random() < 0.5 else "frozen"
            plant = run.plant
            before = len(plant.left), plant.lost, plant.collisions, plant.unfinished
            processes.disturb(name, trouble)
            run.work(AWAY)
            processes.restore(name, trouble)
            back = _back(run)
            run.work(AFTERWARDS)
            after = len(plant.left), plant.lost, plant.collisions, plant.unfinished
            outcomes.append(KillOutcome(name, trouble, back, *np.subtract(after, before).tolist()))
            progress(number + 1, events)
    return outcomes


@dataclass(frozen=True)
class ExperimentLineKills(ExperimentCommand[list[KillOutcome]]):
    """End and freeze the processes that control a line at random, while it works.

    Fails when a box is lost or leaves unfinished, vehicles touch, blocks stay away, or no box leaves afterwards.
    """

    name: ClassVar = "line-kills"

    line: str = DEFAULT_NAME
    """Line: a file (*.toml) or a name of the folder lines."""
    events: int = 60
    """Number of processes that are ended or frozen, one after the other."""

    def measure(self, progress: Progress) -> list[KillOutcome]:
        at_least("--events", self.events, 1)
        if sys.platform == "win32":
            raise DtwinError("line-kills: expected a system that can freeze processes")
        return disturbed(line_of(self.line), self.events, self.seed, progress)

    def report(self, result: list[KillOutcome]) -> Report:
        rows = [
            [
                each.device,
                each.trouble,
                "never" if each.back is None else f"{each.back:.0f}",
                *map(str, (each.left, each.lost, each.collisions, each.unfinished)),
            ]
            for each in result
        ]
        words = (
            f"Each process of the line's control is away for {AWAY:g} s of plant time; then all must answer again,"
            f" and boxes must leave the line in {AFTERWARDS:g} s. The arms only take time."
        )
        header = ["device", "what", "answers after s", "boxes that left", "lost", "touched", "unfinished"]
        return page("A line whose control is ended and frozen", words, table(header, rows))

    def figures(self, result: list[KillOutcome]) -> dict[str, Any]:
        return {"troubles": msgspec.to_builtins(result), "kept": sum(each.kept for each in result)}

    def passed(self, result: list[KillOutcome]) -> bool:
        return all(each.kept for each in result)
