"""The signal that the blocks excite an empty arm with, from its request to the experiment."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

from dtwin.bus.following import Following
from dtwin.bus.messages import ACTED, SENSORS, SIGNAL, VOLTAGES, Acted, IdentificationSignal, SignalRequest
from dtwin.bus.session import Bus, Subscription
from dtwin.signals import Sensors, Voltages

if TYPE_CHECKING:
    from dtwin.identification.collector import SignalCollector
    from dtwin.identification.data import Experiment

PROGRESS: Final = 50
"""ticks between two messages about progress, and between two looks at the motions that have passed"""


class SignalMeasurement:
    """Waits for an empty gripper, has the signal played, and finds it among what passes.

    Args:
        bus: session on which samples and commands are followed meanwhile.
        put: takes each of them, to be given to `take` by the thread that works with them.

    Attributes:
        experiment: what was measured; None before the signal is over.
    """

    def __init__(self, bus: Bus, put: Callable[[Any], None]) -> None:
        self._bus = bus
        self._put = put
        self._box_mass = 0.0
        self._waits = False
        self._collector: SignalCollector | None = None
        self._followed: list[Subscription] = []
        self._heard: set[type] = set()
        self.experiment: Experiment | None = None

    @property
    def active(self) -> bool:
        """Whether samples and commands are followed."""
        return bool(self._followed)

    @property
    def done(self) -> int:
        """Number of commands of the signal that have come so far."""
        return 0 if self._collector is None else self._collector.done

    @property
    def samples(self) -> int:
        """Length of the signal, ticks; 0 before it is played."""
        return 0 if self._collector is None else self._collector.samples

    def begin(self, box_mass: float) -> None:
        """Follows samples and commands, and has the signal played as soon as the gripper is empty.

        Args:
            box_mass: mass assumed for a box that is held meanwhile, kg.
        """
        self.end()
        self._box_mass, self._waits, self.experiment = box_mass, True, None
        subscribe = self._bus.subscribe
        self._followed = [
            subscribe(ACTED, Acted, self._put),
            subscribe(VOLTAGES, Voltages, self._put),
            subscribe(SENSORS, Sensors, Following(self._put, self._bus.refuse)),
        ]

    def end(self) -> None:
        """Follows nothing any more."""
        self._waits, self._collector = False, None
        for subscription in self._followed:
            subscription.end()
        self._followed = []
        self._heard.clear()

    def take(self, message: Sensors | Voltages | Acted) -> bool:
        """Takes what passes; whether there is news: the signal begins, is some way further, or is over.

        Raises:
            CommunicationError: the blocks do not answer, or refuse the signal.
            IdentificationError: samples or too many commands are missing, or a command is not that of the signal.
        """
        self._heard.add(type(message))
        if self._collector is not None:
            return self._collect(self._collector, message)
        # What is heard of both senders now is not missed when the signal begins.
        if self._waits and isinstance(message, Voltages) and not message.box_gripped and Sensors in self._heard:
            self._excite()
            return True
        return False

    def _excite(self) -> None:
        """Asks the blocks for the signal."""
        from dtwin.identification.collector import SignalCollector  # loads what fits need
        from dtwin.identification.excitation.plan import Excitation

        self._waits = False
        signal = self._bus.ask(SIGNAL, None, IdentificationSignal)
        excitation = Excitation(signal.amplitude, signal.unit, signal.delay)
        self._collector = SignalCollector(excitation, signal.samples, self._box_mass)
        self._bus.ask(SIGNAL, SignalRequest(True), IdentificationSignal)

    def _collect(self, collector: SignalCollector, message: Sensors | Voltages | Acted) -> bool:
        before = collector.done
        collector.add(message)
        if collector.complete:
            self.end()
            self.experiment = collector.experiment()
            return True
        return collector.done != before and collector.done % PROGRESS == 0
