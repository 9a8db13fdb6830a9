"""The controller of an arm of n joints on the bus: function blocks in this process, a sample in, an answer out.

Samples that were missed are made up for on a straight line, so that the path goes on with the time of the plant.
After a longer gap, and when the arm has begun anew, other blocks begin from where it is.
"""

from __future__ import annotations

import logging
import sys
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Final

from dtwin.arm.adjustment import Adjustment
from dtwin.arm.model import ArmModel, ArmSettings
from dtwin.bus.chain.messages import JointAdjustment, JointCommands, JointModel, JointSensors
from dtwin.bus.messages import ADJUSTED, ADJUSTMENT, EVENTS, JOINT_COMMANDS, JOINT_SENSORS, MODEL, State
from dtwin.bus.session import Bus
from dtwin.console.people.desk import keep_desk
from dtwin.controller.application import TIMEOUT
from dtwin.controller.chain.application import inputs
from dtwin.controller.chain.embedded import ChainController
from dtwin.controller.chain.model import held_inputs
from dtwin.equations.rigid import usual_inertia
from dtwin.errors import CommunicationError, ParameterError
from dtwin.run.chain import ChainSettings
from dtwin.services.chain.device import DeviceBlocks, JudgedBlocks
from dtwin.services.chain.options import ArmCellOptions
from dtwin.services.parts.recent import Backlog
from dtwin.services.parts.rows import LOSSLESS_PATIENCE
from dtwin.services.parts.stopping.stops import Stops
from dtwin.services.parts.stopping.watchdog import Watchdog
from dtwin.services.parts.strides import GAP
from dtwin.services.service import Link, Service, main
from dtwin.signals import STOPS, ArmState, Event, EventKind, Stop
from dtwin.simulation.chain.checks import check_settings
from iec61499.net.address import Address, parse_address

log = logging.getLogger(__name__)

NAME: Final = "bridge"
_DATA_SHEET: Final = "the arm of the data sheet"
WAIT: Final = 0.2
"""Longest wait for a sample before the status is looked after, s."""

DOUBTED: Final = "the encoder of {joint} reads what cannot be true: look after it before the stop is released"
RECENT: Final = 1.0
"""Largest time from the last answer to an event that is about this arm as it is now, s."""


@dataclass(frozen=True, kw_only=True)
class Options(ArmCellOptions, Link):
    """Answer the samples of an arm by its function blocks."""

    lossless: bool = False
    """Wait for slow subscribers, as a lockstep run wants it."""
    monitored: float | None = None
    """Longest silence of the monitoring service while the arm moves, s; then the arm is stopped."""
    controller: str = ""
    """HOST:PORT of the device management of a 4diac FORTE that gets the blocks; in this process if not given."""

    def run(self) -> int:
        settings = self.settings()
        device = parse_address(self.controller) if self.controller else None
        with Service(NAME, self) as service:
            ArmBridge(service, settings, self.lossless, self.monitored, device).run()
        return 0


class ArmBridge:
    """Answers samples.

    Args:
        service: frame of this service.
        settings: run of the arm, with what its controller knows of it.
        lossless: whether to wait for slow subscribers.
        monitored: longest silence of the monitoring service while the arm moves, s; None if it needs no monitor.
        device: FORTE that gets the blocks; None for blocks in this process.
    """

    def __init__(
        self,
        service: Service,
        settings: ChainSettings,
        lossless: bool,
        monitored: float | None = None,
        device: Address | None = None,
    ) -> None:
        bus = service.bus
        self._service = service
        self._given = given = GivenSettings(settings, bus, self._time)
        self._blocks: Blocks = OwnBlocks(lambda: ChainController(len(settings.arm), given.inputs))
        if device is not None:
            patience = LOSSLESS_PATIENCE if lossless else TIMEOUT
            self._blocks = DeviceBlocks(device, len(settings.arm), lambda: given.inputs, patience)
        self._last: JointCommands | None = None
        self._before: JointSensors | None = None
        self._backlog = Backlog[JointSensors](service.next, lambda _: None)
        self._answered = self._doubted = 0
        self._fallen = False
        self._publish = bus.publisher(JOINT_COMMANDS, lossless=lossless)
        keep_desk(bus)
        bus.subscribe(EVENTS, Event, self._note)
        bus.subscribe(JOINT_SENSORS, JointSensors, service.inbox.put)
        self._stops = Stops(bus, self._publish.sender, lambda: self._blocks, self._time)
        given.serve(self._blocks, self._stops.answering)
        self._watchdog = None if monitored is None else Watchdog(bus, monitored, self._stops.demand)

    def run(self) -> None:
        """Works until it is asked to end."""
        service = self._service
        service.ready()
        self._given.tell()
        while not service.stopping:
            sample = service.next(WAIT)
            if sample is not None:
                with self._stops.answering:
                    self._answer(self._backlog.newest(sample))
            if self._watchdog is not None:
                self._watchdog.look(self._time(), self._answered, self._stops.stop != "none", time.monotonic())
            if service.report_due():
                stopped = self._stops.stop != "none"
                state: State = "waiting" if not self._stops.known else "stopped" if stopped else "running"
                service.report(state, self._answered, time=self._time(), late_ticks=self._backlog.skipped)
                self._given.tell()

    def _answer(self, sample: JointSensors) -> None:
        """Answers a sample; the same one has the same answer."""
        last, before = self._last, self._before
        if last is not None and (sample.sequence, sample.time) == (last.sequence, last.time):
            self._publish(last)
            return
        if not (self._stops.known or self._stops.remind()):
            return
        if len(sample.theta) != self._given.joints:
            log.warning("a sample has %d joints, expected %d", len(sample.theta), self._given.joints)
            return
        gap = 1 if before is None else sample.sequence - before.sequence
        if gap < 1:  # an arm that begins anew: its blocks do so, too, and may not forget a stop
            self._given.count_on_data_sheet()
            self._begin_anew(sample, "the arm has begun anew")
        elif gap > GAP or self._fallen:
            self._begin_anew(sample, "it was without torque" if self._fallen else f"{gap - 1} samples were missed")
        elif before is not None:
            for k in range(1, gap):
                self._blocks.step(_between(before, sample, k / gap))
        self._before = sample
        answer = self._blocks.step(sample)
        self._last = answer
        self._stops.notice(self._blocks.stop)
        self._doubt(sample)
        self._publish(answer)
        self._answered += 1

    def _doubt(self, sample: JointSensors) -> None:
        """Tells once which joint has stopped the arm by readings that its blocks do not believe."""
        doubted = self._blocks.doubted if self._blocks.stop != "none" else 0
        if doubted and doubted != self._doubted:
            joint = self._given.joint_name(doubted)
            self._given.say(Event(sample.time, EventKind.HELP, DOUBTED.format(joint=joint)))
        self._doubted = doubted

    def _begin_anew(self, sample: JointSensors, why: str) -> None:
        self._fallen = False
        self._blocks.restart()
        self._stops.renewed()
        self._stops.remind()
        self._given.say(Event(sample.time, EventKind.RESTORED, f"the blocks begin anew from where the arm is: {why}"))

    def _note(self, event: Event) -> None:
        """Takes note when the arm has lost its torque, after which it is not where its path is."""
        self._fallen |= event.kind == EventKind.SAFE and abs(event.time - self._time()) <= RECENT

    def _time(self) -> float:
        return 0.0 if self._last is None else self._last.time


class GivenSettings:
    """What blocks count on and reckon with, which others ask for and change while they work.

    Args:
        settings: run of the arm, whose data sheet they begin with.
        bus: session on which others ask.
        time: gives the time of the plant, s.

    Attributes:
        joints: number of joints of the arm.
        inputs: values of the inputs with which blocks begin.
        say: publishes an event about the blocks.
    """

    def __init__(self, settings: ChainSettings, bus: Bus, time: Callable[[], float]) -> None:
        self.joints = len(settings.arm)
        self.inputs = inputs(settings.arm, usual_inertia(settings.arm), settings.control, settings.poses)
        self._settings = settings
        self._bus = bus
        self._time = time
        self._adjustment = _data_sheet(self.joints)
        self._model = JointModel(NAME, _DATA_SHEET, ArmModel.of(settings.arm), settings.control.tuning)
        self.say: Callable[[Event], None] = bus.publisher(EVENTS)
        self._tell_adjusted: Callable[[JointAdjustment], None] = bus.publisher(ADJUSTED)

    def serve(self, blocks: Blocks, answering: AbstractContextManager[object]) -> None:
        """Answers who asks for what is in force, or changes it in blocks; `answering` keeps samples off them."""
        self._blocks, self._answering = blocks, answering
        self._bus.answer(ADJUSTMENT, JointAdjustment, self._adjust, lambda: self._adjustment)
        self._bus.answer(MODEL, JointModel, self._reckon, lambda: self._model)

    def tell(self) -> None:
        """Publishes what the blocks count on."""
        self._tell_adjusted(self._adjustment)

    def joint_name(self, number: int) -> str:
        """Name of a joint by its number from 1."""
        return self._settings.arm.joints[number - 1].name

    def count_on_data_sheet(self) -> None:
        """Lets the blocks count on nothing that was found."""
        self._put(_data_sheet(self.joints))

    def _adjust(self, wished: JointAdjustment) -> JointAdjustment:
        """Lets the blocks count on what was found, on Zenoh's thread.

        Raises:
            ParameterError: it is for another number of joints, or out of bounds.
        """
        if problem := wished.adjustment.problem(self._settings.arm):
            raise ParameterError(f"adjustment: {problem}")
        self._put(wished)
        self.say(Event(self._time(), EventKind.UPLOAD, f"{wished.who}: {wished.why}"[:1000]))
        return wished

    def _put(self, wished: JointAdjustment) -> None:
        self._blocks.adjust(wished.adjustment)
        self._adjustment = wished
        self._tell_adjusted(wished)

    def _reckon(self, wished: JointModel) -> JointModel:
        """Gives the blocks another model and tuning, between two samples, on Zenoh's thread.

        Raises:
            ParameterError: it is for another number of joints, or out of bounds.
        """
        arm = check_settings(self._settings, ArmSettings(wished.model, wished.tuning))
        inertia, control = usual_inertia(arm), self._settings.control.tuned(wished.tuning)
        changed, anew = held_inputs(arm, inertia, control), inputs(arm, inertia, control, self._settings.poses)
        with self._answering:
            another = self._model.model != wished.model
            self.inputs, self._model = anew, wished
            self._blocks.reckon_with(changed, another)
        self.say(Event(self._time(), EventKind.UPLOAD, f"settings of {wished.who}: {wished.why}"[:1000]))
        return wished


class OwnBlocks(JudgedBlocks):
    """The function blocks in this process, which one thread steps and others ask for their stop.

    Args:
        make: makes blocks that have just begun.
    """

    def __init__(self, make: Callable[[], ChainController]) -> None:
        self._make = make
        self._lock = threading.Lock()
        self._controller = make()
        self._adjustment: Adjustment | None = None
        self.stop: Stop = "none"
        self.doubted = 0

    def restart(self) -> None:
        """Puts new blocks in their place."""
        controller = self._make()
        with self._lock:
            if self._adjustment is not None:
                controller.adjust(self._adjustment)
            self._controller = controller

    def adjust(self, found: Adjustment) -> None:
        """Lets these blocks, and those that come in their place, count on what was found."""
        with self._lock:
            self._adjustment = found
            self._controller.adjust(found)

    def reckon_with(self, values: Mapping[str, float], another: bool = True) -> None:
        """As `ChainController.reckon_with`; blocks that come in the place of these are made with them."""
        with self._lock:
            self._controller.reckon_with(values, another)

    def step(self, sample: JointSensors) -> JointCommands:
        """The answer of the blocks to a sample."""
        with self._lock:
            commands = self._controller.step(sample.theta, sample.box)
            target = tuple(map(float, self._controller.desired()[0]))
            self.stop = STOPS[self._controller.stop]
            self.doubted = self._controller.doubted if self.stop != "none" else 0
            grips, brakes = self._controller.grips, self._controller.brakes
            return JointCommands(sample.sequence, sample.time, commands, target, grips, brakes if any(brakes) else ())

    def _judge(self, state: ArmState, confidence: float, release: bool) -> Stop:
        with self._lock:
            try:
                return self._controller.judge(state, confidence, release)
            except CommunicationError as error:
                raise CommunicationError(f"the safe stop of the blocks: {error}") from None


def _data_sheet(joints: int) -> JointAdjustment:
    return JointAdjustment.of(NAME, _DATA_SHEET, Adjustment.none(joints))


Blocks = OwnBlocks | DeviceBlocks
"""The function blocks of an arm, in this process or on a device."""


def _between(first: JointSensors, second: JointSensors, share: float) -> JointSensors:
    """A sample on the line from one to another."""
    theta = tuple(a + share * (b - a) for a, b in zip(first.theta, second.theta, strict=True))
    number = first.sequence + round(share * (second.sequence - first.sequence))
    return JointSensors(number, first.time + share * (second.time - first.time), theta, first.box)


if __name__ == "__main__":
    sys.exit(main(NAME, Options))
