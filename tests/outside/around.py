"""A plant with effects around it, and runs of the cell in which the blocks control such a plant."""

from __future__ import annotations

import math
from dataclasses import dataclass
from operator import add

import numpy as np

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.ports import STOP
from dtwin.controller.settings import ControlSettings
from dtwin.emulation.emulation import Emulation
from dtwin.emulation.machine.sections import IDEAL, Machine
from dtwin.parameters import JointVector, every_joint
from dtwin.run.loop import run, tick_count
from dtwin.signals import Event, EventKind, Sensors, StepRecord, Truth, Voltages
from tests.outside.effect import Effect


class Around:
    """The emulation with effects around its seam; it is a plant itself, whose truth stays the emulation's.

    Args:
        emulation: the plant inside.
        effect: what lies around it.
        seed: number of the effect's random generator.

    Attributes:
        began: plant time of the first sample at which it changed anything, s; infinite until then.
    """

    def __init__(self, emulation: Emulation, effect: Effect, seed: int = 0) -> None:
        self.emulation = emulation
        self._outside = effect(np.random.default_rng(seed))
        self._sample: Sensors | None = None
        self.began = math.inf

    def read(self) -> Sensors:
        """The sample as it reaches the controller; the same one until the plant has gone on."""
        inside = self.emulation.read()
        if self._sample is None or self._sample.sequence != inside.sequence:
            truth, given = self.truth(), inside
            for part in self._outside.readings:
                given = part(given, truth)
            self._notice(given.theta != inside.theta, inside.time)
            self._sample = given
        return self._sample

    def truth(self) -> Truth:
        """The true state of the plant inside."""
        return self.emulation.truth()

    def apply(self, voltages: Voltages) -> None:
        """Sets the command as it reaches the plant, and the torques of this tick."""
        asked = voltages.volts
        for part in self._outside.commands:
            voltages = part(voltages)
        self._notice(voltages.volts != asked, voltages.time)
        self.emulation.apply(voltages)
        if self._outside.torques:
            truth, total = self.truth(), every_joint(0.0)
            for torque in self._outside.torques:
                total = _sum(total, torque(truth, voltages))
            self._notice(any(total), voltages.time)
            self.emulation.disturb(total)

    def advance(self, period: float) -> None:
        """Lets the plant inside run for a period (s)."""
        self.emulation.advance(period)

    def _notice(self, changed: bool, time: float) -> None:
        if changed:
            self.began = min(self.began, time)


def _sum(these: JointVector, others: JointVector) -> JointVector:
    return tuple(map(add, these, others))


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a run.

    Attributes:
        delivered: boxes that lie at the place of their colour.
        lost: boxes that were lost elsewhere.
        fastest: largest true velocity of a joint, rad/s.
        stopped: plant time at which a safe stop was demanded first, s; infinite if none was.
        fell: whether the torque was taken off.
        events: the controller's, such as its calls for help, and those of the plant.
    """

    delivered: int
    lost: int
    fastest: float
    stopped: float
    fell: bool
    events: tuple[Event, ...]

    @property
    def called(self) -> bool:
        """Whether the controller called for help."""
        return any(event.kind == EventKind.HELP for event in self.events)


def outcome(
    effect: Effect,
    *,
    seed: int = 0,
    duration: float = 60.0,
    machine: Machine = IDEAL,
    noise: float = 0.001,
    settings: ControlSettings | None = None,
) -> Outcome:
    """Lets the blocks sort boxes with an effect around the plant.

    Args:
        effect: what lies around the plant.
        seed: number of the random generators of boxes, noise and effect.
        duration: plant time, s.
        machine: what the arm has beside its parameters.
        noise: magnitude of the encoder noise, rad.
        settings: of the controller; the cascade's usual ones when None.
    """
    emulation = Emulation(machine=machine, noise=noise, seed=seed)
    controller = EmbeddedController(settings or ControlSettings(law="cascade"))
    stop_now = controller.resource.reader((STOP,))
    fastest, stops = 0.0, [np.inf, np.inf]

    def watch(record: StepRecord) -> None:
        nonlocal fastest
        fastest = max(fastest, *map(abs, record.truth.omega))
        (stop,) = stop_now()
        if stop:
            stops[stop == 3] = min(stops[stop == 3], record.sensors.time)

    run(Around(emulation, effect, seed), controller, tick_count(duration), record=watch)
    counts = emulation.box_counts
    events = (*emulation.drain_events(), *controller.drain_events())
    return Outcome(counts.delivered, counts.misplaced, fastest, min(stops), np.isfinite(stops[1]), events)
