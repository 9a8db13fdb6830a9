"""How the path of the application goes on from the last sample that it answered to the next one."""

from __future__ import annotations

import logging

import msgspec

from dtwin.bus.messages import Acted
from dtwin.controller.device import ControlLoop
from dtwin.services.parts.gate import STALE
from dtwin.services.parts.recent import Recent
from dtwin.services.parts.strides import GAP, strides
from dtwin.signals import Event, EventKind, Sensors, Voltages

log = logging.getLogger(__name__)


class Continuation:
    """Answers samples so that the path goes on, or is planned anew where the arm is not where its path is.

    Samples that were missed are made up for in strides. After a longer gap, and after a time without voltage, the
    path is planned anew, as soon as the arm is slow enough to be caught.

    Attributes:
        recent: the last samples without a gap; whoever receives samples adds them.
    """

    def __init__(self) -> None:
        self.recent = Recent()
        self._before: Sensors | None = None
        self._interrupted = False
        self._newest = 0.0
        self._unpowered = 0
        self._unpowered_at = -1

    def note_sample(self, sensors: Sensors) -> None:
        """Takes note of a sample that has come, whether it will be answered or not."""
        self._newest = sensors.time

    def note_event(self, event: Event) -> None:
        """Takes note when the arm has lost its voltage; the emulator says so at the time of its last sample."""
        if event.kind == EventKind.SAFE and abs(event.time - self._newest) <= STALE:
            self._interrupted = True

    def note_acted(self, acted: Acted, stopped: bool) -> bool:
        """Counts the ticks in a row in which the arm had no voltage though nobody had stopped it.

        Returns:
            Whether it has just become so many that the arm is not where its path is.
        """
        if any(acted.volts) or stopped or abs(acted.time - self._newest) > STALE:
            self._unpowered = 0
            return False
        self._unpowered = self._unpowered + 1 if acted.sequence == self._unpowered_at + 1 else 1
        self._unpowered_at = acted.sequence
        return self._unpowered == GAP

    def interrupt(self) -> None:
        """The controller is gone: another one plans its path anew."""
        self._interrupted = True

    def answer(self, controller: ControlLoop, sensors: Sensors) -> Voltages | None:
        """The answer of a controller to a sample; None while the arm is too fast for any path.

        Raises:
            CommunicationError: the controller does not answer.
        """
        before = self._before
        if before is None and sensors.sequence > GAP:
            self._take_over(controller, sensors)
        elif before is not None and not 0 < sensors.sequence - before.sequence <= GAP:
            self._interrupted = True
        if self._interrupted or self._has_fallen(sensors):
            if self.recent.falls():
                return None
            recent = list(self.recent.samples)
            controller.restart(self._way(sensors, recent[0]), recent)
            self._interrupted, self._unpowered = False, 0
            log.warning("path planned anew at %.2f s after a gap", sensors.time)
        else:
            for step in self._way(sensors, sensors):
                controller.answer(step)
        return controller.answer(sensors)

    def answered(self, sensors: Sensors) -> None:
        """A sample has been answered, and the answer has been published."""
        self._before = sensors

    def _take_over(self, controller: ControlLoop, sensors: Sensors) -> None:
        """Goes on where an earlier bridge was, as far as the application tells; one that is new tells nothing."""
        theta = controller.last_angles()
        if theta is not None:
            self._before = msgspec.structs.replace(sensors, sequence=0, theta=theta)
            self._interrupted = True

    def _has_fallen(self, sensors: Sensors) -> bool:
        """Whether the arm has been without voltage for so long that it is not where its path is."""
        return self._unpowered >= GAP and abs(sensors.sequence - self._unpowered_at) <= 1

    def _way(self, sensors: Sensors, to: Sensors) -> list[Sensors]:
        """Samples that lead the application from the last answer to a sample of the same arm.

        All at once it would let go of its box, even after a few ticks if the arm was thrown about. A sample with a
        lower number is another arm's, or that of one that started anew.
        """
        before = self._before
        if before is None or sensors.sequence <= before.sequence or to.sequence == before.sequence + 1:
            return []
        return strides(before, to)
