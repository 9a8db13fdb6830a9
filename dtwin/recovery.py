"""The whole loop once: a joint's friction grows while the cell works, and the twin puts it right.

The monitor notices it and names it, identification refits the damping from what the arm does meanwhile, simulation
says what the new model will change, the model is uploaded to the running controller and tried, then higher gains
where more damping asks for them; and the arm tracks its path as before. Nobody but the emulation knows of the fault;
who did what and when is in the outcome and its log.

Tracking is judged on the motions back to the pickup point: there the arm is empty, so that one motion compares with
another from the same place. With a box, its weight of 200 g +- 10 g, which nobody is told, would count for more.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from dtwin.cell import Cell, CellSettings
from dtwin.control import ControlSettings, EmbeddedController
from dtwin.emulation import Fault
from dtwin.identification.data import Experiment
from dtwin.identification.estimate import Settings, identify, load_kernels
from dtwin.identification.excitation import Plan
from dtwin.identification.experiments import standard_settings
from dtwin.identification.model import IdentifiedModel, from_estimate
from dtwin.identification.problem import Prior
from dtwin.identification.rig import Rig
from dtwin.identification.signal_blocks import SignalBlocks
from dtwin.monitoring.belief import identified
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.verdict import Finding
from dtwin.parameters import PERIOD, PICKUP, PLACES, ArmParameters, Triple
from dtwin.recording import Log
from dtwin.signals import Event, Sensors, Voltages
from dtwin.simulation.checks import MOTIONS, Checker, Motion
from dtwin.simulation.figures import triple
from dtwin.simulation.history import Entry, History
from dtwin.simulation.live import WatchedController
from dtwin.simulation.measured import motions
from dtwin.simulation.ports import EmbeddedPort
from dtwin.simulation.upload import Proposal, Uploader

Array = NDArray[np.float64]
Who = Literal["cell", "monitoring", "identification", "simulation", "evaluation"]

LIMIT: Final = 60.0
"""s after the fault in which the arm has to have recovered"""
TOLERANCE: Final = 1.2
"""tracking error after recovery, relative to that before the fault"""
LONGEST: Final = 600.0
"""s in which every place must have been served once, before the fault"""
DATA: Final = 150
"""ticks of empty motion to refit from"""
COMPUTING: Final = 1.0
"""s that fit and checks are given before the model is uploaded"""
SEGMENT: Final = 75
"""ticks of one piece of data, each with its own initial state"""
SCALES: Final = (1.0, 1.15, 1.3, 1.5)
"""factors on Kp and Ki that are simulated; beyond the last the noise of the encoders gets the better of the gain"""
RETURNS: Final = tuple(motion for motion in MOTIONS if not motion.carries)
FREE: Final = ("D1", "D2", "D3")
HELD: Final = 0.5
"""s after the end of a path that belong to the motion that is judged"""


@dataclass(frozen=True, slots=True)
class Moment:
    """Something that somebody did, at a plant time (s)."""

    time: float
    who: Who
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class Recovery:
    """What came of it; times are plant time, s, None for what did not happen.

    Attributes:
        seed: of the run.
        joint: whose damping grew.
        factor: by which.
        fault: when.
        finding: of the monitor.
        damping: of the joint, identified anew, N m s/rad.
        uploaded: when the model was acknowledged.
        recovered: when the first motion that tracked as before ended; none after it did worse.
        before: root mean square of the distance from the path in motions before the fault, rad, by place.
        ratios: of that distance to the one before, for every motion since the fault: time of its end, ratio.
        moments: who did what.
        log: of the run.
    """

    seed: int
    joint: int
    factor: float
    fault: float
    finding: Finding | None
    damping: float | None
    uploaded: float | None
    recovered: float | None
    before: dict[str, float]
    ratios: tuple[tuple[float, float], ...]
    moments: tuple[Moment, ...]
    log: Log

    @property
    def succeeded(self) -> bool:
        """Whether cause and joint were named and the arm recovered in time."""
        named = self.finding is not None and (self.finding.cause, self.finding.joint) == ("friction", self.joint)
        return named and self.recovered is not None and self.recovered - self.fault <= LIMIT


def first_model(noise: float, generator: np.random.Generator) -> IdentifiedModel:
    """A model of the healthy arm, from one standard experiment.

    Args:
        noise: of the encoders, rad.
        generator: of the noise.

    Raises:
        IdentificationError: the data are too poor.
    """
    rig = Rig(noise=noise)
    estimate = identify([rig.measure(Plan(), SignalBlocks(), generator)], standard_settings())
    return from_estimate(estimate, np.ones(3), "simulated experiment")


def recover(
    seed: int, history: Path, noise: float = 0.002, progress: Callable[[float], None] = lambda done: None
) -> Recovery:
    """Makes the run.

    Args:
        seed: of boxes, noise and fault.
        history: file for the history of the settings, not there yet.
        noise: of the encoders, rad, uniform.
        progress: told the seconds of plant time done.

    Raises:
        DtwinError: a part cannot do its work.
    """
    generator = np.random.default_rng(np.random.SeedSequence(seed).spawn(3)[2])
    joint, factor = int(generator.integers(1, 4)), round(float(generator.uniform(1.5, 1.9)), 3)
    load_kernels()
    run = _Run(seed, noise, first_model(noise, generator), Fault(f"D{joint}", "*=", factor, 0.0), history)
    run.cell.run(lambda done: _tell(progress, done) and not run.over)
    return run.outcome(joint, factor)


def _tell(progress: Callable[[float], None], done: int) -> bool:
    progress(done * PERIOD)
    return True


class _Run:
    """The cell and its twin, tick by tick; the twin sees samples and commands only."""

    def __init__(self, seed: int, noise: float, model: IdentifiedModel, fault: Fault, history: Path) -> None:
        settings = ControlSettings(model=model.arm)
        self._controller = EmbeddedController(settings)
        self._checker = Checker()
        self._uploader = Uploader(EmbeddedPort(self._controller), History(history), self._checker)
        self._watched = WatchedController(self._controller, self._uploader, self._judged)
        self._monitor = Monitor(identified(model))
        self._model, self._arm = model, model.arm
        self._fault = fault
        self._seed = seed
        self._destination = ""
        self._served: set[str] = set()
        self._began: float | None = None
        self._finding: Finding | None = None
        self._measured: list[Triple] = []
        self._volts: list[Triple] = []
        self._usable: list[bool] = []
        self._last: Triple = (0.0, 0.0, 0.0)
        self._due: float | None = None
        self._damping: float | None = None
        self._uploaded: float | None = None
        self._repaired: ArmParameters | None = None
        self._moments: list[Moment] = []
        duration = LONGEST + LIMIT
        self.cell = Cell(CellSettings(duration=duration, seed=seed, noise=noise, control=settings), self)

    @property
    def over(self) -> bool:
        """Whether the time to recover in has passed."""
        return self._began is not None and len(self._measured) * PERIOD >= self._began + LIMIT

    def target(self) -> Triple:
        """As a controller."""
        return self._watched.target()

    def step(self, sensors: Sensors) -> Voltages:
        """As a controller; what the twin does happens between this tick and the next."""
        voltages = self._watched.step(sensors)
        path = self._watched.target()
        volts = voltages.volts[:3]
        self._measured.append(sensors.theta)
        self._volts.append(volts)
        self._usable.append(path != self._last and not voltages.box_gripped)
        self._last = path
        self._break_when_all_places_are_known(sensors.time)
        self._monitor.update(sensors.sequence, np.array(sensors.theta), np.array(volts), voltages.box_gripped)
        if self._finding is None:
            self._notice(sensors.time)
        elif self._uploaded is None:
            self._repair(sensors.time)
        elif self._repaired is not None and self._uploader.trial is None:
            self._retune(self._repaired, sensors.time)
            self._repaired = None
        return voltages

    def outcome(self, joint: int, factor: float) -> Recovery:
        """What came of it."""
        log = self.cell.log.freeze()
        began = self._began if self._began is not None else float("inf")
        before, ratios = _tracking(log, began)
        since = self._uploaded if self._uploaded is not None else float("inf")
        recovered = None
        for end, ratio, start in reversed(ratios):
            if start < since or ratio > TOLERANCE:
                break
            recovered = end
        if recovered is not None:
            text = f"the arm tracks as before the fault, within {100 * (TOLERANCE - 1):.0f} %"
            self._note(recovered, "evaluation", text)
        moments = tuple(sorted(self._moments, key=lambda moment: moment.time))
        events = [*log.events, *(Event(m.time, m.who, m.text) for m in moments)]
        log = replace(log, events=tuple(sorted(events, key=lambda event: event.time)))
        return Recovery(
            self._seed,
            joint,
            factor,
            began,
            self._finding,
            self._damping,
            self._uploaded,
            recovered,
            before,
            tuple((end, ratio) for end, ratio, _ in ratios),
            moments,
            log,
        )

    def _note(self, time: float, who: Who, text: str) -> None:
        self._moments.append(Moment(time, who, text))

    def _break_when_all_places_are_known(self, time: float) -> None:
        """Lets the friction grow at the start of the next motion once the arm has come back from every place."""
        destination = str(self._controller.resource.read("SEQUENCE.DESTINATION"))
        if destination == self._destination or self._began is not None:
            return
        if len(self._served) == len(PLACES):
            self._began = time
            (fault,) = self.cell.emulation.inject([replace(self._fault, start=time)])
            self._note(time, "cell", f"{fault}: friction of joint {fault.target[-1]} grows, nobody is told")
        elif destination == "pickup" and self._destination in PLACES:
            self._served.add(self._destination)
        self._destination = destination

    def _notice(self, time: float) -> None:
        settled = [finding for finding in self._monitor.findings.values() if finding.settled]
        if settled:
            self._finding = settled[0]
            self._note(settled[0].detected, "monitoring", f"suspects joint {settled[0].joint}")
            self._note(time, "monitoring", settled[0].text())

    def _repair(self, time: float) -> None:
        """Collects data, then gives the fit its time, then uploads."""
        assert self._finding is not None
        first = round(self._finding.since / PERIOD)
        if self._due is None:
            if sum(self._usable[first:]) >= DATA:
                self._due = time + COMPUTING
                self._note(time, "identification", f"refits {', '.join(FREE)} from {DATA} samples of empty motion")
        elif time >= self._due:
            self._upload(self._refit(self._finding.joint, first), time)

    def _refit(self, joint: int, first: int) -> ArmParameters:
        """The arm with its damping identified from the empty motions since a tick.

        That of the joint that the monitor named is unknown; the others stay what they were, within their errors.
        """
        errors = self._model.standard_errors
        known = {name: Prior(self._arm.get(name), errors[name]) for name in FREE if name != f"D{joint}"}
        return identify(self._data(first), Settings(FREE, self._arm, priors=known)).parameters

    def _data(self, first: int) -> list[Experiment]:
        """Pieces of the empty motions, each long enough to tell a speed from noise."""
        usable = np.array([False, *self._usable[first:], False])
        edges = np.flatnonzero(usable[1:] != usable[:-1]) + first
        pieces = []
        for start, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            for row in range(start, stop - SEGMENT + 1, SEGMENT):
                rows = slice(row, row + SEGMENT)
                pieces.append(Experiment(np.array(self._measured[rows]), np.array(self._volts[rows])))
        return pieces

    def _upload(self, arm: ArmParameters, time: float) -> None:
        assert self._finding is not None
        name = f"D{self._finding.joint}"
        self._damping = arm.get(name)
        self._note(time, "identification", f"{name} is {self._damping:.4f} N m s/rad, was {self._arm.get(name):.4f}")
        settings = self._uploader.settings
        now, then = self._expected(settings, arm), self._expected(replace(settings, model=arm), arm)
        self._note(time, "simulation", f"expects {1e3 * then:.2f} mrad rms from the path in place of {1e3 * now:.2f}")
        proposal = Proposal("identification", self._finding.text(), self._uploader.version, model=arm)
        entry = self._uploader.upload(proposal, time, arm)
        self._uploaded, self._repaired = time, arm
        self._note(time, "simulation", f"model uploaded and acknowledged as version {entry.version}")

    def _retune(self, arm: ArmParameters, time: float) -> None:
        """Raises the gains as far as the arm needs it to track as it did when it was healthy."""
        settings = self._uploader.settings
        healthy = [self._expected(replace(settings, model=self._arm), self._arm, (motion,)) for motion in RETURNS]
        for scale in SCALES:
            gains = replace(
                settings.gains,
                kp=triple(scale * gain for gain in settings.gains.kp),
                ki=triple(scale * gain for gain in settings.gains.ki),
            )
            tuned = replace(settings, gains=gains)
            expected = [self._expected(tuned, arm, (motion,)) for motion in RETURNS]
            worst = max(now / before for now, before in zip(expected, healthy, strict=True))
            if worst <= 1.0:
                break
        if scale > SCALES[0]:
            why = f"Kp and Ki times {scale:g}: at most {100 * worst:.0f} % of the healthy distance expected"
            entry = self._uploader.upload(Proposal("simulation", why, self._uploader.version, gains), time, arm)
            self._note(time, "simulation", f"gains uploaded and acknowledged as version {entry.version}: {why}")

    def _expected(
        self, settings: ControlSettings, arm: ArmParameters, motions: tuple[Motion, ...] = RETURNS
    ) -> float:
        """Root mean square of the distance from the path that the twin expects, rad."""
        return self._checker.predict(settings, arm, motions).rms

    def _judged(self, entry: Entry) -> None:
        self._note(entry.time, "simulation", f"{entry.action}: {entry.text or entry.why}")


def _tracking(log: Log, fault: float) -> tuple[dict[str, float], list[tuple[float, float, float]]]:
    """Tracking before the fault by place, and since then as (end, ratio, start) a motion back to the pickup point."""
    known: dict[str, list[float]] = {}
    ratios = []
    place = ""
    for motion in motions(log):
        if motion.goal == PICKUP.theta and place:
            stop = motion.start + round((motion.target_time + HELD) / PERIOD)
            if stop > len(log):
                break
            rows = slice(motion.start, stop)
            away = (log.stack("target") - log.stack("theta"))[rows]
            error = float(np.sqrt(np.mean(away**2)))
            if motion.time < fault - PERIOD / 2:
                known.setdefault(place, []).append(error)
            else:
                ratios.append((stop * PERIOD, error / float(np.mean(known[place])), motion.time))
        place = next((name for name, at in PLACES.items() if at.theta == motion.goal), "")
    return {name: float(np.mean(errors)) for name, errors in known.items()}, ratios
