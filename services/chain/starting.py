"""Which services a cell of another arm than the thesis's has, from the options of `dtwin up`.

Like the supervisor, this loads no MuJoCo: what needs it to check an option runs in a process that ends again.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from dtwin.errors import ParameterError
from dtwin.monitoring.settings import LEAST_HEALTHY
from dtwin.options import refuse_others
from dtwin.parameters import ROOT
from dtwin.services.parts.pace import Pace
from dtwin.services.supervisor import Program

THESIS: Final = "thesis"
EMBEDDED: Final = "embedded"
"""Value of --controller for blocks in a process of the cell."""
ENDINGS: Final = (".toml", ".urdf", ".xml", ".mjcf")
"""Of the files that an arm is read from: its own, and those of dtwin.arm.file.MODELS, which loads numpy."""
AUDIT: Final = Path("console-audit.jsonl")
"""Default file of the commands that are given at the console, in the working directory."""
ALARMS: Final = Path("console-alarms.jsonl")
"""Default journal of the alarms at the console, in the working directory."""
KNOWN: Final = frozenset(
    {
        *("arm", "cell_file", "machine", "poses", "path", "sort", "late", "seed", "fault"),
        *("controller", "pace", "duration", "log", "cell", "zenoh", "detach", "json"),
        *("monitoring", "commissioned", "safe_stop", "silence", "healthy", "recovery"),
        *("identification", "store", "simulation", "history", "console"),
    }
)
"""Options of `dtwin up` that mean something for any arm."""


@dataclass(frozen=True, kw_only=True)
class OtherArmOptions:
    """What another arm than the thesis's does."""

    poses: Path | None = None
    """TOML file of the poses that another arm takes; some that are drawn by --seed if not given."""
    path: Path | None = None
    """CSV file of a path that another arm follows: t, and its joints, or x, y, z of its tool (docs/arms.md)."""
    sort: Path | None = None
    """TOML file of a sorting task for another arm (docs/arms.md)."""
    late: int = 0
    """Ticks from a command until it acts, for another arm."""
    healthy: float | None = None
    """With --monitoring: time in which another arm is healthy and is learned, s; 60 if not given, longer where its
    motion does not suffice."""


@dataclass(frozen=True, kw_only=True)
class OtherArm:
    """The arm of a cell that is not the thesis's.

    Attributes:
        key: its name in the keys of the bus.
        words: options that all of its services are started with.
    """

    key: str
    words: tuple[str, ...]


def is_other(arm: str) -> bool:
    """Whether a value of --arm stands for another arm than the thesis's: its file, model or name of the folder arms.

    Anything else is a name for the keys of the bus.
    """
    return Path(arm).suffix.lower() in ENDINGS or (arm != THESIS and (ROOT / "arms" / f"{arm}.toml").exists())


def other_arm(options: Any) -> OtherArm | None:
    """The arm that --arm or the cell's file stands for; None for the thesis's.

    What an option says counts instead of what the file says.

    Args:
        options: options of `dtwin up`.

    Raises:
        ModelError: the cell's file cannot be read.
        ParameterError: an option has no meaning for such an arm.
    """
    given: dict[str, Any] = {}
    if options.cell_file is not None and _has_arm(options.cell_file):
        from dtwin.run.arm_cell import arm_cell_of  # loads MuJoCo, which other cells are started without

        found = arm_cell_of(options.cell_file)
        assert found is not None
        given = {name: getattr(found, name) for name in ("arm", "machine", "poses", "path", "sort", "late", "faults")}
    elif not is_other(options.arm):
        given_others = any(each is not None for each in (options.poses, options.path, options.sort, options.healthy))
        if options.late or given_others:
            raise ParameterError(
                "--poses, --path, --sort, --late, --healthy: expected --arm with another arm than the thesis's"
            )
        return None
    refuse_others(options, KNOWN, ("arm",))
    if options.controller != EMBEDDED and not options.controller.startswith("forte://"):
        raise ParameterError(
            f"--controller {options.controller}: expected {EMBEDDED} or forte://HOST:PORT for another arm than the "
            "thesis's, whose blocks are deployed when the cell starts"
        )
    if options.healthy is not None and not (options.monitoring and LEAST_HEALTHY <= options.healthy < math.inf):
        raise ParameterError(f"--healthy: expected --monitoring beside it, and at least {LEAST_HEALTHY:g} s")
    if options.healthy is not None and options.commissioned is not None:
        raise ParameterError("--healthy: expected no --commissioned beside it, whose record knows the arm already")
    if options.recovery is not None and (not options.monitoring or options.safe_stop):
        raise ParameterError(
            "--recovery: expected --monitoring beside it for another arm than the thesis's, and no --safe-stop"
        )
    task = {name: getattr(options, name) for name in ("poses", "path", "sort")}
    if any(each is not None for each in task.values()):
        given |= task
    arm = options.arm if is_other(options.arm) else given["arm"]
    own = str(Path(arm).resolve()) if Path(arm).suffix.lower() in ENDINGS else arm
    machine = options.machine or given.get("machine") or "ideal"
    machine = str(Path(machine).resolve()) if machine.endswith(".toml") else machine
    words = ["--kind", own, "--machine", machine]
    for name in task:
        if (file := given.get(name)) is not None:
            words += [f"--{name}", str(file.resolve())]
    words += ["--late", str(options.late or given.get("late", 0)), "--seed", str(options.seed)]
    words += [word for text in (*given.get("faults", ()), *options.fault) for word in ("--fault", text)]
    return OtherArm(key=Path(arm).stem, words=tuple(words))


def programs_of(other: OtherArm, options: Any, link: list[str], console: int, heard: Path) -> list[Program]:
    """The services in the order to be started; the blocks run in the bridge.

    Args:
        other: the arm.
        options: options of `dtwin up`.
        link: words that join a service to the bus.
        console: port of the console.
        heard: folder in which the monitor keeps what it hears.
    """
    lossless = ["--lossless"] if options.pace != "realtime" else []
    programs, waits = [], []
    if options.log:
        programs.append(_service("recorder", [*link, *other.words, "--log", str(options.log.resolve())]))
        waits = ["--wait-for", "recorder"]
    if options.monitoring:
        stop = ["--safe-stop"] if options.safe_stop else []
        healthy = [] if options.healthy is None else ["--healthy", str(options.healthy)]
        known = [] if options.commissioned is None else ["--commissioned", str(options.commissioned.resolve())]
        keep = ["--heard", str(heard)]
        programs.append(_service("monitoring", [*link, *other.words, *known, *healthy, *keep, *stop]))
    if options.recovery is not None:
        history = history_of(Path(options.history), other.key)
        proposals = history.with_name(f"{history.stem}-proposals.jsonl").resolve()
        mode = ["--mode", options.recovery, "--proposals", str(proposals)]
        programs.append(_service("recovery", [*link, *other.words, *mode]))
    if options.identification:
        store = ["--store", str(options.store.resolve())]
        programs.append(_service("identification", [*link, *other.words, *store]))
    if options.simulation:
        file = ["--history", str(history_of(Path(options.history), other.key).resolve())]
        programs.append(_service("simulation", [*link, *other.words, *file]))
    if options.console:
        programs.append(_service("console", [*link, *other.words, *_console_options(other, options, console)]))
    if options.safe_stop:  # The arm does not move before it is watched.
        waits += ["--monitored", str(options.silence), "--wait-for", "monitoring"]
    device = [] if options.controller == EMBEDDED else ["--controller", options.controller.partition("://")[2]]
    programs.append(_service("bridge", [*link, *other.words, *lossless, *waits, *device]))
    emulator = [*link, *other.words, "--pace", options.pace, *awaited(programs, options.pace)]
    emulator += [] if options.duration is None else ["--duration", str(options.duration)]
    return [*programs, _service("emulator", emulator, leading=True)]


def awaited(programs: list[Program], pace: Pace) -> list[str]:
    """Words by which an emulator begins when those are there that its first ticks are for.

    Each process finds the others by itself: who is there for the bridge need not be there for the emulator yet.
    Ticks of the wall clock wait for the bridge alone.
    """
    names = {"bridge"} if pace == "realtime" else {"bridge", "recorder", "monitoring"}
    return [word for each in programs if each.name in names for word in ("--wait-for", each.name)]


def _console_options(other: OtherArm, options: Any, port: int) -> list[str]:
    files = {
        "--store": options.store,
        "--history": history_of(Path(options.history), other.key),
        "--audit": AUDIT,
        "--alarms": ALARMS,
    }
    return ["--port", str(port), *(word for name, file in files.items() for word in (name, str(file.resolve())))]


def history_of(history: Path, key: str) -> Path:
    """The file of the history of an arm's settings beside that of the settings of the thesis's arm."""
    return history.with_name(f"{history.stem}-{key}{history.suffix}")


def _service(name: str, options: list[str], leading: bool = False) -> Program:
    return Program(name, [sys.executable, "-m", f"dtwin.services.chain.{name}", *options], leading)


def _has_arm(cell_file: str) -> bool:
    from dtwin.run.cell_file import content_of

    return isinstance(content_of(cell_file)[1].get("arm"), str)
