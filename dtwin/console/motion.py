"""The motion of an arm as samples, commands and the monitor's residuals tell it."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from typing import Final

from dtwin.bus.following import Following, following_ticks
from dtwin.bus.messages import ACTED, PATH, RESIDUALS, SENSORS, TICKS, VOLTAGES, Acted, PassedTicks, Path
from dtwin.bus.pairs import Pairs
from dtwin.bus.session import Bus, Subscription
from dtwin.bus.ticks import Tick
from dtwin.bus.twin_messages import MonitoringResiduals
from dtwin.bus.verdicts.opinion import Opinion
from dtwin.console.clocks import Clocks
from dtwin.console.excited import ExcitedMotion
from dtwin.console.telling import Frame
from dtwin.signals import Sensors, Voltages

BEHIND: Final = 50
"""Number of samples by which the last one with a path may be older than the last one."""
SILENT: Final = 3.0
"""Time without a word of a service after which its last word does not count any more, s."""
KEPT_EVERY: Final = 0.1
"""Time between two frames that are kept for replays, s."""


class Motion:
    """How an arm moves; of one of which nothing is heard, no time is known.

    What comes over the bus is put into attributes by Zenoh's threads; each is replaced as a whole, so a reader sees
    the old or the new one.

    Args:
        bus: session on which the motion is followed.
        clocks: clocks of the console.

    Attributes:
        keep: takes ten frames a second, on one of Zenoh's threads.
        opinion: the monitor's last verdict, which counts as long as it knows the samples.
        followed: subscriptions to every sample, none while a page is not open.
    """

    def __init__(self, bus: Bus, clocks: Clocks) -> None:
        self.keep: Callable[[Frame], object] = lambda frame: None
        self.opinion = Opinion()
        self.followed: list[Subscription] = []
        self._bus, self._clocks = bus, clocks
        self._pairing = threading.Lock()
        self._arrival: tuple[float, float] | None = None
        self._due = -math.inf

    @property
    def age(self) -> float | None:
        """Time since the last sample arrived, s; None before the first one."""
        return None if self._arrival is None else self._clocks.steady() - self._arrival[0]

    @property
    def boxes(self) -> tuple[str, str]:
        """Colours of the box in the gripper and of the box that waits, "" for none."""
        return "", ""

    def frame(self) -> Frame:
        """The arm as it was last heard of."""
        return Frame()

    def listen(self) -> None:
        """Subscribes to what is published whether a page is open or not."""

    def follow(self, wanted: bool) -> bool:
        """Has every sample sent at once or not, which costs all who send them time; whether that is a change."""
        if wanted == bool(self.followed):
            return False
        for subscription in self.followed:
            subscription.end()
        self.followed = self._subscriptions() if wanted else []
        return True

    def _subscriptions(self) -> list[Subscription]:
        """Subscriptions to every sample and to what answers it."""
        return []

    def _ages(self, before: float) -> tuple[float, float]:
        """Time since the last sample arrived, s, and the wall time at which one arrived that is some seconds older,
        ms since 1970."""
        steady, wall = self._arrival or (0.0, 0.0)
        return round(max(0.0, self._clocks.steady() - steady), 3), round(1e3 * (wall - before), 1)

    def _arrived(self, time: float) -> None:
        """A sample of a plant time, s, has arrived."""
        now = self._clocks.steady()
        self._arrival = now, self._clocks.wall()
        self.opinion.sample(time, now)
        if now >= self._due:
            self._due = max(self._due + KEPT_EVERY, now)
            self.keep(self.frame())


class CellMotion(Motion):
    """How the arm of the cell moves.

    Args:
        bus: session on which the motion is followed.
        clocks: clocks of the console.
        excited: remembers the motion of an identification.
    """

    def __init__(self, bus: Bus, clocks: Clocks, excited: ExcitedMotion) -> None:
        super().__init__(bus, clocks)
        self._excited = excited
        self._sensors: Sensors | None = None
        self._acted: Voltages | Acted | None = None
        self._pairs: Pairs[Sensors, Path] = Pairs()
        self._on_path: tuple[Sensors, Path] | None = None
        self._residuals: MonitoringResiduals | None = None
        self._colours = ("", "")

    @property
    def boxes(self) -> tuple[str, str]:
        """Colours of the box in the gripper and of the box that waits, "" for none."""
        waiting, held = self._colours
        return (held if self._acted is not None and self._acted.box_gripped else ""), waiting

    def frame(self) -> Frame:
        """The arm as it was last heard of."""
        newest, acted, residuals = self._sensors, self._acted, self._residuals
        if newest is None:
            return Frame()
        # An angle and a path of two samples would look like a distance from the path.
        sensors, path = self._on_path or (newest, None)
        age, heard = self._ages(newest.time - sensors.time)
        watched = residuals if residuals and sensors.time - residuals.time < SILENT else None
        return Frame(
            sensors.time,
            age,
            heard,
            sensors.theta,
            None if path is None else path.theta,
            None if acted is None else acted.volts,
            sensors.gripper,
            acted is not None and acted.box_gripped,
            sensors.box_colour if sensors.box_present else "",
            None if watched is None else watched.predicted,
            None if watched is None else watched.residual,
            None if watched is None else watched.deviation,
            None if watched is None else watched.evidence,
            None if watched is None else watched.threshold,
        )

    def listen(self) -> None:
        """Subscribes to ticks, which come ten times a second, and to the monitor's residuals."""
        self._bus.subscribe(TICKS, PassedTicks, following_ticks(self._take_ticks, self._bus.refuse))
        self._bus.subscribe(RESIDUALS, MonitoringResiduals, self._take_residuals)

    def follow(self, wanted: bool) -> bool:
        """Has every sample, its command and the path sent at once or not; whether that is a change."""
        changed = super().follow(wanted)
        if not self.followed:
            self._on_path = None
        return changed

    def _subscriptions(self) -> list[Subscription]:
        subscribe = self._bus.subscribe
        return [
            subscribe(PATH, Path, self._take_path),
            subscribe(VOLTAGES, Voltages, self._take_acted),
            subscribe(ACTED, Acted, self._take_acted),
            subscribe(SENSORS, Sensors, Following(self._take_sensors, self._bus.refuse)),
        ]

    def _take_ticks(self, ticks: list[Tick]) -> None:
        self._excited.extend(ticks)
        if not self.followed:
            for sensors, acted in ticks:
                self._note_colours(sensors)
                self._acted = acted
            self._note_newest(ticks[-1][0])

    def _take_sensors(self, sensors: Sensors) -> None:
        self._note_newest(sensors)
        with self._pairing:
            pair = self._pairs.first(sensors)
        if pair is not None and self.followed:
            self._on_path = pair
        elif self._on_path is not None and sensors.sequence - self._on_path[0].sequence not in range(BEHIND):
            self._on_path = None
        self._note_colours(sensors)

    def _note_newest(self, sensors: Sensors) -> None:
        self._sensors = sensors
        self._arrived(sensors.time)

    def _note_colours(self, sensors: Sensors) -> None:
        waiting, held = self._colours
        if self._acted is None or not self._acted.box_gripped:
            held = waiting  # A box is held from the tick on in which it no longer waits.
        waiting = sensors.box_colour if sensors.box_present else ""
        self._colours = (waiting, held or waiting)

    def _take_acted(self, acted: Voltages | Acted) -> None:
        self._acted = acted

    def _take_path(self, path: Path) -> None:
        with self._pairing:
            pair = self._pairs.second(path)
        if pair is not None and self.followed:
            self._on_path = pair

    def _take_residuals(self, residuals: MonitoringResiduals) -> None:
        self._residuals = residuals
