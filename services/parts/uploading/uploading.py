"""Gives a running controller other settings for whoever asks on the bus, and tells what comes of them."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Any, Final, Generic, NoReturn, TypeVar

import msgspec

from dtwin.bus.chain.messages import JointUploadRequest
from dtwin.bus.messages import ARM_ROLL_BACK, ARM_UPLOAD, EVENTS, ROLL_BACK, UPLOAD
from dtwin.bus.session import Bus
from dtwin.bus.topics.topic import Topic
from dtwin.bus.twin_messages import RollBackRequest, UploadRequest
from dtwin.errors import CommunicationError, DtwinError, ParameterError
from dtwin.parameters import JointVector
from dtwin.services.service import Service
from dtwin.settings.change import Change, Proposal, S, asked_of
from dtwin.signals import Event, EventKind
from dtwin.simulation.upload import E, Uploader

log = logging.getLogger(__name__)

M = TypeVar("M", bound=msgspec.Struct)
Asked = UploadRequest | JointUploadRequest
RETRY: Final = 0.2
"""Time between two attempts to reach the controller, s."""
_STARTING: Final = "the simulation service is not ready yet: `dtwin status` shows what it does"
_DOORS: Final = ((UPLOAD, UploadRequest, ROLL_BACK), (ARM_UPLOAD, JointUploadRequest, ARM_ROLL_BACK))
"""Topics and messages by which others ask for settings, of the thesis's arm and of any other one."""
_SETTINGS: Final = ("gains", "target_time", "payload", "encoder_offset", "model", "tuning", "version")
"""What these messages ask for."""


class BridgePort(Generic[S, M]):
    """The running controller as uploads see it: through the bridge, which alone talks to it.

    Args:
        bus: session of the service.
        topic: topic of the settings of such a controller.
        reply: message in which the bridge tells them.
        found: the settings that it tells.
        request: the message that asks for one of the groups of some settings, for somebody and for a reason.
    """

    def __init__(
        self,
        bus: Bus,
        topic: Topic,
        reply: type[M],
        found: Callable[[M], S],
        request: Callable[[tuple[str, ...], S, str, str], msgspec.Struct],
    ) -> None:
        self._bus = bus
        self._topic = topic
        self._reply = reply
        self._found = found
        self._request = request

    def put(self, group: tuple[str, ...], settings: S, who: str, why: str) -> S:
        """Raises CommunicationError when the controller does not take them over."""
        return self._found(self._bus.ask(self._topic, self._request(group, settings, who, why), self._reply))

    def read_back(self) -> S:
        """Raises CommunicationError when the controller does not answer."""
        return self._found(self._bus.ask(self._topic, None, self._reply))


class Uploading(Generic[S, E, M]):
    """Uploads, one after another, to the controller of a cell.

    Args:
        service: frame of the service.
        kind: settings of the controller.
        time: gives the plant time, s.
        told: makes the answer that says what is in force.
        changed: called, while the lock is held, when settings may have changed, or a trial begun or ended.

    Attributes:
        lock: held while the uploader is used.
        done: number of the entries that were told.
    """

    def __init__(
        self,
        service: Service,
        kind: type[S],
        time: Callable[[], float],
        told: Callable[[Uploader[S, E]], M],
        changed: Callable[[], None],
    ) -> None:
        self.lock = threading.Lock()
        self.done = 0
        self._service = service
        self._kind = kind
        self._time = time
        self._told = told
        self._changed = changed
        self._uploader: Uploader[S, E] | None = None
        self._missing = _STARTING
        self.publish: Callable[[Event], None] = service.bus.publisher(EVENTS)

    def answer(self, topic: Topic, upload: Callable[[Any], M]) -> None:
        """Answers on the topic of uploads, and on that of roll backs; refuses by name what the others ask for."""
        bus = self._service.bus
        for door, request, roll_back in _DOORS:
            if door is topic:
                bus.answer(door, request, upload, self.now)
                bus.answer(roll_back, RollBackRequest, self._roll_back, self.now)
            else:
                bus.answer(door, request, self._refuse, self._refuse)
                bus.answer(roll_back, RollBackRequest, self._refuse, self._refuse)

    def find(
        self,
        make: Callable[[], Uploader[S, E]],
        found: Callable[[Uploader[S, E]], None] = lambda uploader: None,
    ) -> None:
        """Waits for the controller, unless the service is to end before.

        Args:
            make: makes the uploader; raises CommunicationError while there is no controller.
            found: what is done before the first upload.
        """
        service = self._service
        while not service.stopping:
            try:
                uploader = make()
            except CommunicationError as error:
                self._missing = f"the controller has not answered yet: {error}"
                log.info("%s", error)
                service.next(RETRY)
            else:
                self._missing = _STARTING
                found(uploader)
                self._uploader = uploader
                return
            if service.report_due():
                service.report("waiting")

    @property
    def on_trial(self) -> bool:
        """Whether settings are on trial."""
        return self._uploader is not None and self._uploader.trial is not None

    def there(self) -> Uploader[S, E]:
        """The uploader.

        Raises:
            CommunicationError: there is none yet; says why.
        """
        if self._uploader is None:
            raise CommunicationError(self._missing)
        return self._uploader

    def now(self) -> M:
        """What is in force, as it is told."""
        return self._told(self.there())

    def proposal(self, asked: Asked) -> Proposal[S]:
        """The change that a request stands for.

        Raises:
            ParameterError: it is no change of this controller's settings, or a version is not asked for alone.
        """
        values = {name: value for name, value in asked_of(self._kind, asked).items() if value is not None}
        if asked.version is None:
            change = Change.of(self._kind, values)
        elif values:
            raise ParameterError("upload: expected an earlier version alone, without other settings")
        else:
            change = self.there().earlier(asked.version)
        return Proposal(asked.who, asked.why, asked.based_on, change)

    def upload(self, asked: Asked, check: Callable[[S, S], JointVector] | None = None) -> M:
        """Uploads what a request asks for, and answers.

        Raises:
            ParameterError: it must not be uploaded.
            CommunicationError: the controller does not answer, or has not taken it over.
        """
        return self._change(lambda uploader: uploader.upload(self.proposal(asked), self._time(), check))

    def judge(self, act: Callable[[Uploader[S, E]], E | None]) -> None:
        """Lets the trial have a sample or a late command, while there is one, and tells when it ends."""
        uploader = self._uploader
        if uploader is None or uploader.trial is None:
            return
        with self.lock:
            try:
                entry = act(uploader)
            except DtwinError as error:
                log.error("%s", error)
                return
            if entry is not None:
                self._changed()
        if entry is not None:
            self._tell(entry)

    def look_again(self) -> None:
        """Looks whether the controller still has what is in force, and tells if not."""
        if (uploader := self._uploader) is None:
            return
        with self.lock:
            before = uploader.last
            try:
                if uploader.look_again(self._time()):
                    text = f"the controller has got version {uploader.version} of its settings again"
                    self.publish(Event(self._time(), EventKind.RESTORED, text))
            except DtwinError as error:
                log.warning("%s", error)
            if uploader.last is not before:
                self._changed()
                self._tell(uploader.last)

    def _refuse(self, asked: msgspec.Struct | None = None) -> NoReturn:
        names = [] if asked is None else [name for name in _SETTINGS if getattr(asked, name, None) is not None]
        raise ParameterError(
            f"{', '.join(names) or 'settings'}: not those of this controller: expected {self._kind.EXPECTED}"
        )

    def _roll_back(self, asked: RollBackRequest) -> M:
        return self._change(lambda uploader: uploader.roll_back(asked.who, asked.why, self._time()))

    def _change(self, action: Callable[[Uploader[S, E]], E]) -> M:
        uploader = self.there()
        with self.lock:
            before = uploader.last
            try:
                uploader.look_again(self._time())
                action(uploader)
            finally:
                self._changed()
                if uploader.last is not before:
                    self._tell(uploader.last)
            return self._told(uploader)

    def _tell(self, entry: E) -> None:
        self.done += 1
        of = f", {entry.kind}" if entry.kind else ""
        text = f"version {entry.version} of the settings{of}: {entry.text or entry.why}"
        log.info("%s: %s", entry.action, text)
        self.publish(Event(entry.time, EventKind(entry.action), text[:1000]))
