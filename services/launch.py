"""Starts the services of a cell as processes and stops them together.

The supervisor does nothing but wait, so it loads no more than the bus. What needs MuJoCo to check an option runs in a
process that ends again; tests/test_imports.py says what must not be loaded here.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import msgspec

from dtwin.bus.opening import has_certificates, open_configured, open_peer
from dtwin.bus.session import Bus
from dtwin.bus.signature import new_key
from dtwin.emulation.encoders import check_noise
from dtwin.emulation.generators import check_seed
from dtwin.errors import ParameterError
from dtwin.files import LOG, RECORDING, ensure_writable
from dtwin.identification.store import STORE, ModelStore, model_path
from dtwin.names import check_name
from dtwin.options import arguments
from dtwin.recovery.modes import RecoveryMode
from dtwin.run.loop import tick_count
from dtwin.run.options import ArmOptions, CellFileOption, ControlOptions, PlantOptions
from dtwin.run.settings import CellSettings, metadata, sequence_name
from dtwin.services import runfile
from dtwin.services.chain.starting import ALARMS, AUDIT, OtherArm, OtherArmOptions, awaited, other_arm, programs_of
from dtwin.services.parts.fence import fence_warning
from dtwin.services.parts.journal import carry_over
from dtwin.services.parts.launched import Launched, running, signals
from dtwin.services.parts.pace import Pace
from dtwin.services.parts.part_files import discard_markers, discard_parts
from dtwin.services.parts.processes.starter import Starter
from dtwin.services.parts.stopping.watchdog import ALARM as ALARMING
from dtwin.services.runfile import OPERATOR, SUPERVISOR, RunFile
from dtwin.services.service import current_processor, free_port, held_port
from dtwin.services.supervisor import Program, Supervisor
from dtwin.simulation.history import HISTORY
from dtwin.view.viewer import LOOPBACK, Detail, Ports, Viewer, free_ports
from iec61499.net.address import LocalAddress, parse_address

MANAGEMENT: Final = 61499
"""Port of device management, here the name of a socket."""
SILENCE: Final = 10.0
"""Time for which a monitor may be silent before the arm is stopped, s: more than a new one takes to start."""


@dataclass(frozen=True, kw_only=True)
class CellOptions(PlantOptions, ControlOptions, OtherArmOptions):
    """Which services a cell has, and what they do."""

    controller: str = "embedded"
    """embedded, forte://HOST:PORT (deploys to that 4diac FORTE), or tcp://HOST:PORT (a device that is ready)."""
    pace: Pace = "realtime"
    """realtime, lockstep (as fast as every tick has its answer), or free (no tick waits)."""
    duration: float | None = None
    """Plant time to run, s; until Ctrl-C without it."""
    log: Path | None = None
    """Parquet log to write."""
    record: Path | None = None
    """Recording for the Rerun viewer to write."""
    detail: Detail = "screen"
    """What the recording holds: what a screen can show, or every sample (full), which takes several times as much."""
    viewer: Viewer = "none"
    """Show the run live: in a window of the Rerun viewer, or as a page for browsers on this machine (web)."""
    identification: bool = False
    """Start the identification service too: it excites and identifies the running arm (dtwin identify live)."""
    store: Path = STORE
    """Folder of identified models that the identification service keeps."""
    monitoring: bool = False
    """Start the monitoring service too: it watches the arm and publishes verdicts under twin/monitoring."""
    model: str | None = None
    """Identified model of the healthy arm, a file (*.json) or a name in --store, for monitoring and identification;
    the data sheet's arm if not given."""
    commissioned: Path | None = None
    """Record of the healthy arm that `dtwin commission` wrote, for monitoring, instead of a model, or of learning
    another arm."""
    safe_stop: bool = False
    """Let the monitoring service ask the function blocks to stop the arm when a failure is confirmed."""
    silence: float = SILENCE
    """With --safe-stop: longest silence of the monitoring service while the arm moves, s; then the arm is stopped."""
    simulation: bool = False
    """Start the simulation service too, which checks, uploads and watches new settings (dtwin upload, gains set)."""
    history: Path = HISTORY
    """History of the settings that the simulation service keeps."""
    recovery: RecoveryMode | None = None
    """Start the recovery service too: it proposes to people what is to be done about findings, or does it (act)."""
    console: bool = False
    """Start the operators' console too: a web page of the cell on this machine, whose address is printed."""
    recordings: Path | None = None
    """Folder of the logs that the console can replay."""
    cell: str = "cell"
    """Name of the cell, first in the keys."""
    arm: str = "arm"
    """Another arm than the thesis's: a name of arms/, its file (*.toml) or a model (*.urdf, *.xml), docs/arms.md;
    any other word is a name for the thesis's arm, second in the keys."""
    zenoh: Path | None = None
    """Zenoh configuration file, or a folder with one per service; else peers on this machine."""

    def check(self, starter: Starter) -> None:
        """Finds what is wrong with the options here, rather than in a service.

        Args:
            starter: starts the process in which they are checked where that takes MuJoCo.

        Raises:
            DtwinError: an option is out of range or cannot be read.
        """
        check_name(self.cell, "cell")
        other = self.other
        check_name(self.key if other is None else other.key, "arm")
        if self.duration is not None:
            tick_count(self.duration)
        if other is None:
            self._check_plant(starter)
        else:
            record = ["--commissioned", str(self.commissioned)] if self.commissioned else []
            _check_apart(
                starter, "chain.check", [*other.words, *record, *(["--identified"] if self.identification else [])]
            )
        for path, ending in ((self.log, LOG), (self.record, RECORDING)):
            if path is not None:
                ensure_writable(path, ending)
        if self.model is not None:
            self.model_file()
        if self.safe_stop and not self.monitoring:
            raise ParameterError("--safe-stop: expected --monitoring too, whose verdicts stop the arm")
        if not ALARMING < self.silence < float("inf"):
            raise ParameterError(f"--silence {self.silence:g}: expected a time above {ALARMING:g} s")
        if self.commissioned is not None and (self.model is not None or not self.monitoring):
            raise ParameterError("--commissioned: expected --monitoring too, and no --model beside it")
        if self.recovery and other is None and not (self.monitoring and self.identification and self.simulation):
            raise ParameterError(
                "--recovery: expected --monitoring, --identification and --simulation too, by which it works"
            )
        scheme = self.controller.partition("://")[0]
        if scheme in ("forte", "tcp"):
            parse_address(self.controller, scheme)
        elif self.controller != "embedded":
            raise ParameterError(
                f"--controller {self.controller}: expected embedded, forte://HOST:PORT or tcp://HOST:PORT"
            )

    def model_file(self) -> Path:
        """The file of the identified model.

        Raises:
            ModelError: there is no such model.
        """
        assert self.model is not None
        return model_path(self.model, ModelStore(self.store)).resolve()

    def _check_plant(self, starter: Starter) -> None:
        """Has the emulated cell made once in a process of its own, if more than its noise is unusual."""
        check_seed(self.seed)
        settings = self.settings()
        check_noise(settings.noise_kind, settings.noise)
        if arguments(replace(self, seed=0, noise=None, noise_kind=None), PlantOptions):
            _check_apart(starter, "check", arguments(self, PlantOptions))

    @property
    def other(self) -> OtherArm | None:
        """The arm, if it is another one than the thesis's.

        Raises:
            DtwinError: the cell's file cannot be read, or an option has no meaning for such an arm.
        """
        return other_arm(self)

    @property
    def key(self) -> str:
        """Name of the arm in the keys."""
        return self.arm if (other := self.other) is None else other.key

    def settings(self) -> CellSettings:
        """The emulated cell and its controller that the options stand for.

        Raises:
            DtwinError: an option is out of range or cannot be read.
        """
        return replace(super().settings(), control=self.control())

    def bus(self, meet: str, key: bytes) -> Bus:
        """A session of the operator, who knows the key of the services, or of the supervisor that others join."""
        session = open_configured(self.zenoh, SUPERVISOR, OPERATOR) if self.zenoh else open_peer(meet)
        return Bus(session, self.cell, self.key, key)

    def programs(self, meet: str, file: Path, ports: Ports, console: int) -> list[Program]:
        """The services in the order to be started; each waits for those it needs.

        Args:
            meet: where the peers of this machine meet.
            file: run file of the cell.
            ports: ports of the viewer.
            console: port of the console.
        """
        link = ["--cell", self.cell, "--arm", self.key]
        link += ["--zenoh", str(self.zenoh.resolve())] if self.zenoh else ["--meet", meet]
        turns = self._turns()
        heard = runfile.heard_of(file)
        if (other := self.other) is not None:
            return programs_of(other, self, [*link, *turns], console, heard)
        programs = []
        management = self.management(file)
        if self.controller.startswith("forte://"):
            from dtwin.services.controller import deploy_cell  # loads the reader of function blocks

            deploy_cell(parse_address(self.controller, "forte"), self.control())
        if self.controller == "embedded":
            # It answers every sample as the bridge does, and would be the one that waits for a busy processor.
            listen = ["--listen", management, *turns]
            programs.append(_service("controller", [*link, *listen, *arguments(self, ControlOptions)]))
        lossless = ["--lossless"] if self.pace != "realtime" else []
        bridge = ["--controller", management, "--state", str(runfile.state_of(file)), *turns, *lossless]
        cell = arguments(self, CellFileOption)
        sequence = ["--sequence", sequence_name(self.settings())]
        bridge += [*sequence, *cell]
        if self.safe_stop:
            # The arm does not move before it is watched.
            bridge += ["--monitored", str(self.silence), "--wait-for", "monitoring"]
        emulator = [
            "--pace",
            self.pace,
            *turns,
            "--journal",
            str(runfile.journal_of(file)),
            *arguments(self, PlantOptions),
        ]
        emulator += [] if self.duration is None else ["--duration", str(self.duration)]
        if self.log or self.record or self.viewer != "none":
            programs.append(_service("recorder", [*link, *lossless, *self._recorder_options(ports)]))
            bridge += ["--wait-for", "recorder"]
        if self.log:
            bridge += ["--recorded"]
            emulator += ["--recorded"]
        programs.append(_service("bridge", [*link, *bridge]))
        model = ["--model", str(self.model_file())] if self.model else []
        if self.identification:
            programs.append(_service("identification", [*link, *cell, *model, "--store", str(self.store.resolve())]))
        record = ["--commissioned", str(self.commissioned.resolve())] if self.commissioned else []
        if self.monitoring:
            stop = ["--safe-stop"] if self.safe_stop else []
            keep = ["--heard", str(heard)]
            programs.append(_service("monitoring", [*link, *cell, *(record or model), *keep, *stop]))
        if self.simulation:
            history = ["--history", str(self.history.resolve())]
            programs.append(_service("simulation", [*link, *cell, *sequence, *record, *history]))
        if self.recovery is not None:
            programs.append(_service("recovery", [*link, *cell, *record, "--mode", self.recovery]))
        if self.console:
            programs.append(_service("console", [*link, *self._console_options(ports, console)]))
        emulator += awaited(programs, self.pace)
        programs.append(_service("emulator", [*link, *emulator], leading=True))
        return programs

    def _turns(self) -> list[str]:
        """Options of the services that hand every tick on to each other.

        Only one of them works at a time, unless no tick waits, so they share a processor: on several, each of them
        would find another one asleep and its caches cold.
        """
        turns = ["--urgent"] if self.pace == "realtime" else []
        processor = None if self.pace == "free" else current_processor()
        return turns if processor is None else [*turns, "--processor", str(processor)]

    def management(self, file: Path) -> str:
        """Address of the controller's device management, for a cell with this run file.

        Raises:
            CommunicationError: the path of the run file is too long for sockets beside it.
        """
        if self.other is not None:
            return ""
        if self.controller == "embedded":
            address = LocalAddress(runfile.sockets_of(file), MANAGEMENT)
            address.check()
            return str(address)
        return self.controller.partition("://")[2]

    def warning(self) -> str:
        """What the user should know about the controller's ports, "" for nothing."""
        scheme, _, address = self.controller.partition("://")
        if scheme == "embedded":
            return ""
        secured = self.zenoh is not None and has_certificates(self.zenoh, OPERATOR)
        return fence_warning(parse_address(address), secured)

    @property
    def marked(self) -> Path | None:
        """The file beside which recorders leave marks for those that follow them."""
        return self.log or self.record

    def _console_options(self, ports: Ports, port: int) -> list[str]:
        options = ["--port", str(port), "--store", str(self.store.resolve())]
        files = {"--history": self.history, "--audit": AUDIT, "--alarms": ALARMS}
        options += [word for option, file in files.items() for word in (option, str(file.resolve()))]
        options += ["--recordings", str(self.recordings.resolve())] if self.recordings else []
        options += ["--viewer", ports.page_url] if self.viewer == "web" else []
        return options + arguments(self, CellFileOption)

    def _recorder_options(self, ports: Ports) -> list[str]:
        notes = msgspec.json.encode(metadata(self.settings())).decode()
        options = ["--viewer", self.viewer, "--detail", self.detail, "--notes", notes]
        options += ["--ports.page", str(ports.page), "--ports.data", str(ports.data)]
        options += ["--log", str(self.log.resolve())] if self.log else []
        options += ["--record", str(self.record.resolve())] if self.record else []
        flags = {"--resumable": self.marked, "--monitored": self.monitoring}
        options += [flag for flag, given in flags.items() if given]
        options += ["--commissioned", str(self.commissioned.resolve())] if self.commissioned else []
        return options + arguments(self, ArmOptions)


@contextmanager
def launched(options: CellOptions) -> Iterator[Launched]:
    """A cell while its services run; they are stopped at the end, in whatever way it comes.

    Raises:
        DtwinError: an option cannot be used, or a cell of that name is up.
    """
    meet = f"tcp/127.0.0.1:{free_port()}"
    key = new_key()
    with (
        _checked(options) as starter,
        options.bus(meet, key) as bus,
        signals(signal.default_int_handler),
        RunFile(options.cell) as file,
        runfile.own_folder(runfile.sockets_of(file.path)),
        runfile.own_folder(runfile.heard_of(file.path)),
        held_port() as console,
    ):
        file.write_key(key)
        journal, state = runfile.journal_of(file.path), runfile.state_of(file.path)
        carry_over(journal, options.seed)
        state.unlink(missing_ok=True)
        if options.marked is not None:
            discard_parts(options.marked)
        ports = free_ports()
        supervisor = Supervisor(bus, options.programs(meet, file.path, ports, console), key, starter)
        zenoh = None if options.zenoh is None else str(options.zenoh.resolve())
        up = runfile.Up(
            os.getpid(),
            options.key,
            meet,
            zenoh,
            options.management(file.path),
            page=ports.page_url if options.viewer == "web" else "",
            console=f"http://{LOOPBACK}:{console}/" if options.console else "",
            warning=options.warning(),
            history=str(options.history.resolve()),
            store=str(options.store.resolve()),
            cell_file=options.cell_file or "",
            other=options.other is not None,
        )
        try:
            with running(bus, supervisor, up, file) as cell:
                yield cell
        finally:
            if options.marked is not None:
                discard_markers(options.marked)
        journal.unlink(missing_ok=True)
        state.unlink(missing_ok=True)


@contextmanager
def _checked(options: CellOptions) -> Iterator[Starter]:
    """What starts the processes of a cell, once nothing was found wrong with its options.

    Raises:
        DtwinError: an option cannot be used.
    """
    with Starter() as starter:
        options.check(starter)
        yield starter


def _service(name: str, options: list[str], leading: bool = False) -> Program:
    return Program(name, [sys.executable, "-m", f"dtwin.services.{name}", *options], leading)


def _check_apart(starter: Starter, service: str, options: Iterable[str]) -> None:
    """Has options checked in a process of their own.

    Raises:
        ParameterError: they cannot be used.
    """
    process = starter.start([sys.executable, "-m", f"dtwin.services.{service}", *options])
    assert process.stderr is not None
    with process.stderr:
        said = process.stderr.read()
    if process.wait():
        raise ParameterError(said.strip().splitlines()[-1].removeprefix("check: "))
