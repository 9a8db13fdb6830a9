"""Encoders that stop at many moments of a motion: whether the blocks alone brake the arm and hold it with its box."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final, NamedTuple

import msgspec

from dtwin.campaign.spread import Progress, Workforce, spread
from dtwin.commands.frame import at_least
from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.ports import STOP
from dtwin.controller.settings import Compensation, ControlSettings
from dtwin.emulation.emulation import Emulation
from dtwin.emulation.faults import parse_fault
from dtwin.emulation.machine.files import machine_of
from dtwin.emulation.machine.sections import Sensing
from dtwin.identification.machine.record import EncoderCheck
from dtwin.parameters import ArmParameters, JointVector
from dtwin.run.loop import run, tick_count
from dtwin.signals import STOPS, StepRecord, Voltages
from dtwin.simulation.proposal import pull, repeats, with_rotors
from dtwin.twin.effects import Effects
from evidence.experiment import SeriesCommand
from evidence.recovery.expected import made_of
from evidence.report import Report, page, table
from evidence.untouched import untouched

MOMENTS: Final = (12.3, 12.65, 13.0, 13.3, 13.6, 14.8, 15.6, 16.5)
"""Plant times at which an encoder stops, s: on the way with a box, as it is let go, and on the way back."""
WATCHED: Final = 8.0
"""Time after which a run ends, s."""
HELD: Final = 0.3
"""Largest motion of a joint of a standing arm that counts as held, rad."""
FAST: Final = 6.0
"""Largest velocity of a joint that is asked for, rad/s."""


class Frozen(NamedTuple):
    """A run: number of the machine, that of its generators of boxes and noise, the joint, and the moment."""

    number: int
    seed: int
    joint: int
    moment: float


class FrozenOutcome(msgspec.Struct, frozen=True):
    """What came of a run.

    Attributes:
        number, joint, moment: what it was run with.
        box: whether a box was held when the encoder stopped.
        stopped_s: time from there to the stop, s; None if there was none.
        torque_off_s: time from there until the torque was taken off, s; None if it was not.
        fastest: largest true velocity of a joint since, rad/s.
        falling: the same of the same arm whose motors get no voltage from its stop on, rad/s: what gravity does.
        moved: largest true motion of a joint since the arm counted as standing, rad.
        lost: number of boxes that lie at no place of theirs at the end.
    """

    number: int
    joint: int
    moment: float
    box: bool
    stopped_s: float | None
    torque_off_s: float | None
    fastest: float
    falling: float
    moved: float
    lost: int

    @property
    def held(self) -> bool:
        """Whether the arm was stopped, kept its torque, and stood."""
        return self.stopped_s is not None and self.torque_off_s is None and self.moved <= HELD


def freeze(trial: Frozen) -> FrozenOutcome:
    """Lets a machine work under the blocks alone, whose controller knows the arm that it is, and stops an encoder.

    Raises:
        DtwinError: the work failed.
    """
    return msgspec.structs.replace(_ran(trial, True), falling=_ran(trial, False).fastest)


def _ran(trial: Frozen, powered: bool) -> FrozenOutcome:
    """What came of one run, whose motors get voltages after its stop or none; `falling` is not known yet."""
    machine = machine_of(str(trial.number))
    arm, effects = made_of(machine, ArmParameters())
    fault = parse_fault(f"freeze{trial.joint}@{trial.moment:.2f}")
    plant = _Plant(machine=machine, seed=trial.seed, faults=(fault,))
    known = ControlSettings(
        law="cascade", model=with_rotors(arm, effects), compensation=known_drives(machine.sensing, arm, effects)
    )
    controller = EmbeddedController(known)
    stop_now = controller.resource.reader((STOP,))
    box, fastest, moved, times = False, 0.0, 0.0, dict[str, float]()
    stood: JointVector | None = None

    def record(step: StepRecord) -> None:
        nonlocal box, fastest, moved, stood
        time = step.truth.time
        if time < trial.moment:
            box = step.voltages.box_gripped
            return
        fastest = max(fastest, *map(abs, step.truth.omega))
        stop = STOPS[int(stop_now()[0])]
        if stop != "none":
            plant.powered = powered
            times.setdefault("any", time - trial.moment)
            times.setdefault(stop, time - trial.moment)
        if stop in ("standstill", "torque off"):
            stood = stood or step.truth.theta
            moved = max(moved, *(abs(a - b) for a, b in zip(step.truth.theta, stood, strict=True)))

    run(plant, controller, tick_count(trial.moment + WATCHED), record=record)
    return FrozenOutcome(
        trial.number,
        trial.joint,
        trial.moment,
        box,
        times.get("any"),
        times.get("torque off"),
        fastest,
        math.nan,
        moved,
        plant.box_counts.misplaced,
    )


class _Plant(Emulation):
    """An emulation whose motors can be made to get no voltage, whatever they are told."""

    powered = True

    def apply(self, voltages: Voltages) -> None:
        first, second, third, jaws = voltages.volts
        on = float(self.powered)
        super().apply(msgspec.structs.replace(voltages, volts=(on * first, on * second, on * third, jaws)))


def known_drives(sensing: Sensing, arm: ArmParameters, effects: Effects) -> Compensation:
    """What the controller of a commissioned machine takes into account of its encoders and drives."""
    step = math.tau / 2**sensing.bits if sensing.bits else None
    drives = zip(arm.coulomb, effects.stiction, arm.voltage_constant, effects.dead_zone, strict=True)
    pulls = tuple(pull(mu + more + constant * zone, step) for mu, more, constant, zone in drives)
    if step is None:
        return Compensation(pull=pulls)
    spread = math.hypot(sensing.noise, step / math.sqrt(12.0))
    count = repeats(EncoderCheck(step, spread, spread, 0.0, 0.0, 0))
    return Compensation(repeats=(count, count, count), pull=pulls)


def frozen_encoders(
    first: int, machines: int, seed: int, workforce: Workforce, progress: Progress
) -> list[FrozenOutcome]:
    """Stops every encoder at every moment on machines of consecutive numbers.

    Raises:
        ParameterError: somebody tuned to one of the machines.
        DtwinError: the work failed.
    """
    trials = [
        Frozen(number, seed + number, joint, moment)
        for number in untouched(first, machines)
        for joint in (1, 2, 3)
        for moment in MOMENTS
    ]
    return spread(freeze, trials, workforce, progress)


def frozen_report(found: Sequence[FrozenOutcome]) -> Report:
    """The page of the runs."""
    rows = []
    for joint in (1, 2, 3):
        for box in (True, False):
            runs = [one for one in found if one.joint == joint and one.box == box]
            if runs:
                rows.append([str(joint), "yes" if box else "no", *_cells(runs)])
    rows.append(["all", "", *_cells(found)])
    header = [
        *("encoder", "box held", "runs", "stopped", "held to the end", "torque off"),
        *("faster than 6 rad/s", "without torque", "fastest, rad/s", "without torque", "boxes lost"),
    ]
    return page(
        "Encoders that stop",
        f"Every encoder of {len({one.number for one in found})} drawn machines stops at {len(MOMENTS)} moments of a"
        " motion, under the function blocks alone, whose controller knows the arm and its encoders. Held: stopped,"
        f" with torque, and no joint moved by more than {HELD:g} rad in {WATCHED:g} s. Without torque: the same runs,"
        " whose motors get no voltage from the stop on.",
        table(header, rows),
    )


def _cells(runs: Sequence[FrozenOutcome]) -> list[str]:
    return [
        str(len(runs)),
        str(sum(one.stopped_s is not None for one in runs)),
        str(sum(one.held for one in runs)),
        str(sum(one.torque_off_s is not None for one in runs)),
        str(sum(one.fastest > FAST for one in runs)),
        str(sum(one.falling > FAST for one in runs)),
        f"{max(one.fastest for one in runs):.1f}",
        f"{max(one.falling for one in runs):.1f}",
        str(sum(one.lost for one in runs)),
    ]


@dataclass(frozen=True)
class ExperimentFrozen(SeriesCommand[list[FrozenOutcome]]):
    """Stop each encoder at several moments of a motion, and count how often the blocks alone hold the arm.

    An arm that leans on no reading of a joint cannot be held in every pose, so nothing passes or fails.
    """

    name: ClassVar = "frozen"

    first: int = 73501
    """Number of the first machine; the others have the next ones."""
    machines: int = 10
    """Number of machines."""

    def measure(self, progress: Progress) -> list[FrozenOutcome]:
        at_least("--first", self.first, 0)
        at_least("--machines", self.machines, 1)
        return frozen_encoders(self.first, self.machines, self.seed, self.workforce(), progress)

    def report(self, result: list[FrozenOutcome]) -> Report:
        return frozen_report(result)

    def figures(self, result: list[FrozenOutcome]) -> dict[str, Any]:
        return {"runs": msgspec.to_builtins(result)}
