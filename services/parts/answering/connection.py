"""The connection to a controller, which has the settings of this run before it answers a sample."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable
from typing import Final, TypeVar

from dtwin.bus.messages import SettingsRequest
from dtwin.controller.device import ControlLoop, SafeStop, Settings
from dtwin.controller.ports import GROUPS
from dtwin.controller.sequence import SequenceSettings
from dtwin.controller.settings import ControlSettings
from dtwin.errors import CommunicationError, DtwinError, RecordingError
from dtwin.services.parts.state_file import StateFile, changed
from dtwin.signals import EventKind
from iec61499.net.address import StreamAddress

log = logging.getLogger(__name__)

RETRY: Final = 0.2
"""Time between two attempts to reach the controller, s."""
PATIENCE: Final = 3.0
"""Time without a controller that is no trouble yet, because it may be starting again, s."""
FIRST_PATIENCE: Final = 15.0
"""The same before the first controller, which starts beside all other services, s."""
T = TypeVar("T")


class Connection:
    """Looks for a controller, gives it the settings that were in force, and asks it on behalf of several threads.

    Args:
        address: device management of the controller.
        patience: longest wait for an answer to a sample, s.
        state: settings that are kept; those of the first controller if there are none yet.
        sequence: sequence in which boxes are fetched, which every controller gets.
        announce: receives what happened, as the kind and the text of an event.
    """

    def __init__(
        self,
        address: StreamAddress,
        patience: float,
        state: StateFile,
        sequence: SequenceSettings,
        announce: Callable[[EventKind, str], None],
    ) -> None:
        self._address = address
        self._patience = patience
        self._state = state
        self._sequence = sequence
        self._announce = announce
        self._controller: ControlLoop | None = None
        self._lock = threading.Lock()
        self._try_at = 0.0
        self._looking_since = math.inf
        self._trouble = ""

    @property
    def there(self) -> bool:
        """Whether there is a controller."""
        return self._controller is not None

    def open(self, found: Callable[[], None]) -> ControlLoop | None:
        """The controller, which is looked for if there is none, at most every RETRY seconds; None without one.

        Args:
            found: called when a controller has been found.
        """
        if self._controller is not None:
            if not self._controller.lost:
                return self._controller
            self.close()  # A setting has failed: samples may still be answered, but nothing can be set any more.
        now = time.monotonic()
        if now >= self._try_at:
            self._try_at = now + RETRY
            try:
                self._controller = self._with_settings()
                self._looking_since = math.inf
                self._trouble = ""
                found()
            except DtwinError as error:
                self._looking_since = min(self._looking_since, now)
                if now - self._looking_since < (FIRST_PATIENCE if self._state.settings is None else PATIENCE):
                    log.info("%s", error)
                else:
                    self._complain(f"no sample is answered: {error}")
        return self._controller

    def close(self) -> None:
        """Gives the controller up."""
        if self._controller is not None:
            self._controller.close()
            self._controller = None

    def do(self, action: Callable[[ControlLoop], T]) -> T:
        """Reads or changes settings, on other connections than the samples, which do not wait for them.

        Raises:
            CommunicationError: there is no controller, or it does not answer.
        """
        with self._lock:
            return action(self._present())

    def change(self, asked: SettingsRequest) -> ControlSettings:
        """Changes settings, keeps them, and returns those in force.

        Raises:
            CommunicationError: there is no controller, or it does not answer.
            ParameterError: a value is out of range, or it is not one message that is asked for.
        """

        def change(controller: ControlLoop) -> ControlSettings:
            found = changed(controller.settings, asked)
            self._keep(found)
            return found

        return self.do(change)

    def safe_stop(self) -> SafeStop:
        """The safe stop of the controller.

        Raises:
            CommunicationError: there is no controller.
        """
        return self._present().safe_stop

    def save(self) -> None:
        """Writes settings that are kept in memory alone.

        Raises:
            RecordingError: the file cannot be written.
        """
        self._state.save()

    def _present(self) -> ControlLoop:
        controller = self._controller
        if controller is None:
            raise CommunicationError(f"{self._address}: the bridge has no controller at present")
        return controller

    def _with_settings(self) -> ControlLoop:
        """A controller with the settings that were in force."""
        controller = ControlLoop(self._address, self._patience)
        try:
            with self._lock:
                self._restore(controller.settings)
        except DtwinError:
            controller.close()
            raise
        return controller

    def _restore(self, settings: Settings) -> None:
        """Puts the kept settings in force, or keeps those that are if there are none yet.

        Raises:
            DtwinError: the controller does not take them, or has others that cannot be changed while it runs.
        """
        given = settings.put_sequence(self._sequence)
        found = settings.in_force()
        kept = self._state.settings
        if kept is None:
            self._keep(found)
            return
        lost = kept.differing(found)
        for group in GROUPS:
            if lost & set(group):
                found = settings.put(group, kept)
        if other := kept.differing(found):
            raise CommunicationError(
                f"{self._address}: expected the settings of this run, got others of {', '.join(sorted(other))}: "
                "deploy the application with the options of this run"
            )
        if lost := lost | given:
            text = f"the controller has got its settings again: {', '.join(sorted(lost))}"
            log.info("%s", text)
            self._announce(EventKind.RESTORED, text)

    def _keep(self, found: ControlSettings) -> None:
        """Keeps settings that have come into force, in memory alone while the file cannot be written."""
        try:
            self._state.keep(found)
        except RecordingError as error:
            self._complain(f"the settings in force may not outlive the bridge: {error}")

    def _complain(self, text: str) -> None:
        """Says what is wrong in the status, and once in an event."""
        log.warning("%s", text)
        if text != self._trouble:
            self._trouble = text
            self._announce(EventKind.TROUBLE, text)
