"""A cell in one of its settings, an operator who has its key, and somebody on its bus who has not."""

from __future__ import annotations

import contextlib
import math
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Literal

from dtwin.bus.messages import EVENTS, LATCH, SENSORS, STATUS, STOP, TOPICS, LatchState, Status, StopState
from dtwin.bus.opening import open_configured, open_peer
from dtwin.bus.session import Bus
from dtwin.errors import CommunicationError, DtwinError
from dtwin.parameters import ROOT
from dtwin.services.parts.launched import READY_TIMEOUT
from dtwin.services.runfile import find, join, require
from dtwin.services.service import free_port
from dtwin.signals import Event, EventKind, Sensors
from evidence.soak.cell import wait

Setting = Literal["default", "routed", "secured"]
SETTINGS: Final[tuple[Setting, ...]] = ("default", "routed", "secured")
RECORDER: Final = "recorder"
"""Whose certificate the stranger has in a secured cell: one that may watch, and no more."""
TOLD: Final = 3.0
"""s in which the statuses tell of what was refused"""
OBEYED: Final = 10.0
"""Speed of a joint that tells that the arm has obeyed a stranger, rad/s."""
_HELD: Final = 200
"""Number of samples that are kept."""
_TELLING: Final = {EventKind.FAULT, EventKind.SAFE, EventKind.STOP, EventKind.DIVERGED, EventKind.RESTORED}
"""Events that tell that something has been changed, if nobody of the cell did it."""


class Stage:
    """A cell that is up, to be attacked; a context manager.

    Args:
        setting: how its services are joined.
        folder: for its configuration.
        name: of the cell, of no other one on this machine.

    Attributes:
        setting: how its services are joined.
        folder: for its configuration.
        name: of the cell.
        port: of its router.
        operator: session with the cell's key.
        stranger: session of somebody who does not know it.
        overheard: payload and attachment of what the stranger has heard, the newest last, by key.

    Raises:
        CommunicationError: the cell does not come up.
    """

    def __init__(self, setting: Setting, folder: Path, name: str) -> None:
        self.setting = setting
        self.folder = folder
        self.name = name
        self.port = free_port()
        self.overheard: dict[str, deque[tuple[bytes, bytes]]] = {}
        self._events: list[Event] = []
        self._samples: deque[Sensors] = deque(maxlen=_HELD)
        self._refused: dict[str, int] = {}
        self._heard: set[str] = set()
        self._stack = contextlib.ExitStack()
        try:
            self._start_up()
        except BaseException:
            self._stack.close()
            raise

    def __enter__(self) -> Stage:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def _start_up(self) -> None:
        options = [] if self.setting == "default" else ["--zenoh", str(self.folder)]
        if self.setting != "default":
            self._configure()
            self._start("dtwin.services.router", "--zenoh", str(self.folder))
        # In lockstep no busy machine makes the arm safe: what shows is the stranger's doing.
        up = self._start("dtwin", "up", "--json", "--cell", self.name, "--pace", "lockstep", *options)

        def is_ready() -> bool:
            found = find(self.name)
            return found is not None and found.ready

        if not wait(lambda: up.poll() is not None or is_ready(), READY_TIMEOUT) or up.poll() is not None:
            raise CommunicationError(f"the {self.setting} cell does not come up")
        self.operator = self._stack.enter_context(join(self.name))
        self.stranger = self._stack.enter_context(self.session())
        self.operator.subscribe(EVENTS, Event, self._events.append)
        self.operator.subscribe(SENSORS, Sensors, self._samples.append)
        self.operator.subscribe(STATUS, Status, self._note)
        self.stranger.declare_subscriber(f"dtwin/{self.name}/**", self._overhear)
        if not wait(lambda: len(self._samples) > 1 and self._refused.keys() >= {"bridge", "emulator"}, TIMEOUT):
            raise CommunicationError(f"the {self.setting} cell does not work")

    def _start(self, *words: str) -> subprocess.Popen[bytes]:
        with (self.folder / "said.log").open("ab") as output:
            process = subprocess.Popen([sys.executable, "-m", *words], cwd=ROOT, stdout=output, stderr=output)
        self._stack.callback(process.wait)
        self._stack.callback(process.terminate)
        return process

    def _configure(self) -> None:
        """Writes the shipped configuration of the setting for this cell, at a free port."""
        if self.setting == "secured":
            script = ROOT / "scripts" / "secured-cell"
            made = subprocess.run([script, self.folder, self.name], capture_output=True, text=True, check=False)
            if made.returncode:
                raise CommunicationError(f"{script}: {made.stderr.strip()}")
        source = self.folder if self.setting == "secured" else ROOT / "config" / self.setting
        for file in source.glob("*.json5"):
            text = file.read_text().replace("7447", str(self.port)).replace("0.0.0.0", "127.0.0.1")
            (self.folder / file.name).write_text(text)

    def session(self) -> Any:
        """Another session of the stranger."""
        if self.setting == "default":
            return open_peer(require(self.name).meet)
        return open_configured(self.folder, RECORDER)

    def key(self, topic: str) -> str:
        """The key of a topic of this cell."""
        return f"dtwin/{self.name}/arm/{topic}"

    def _overhear(self, sample: Any) -> None:
        attachment = sample.attachment
        heard = self.overheard.setdefault(str(sample.key_expr), deque(maxlen=_HELD))
        heard.append((sample.payload.to_bytes(), b"" if attachment is None else attachment.to_bytes()))

    def _note(self, status: Status) -> None:
        self._refused[status.service] = sum(status.refused.values())
        self._heard.add(status.service)

    def refused(self) -> int:
        """Number of messages refused so far, as the services and the operator's session tell."""
        return sum(self._refused.values()) + self.operator.refused.total()

    def settled(self) -> int:
        """The same once the services have told of all that came before."""
        self._heard.clear()
        wait(lambda: self._heard >= {"bridge", "emulator"}, TOLD)
        return self.refused()

    def shown(self) -> str:
        """What the cell should not show, "" for nothing: a stop, a fault, a fast joint, a cell that stands still."""
        latch = self.operator.ask(LATCH, None, LatchState)
        stop = self.operator.ask(STOP, None, StopState).stop
        if (latch.stop, stop) != ("none", "none"):
            return f"stopped: {latch.stop} in the emulator, {stop} in the blocks"
        told = [event for event in self._events if event.kind in _TELLING]
        self._events.clear()
        if told:
            return f"told: {told[0].text}"
        fastest = max((_speed(a, b) for a, b in pairwise(list(self._samples))), default=math.inf)
        if fastest > OBEYED:
            return f"a joint moves at {fastest:.3g} rad/s"
        last = self._samples[-1].sequence
        return "" if wait(lambda: self._samples[-1].sequence > last, TIMEOUT) else "the cell stands still"

    def forget(self) -> None:
        """Forgets what has been told so far, which the operator did."""
        self._events.clear()

    def send(self, topic: str, payload: bytes, attachment: bytes | None = None) -> list[str]:
        """What is answered to a query of the stranger: "ok", or the words of an error."""
        found = self.stranger.get(self.key(topic), payload=payload, attachment=attachment, timeout=1.0)
        return ["ok" if r.ok else "" if r.err is None else r.err.payload.to_string() for r in found]

    @contextlib.contextmanager
    def answering(self, topic: str, reply: Callable[[Any], object]) -> Iterator[list[bytes]]:
        """While the stranger answers a topic, or `**`, and says that his answers are complete; what he is asked."""
        seen: list[bytes] = []
        key = f"dtwin/{self.name}/**" if topic == "**" else self.key(topic)

        def intercept(query: Any) -> None:
            seen.append(b"" if query.attachment is None else query.attachment.to_bytes())
            with contextlib.suppress(Exception):  # Zenoh may have cut him off.
                reply(query)

        with self.session() as session:
            session.declare_queryable(key, intercept, complete=True)

            def is_asked() -> bool:
                """The operator's session may not know of him yet."""
                with contextlib.suppress(CommunicationError):
                    asked = STOP if topic == "**" else next(known for known in TOPICS if known.name == topic)
                    assert asked.reply is not None
                    self.operator.ask(asked, None, asked.reply, 1.0)
                return bool(seen)

            denied = self.setting == "secured"  # The router does not let him answer.
            if not (denied or wait(is_asked, TIMEOUT)):
                raise CommunicationError("the stranger is not asked")
            yield seen


TIMEOUT: Final = 20.0
"""Longest wait for a cell that works, s."""


def _speed(before: Sensors, after: Sensors) -> float:
    """Mean speed of the fastest joint between two samples, rad/s; 0 when the cell has begun anew between them."""
    ahead = max(abs(b - a) for a, b in zip(before.theta, after.theta, strict=True))
    return ahead / (after.time - before.time) if after.time > before.time else 0.0


def refuses(action: Callable[[], object]) -> bool:
    """Whether an action ends in an error of this project."""
    try:
        action()
    except DtwinError:
        return True
    return False


def named_bus(stage: Stage, key: bytes | None) -> Bus:
    """Another session of the stranger as one of the cell, with a key of his own or without."""
    return Bus(stage.session(), stage.name, "arm", key)


def pause(seconds: float) -> None:
    """Lets a time of the attack pass, s."""
    time.sleep(seconds)
