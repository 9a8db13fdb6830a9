"""The measures of the table: each changes the settings of a running cell, on trial, and says what was measured."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import msgspec
import numpy as np

from dtwin.bus.messages import PREDICT
from dtwin.bus.twin_messages import MonitoredUnit, Predicted, PredictedMotion, PredictionRequest, Upload
from dtwin.controller.bounds import ENCODER_OFFSETS
from dtwin.errors import CommunicationError, ParameterError
from dtwin.identification.machine.record import MachineRecord
from dtwin.monitoring.kinds import parse_fault_id
from dtwin.parameters import PARAMETER_NAMES, ArmParameters, Gains, JointVector, scaled, symbol_of
from dtwin.recovery.answers import Measure
from dtwin.recovery.desk import Desk, FindingWithdrawn, RolledBack
from dtwin.recovery.explanation import TOO_WEAK, Outlook, TooWeak, certain, changed, changing, knowing, stopping
from dtwin.recovery.margins import LATE, control_settings, gains_with_margins, settings_for_late, stiffer_with_margins
from dtwin.recovery.refit import estimated, refitted
from dtwin.recovery.strength import Strength, usual_boxes
from dtwin.recovery.tuning import BOUND, Expect, Tuned, search, worst_ratio
from dtwin.simulation.proposal import controllable
from dtwin.task import DEFAULT_TASK, Task

PRECISE: Final = 0.0005
"""rad, standard deviation of an offset that is good enough to be taken off"""
ROUGH: Final = 0.05
"""Standard deviation, as a share of its size, of an offset that is taken off at once: the arm may touch what is near
its ways until then, and what is left is taken off once it is known"""
PATIENCE: Final = 5.0
"""s for which a better estimate of an offset is waited for"""
DOUBTFUL: Final = 5.0
"""Standard deviations below which an offset is waited for LONGER, since the monitor may still withdraw it"""
LONGER: Final = 3.0
"""Times PATIENCE"""
WRONG: Final = 0.001
"""rad by which an offset that was taken off may differ from what is known of it later"""
SAME_MASS: Final = 0.005
"""kg by which a box may differ from what the controller assumes"""
SAME: Final = 1e-9
"""Share by which a number that a device reads back may differ from what it was sent as text."""
_CONSTANTS: Final = [name for name in PARAMETER_NAMES if symbol_of(name) == "K"]


@dataclass(frozen=True, slots=True)
class Taken:
    """What came of a measure.

    Attributes:
        uploaded: plant time of the last upload that stands, s, None if nothing was uploaded.
        values: what was measured, SI units, by the names of the findings.
    """

    uploaded: float | None
    values: dict[str, float]


class Measures:
    """Takes the measures at a cell whose arm is known.

    Args:
        desk: place at the bus of the cell.
        healthy: the arm as it was identified.
        record: record of the arm if it is none that obeys the equations of motion: it says what the arm has beside
            its parameters, of which model the controller has to be, and how a box moves on it.
        task: task of the cell.

    Attributes:
        boxes: masses of the usual box and of the heaviest one, kg.
        offsets: plant time (s) of every upload of encoder offsets, and the offsets (rad).

    All methods raise CommunicationError when a service refuses or takes settings back, TooWeak when no settings help,
    DoubtfulFinding when a finding is too doubtful, FindingWithdrawn when nothing has to be changed after all,
    DeadlinePassed when the time of the desk is over, and CriticalFinding when something else stops the arm.
    """

    def __init__(
        self, desk: Desk, healthy: ArmParameters, record: MachineRecord | None = None, task: Task = DEFAULT_TASK
    ) -> None:
        self.boxes = usual_boxes(task)
        self.offsets: list[tuple[float, JointVector]] = []
        self._desk = desk
        self._arm = self._healthy = healthy
        self._record = record
        self._load = (record and record.load) or 1.0
        self._strength = Strength.of(healthy, self._load * max(self.boxes), task)
        self._befores: dict[str, tuple[float, dict[str, float]]] = {}
        self._reference: list[PredictedMotion] = []
        self._followed = 0
        self._take: dict[Measure, Callable[[Sequence[MonitoredUnit]], Taken]] = {
            "refit": self._refit,
            "rescale": self._rescale,
            "offset": self._take_off,
            "payload": self._count_on,
            "margins": self._stand_delay,
        }

    def put_into_force(self) -> float:
        """Puts the model of the healthy arm into force, asks what to expect of it, and returns since when, s."""
        model = self._arm if self._record is None else controllable(self._record)
        in_force = self._desk.settings()
        if not np.allclose(in_force.model.vector(), model.vector(), rtol=SAME, atol=0.0):
            in_force = self._desk.upload("the model identified of the healthy arm", model=model, arm=self._arm)
            self._desk.confirm(in_force)
        self.refer()
        return in_force.time

    def refer(self) -> list[PredictedMotion]:
        """What to expect of the arm as it is known with the settings in force, by which later ones are measured."""
        self._reference = self._expect(PredictionRequest(arm=self._arm))
        return self._reference

    def carry_out(self, measure: Measure, found: Sequence[MonitoredUnit]) -> Taken:
        """Takes a measure against findings that ask for it, but none if the arm surely cannot hold its boxes."""
        for unit in filter(changing, found):
            self._before(unit, {name: self._arm.get(name) for name in changing(unit)})
        if self._surely_weak(found) and (outlook := self.foresee(found)):
            raise TooWeak(outlook.text)
        return self._take[measure](found)

    def explain(self, found: Sequence[MonitoredUnit]) -> Outlook | None:
        """What an arm with what was found can do if it has to be stopped with the settings in force, else None."""
        arm, in_force = self._changed(found), self._desk.settings()
        weak = self._beyond_strength(arm, max(self.boxes))
        if arm == self._arm or not (weak or stopping(self._expect(PredictionRequest(arm=arm)), in_force.target_time)):
            return None
        return self.foresee(found)

    def foresee(self, found: Sequence[MonitoredUnit]) -> Outlook | None:
        """What an arm with what was found can do with other settings that know it, None if it is as it is known."""
        arm, in_force = self._changed(found), self._desk.settings()
        if arm == self._arm:
            return None
        try:
            expect = self._expecting(arm, knowing(in_force.model, self._arm, arm))
            tuned = self._tuned(in_force, arm, self.boxes, expect, (1.0,))
        except TooWeak as weak:
            return Outlook(str(weak), self._surely_weak(found))
        return Outlook(f"the arm can work with {tuned.target_time:.3g} s a motion")

    def _changed(self, found: Sequence[MonitoredUnit]) -> ArmParameters:
        """The arm with what was found of it, which counts from before it was first answered."""
        arm = self._arm
        for unit in found:
            since, before = self._befores.get(unit.parameter, (unit.since, {}))
            arm = arm.with_values(before) if since == unit.since and changing(unit) else arm
        return changed(arm, self._healthy, found)

    def _surely_weak(self, found: Sequence[MonitoredUnit]) -> bool:
        return bool(self._beyond_strength(self._changed(certain(found)), max(self.boxes)))

    def _refit(self, found: Sequence[MonitoredUnit]) -> Taken:
        names = [unit.parameter for unit in found]
        if self._record is None:
            arm = refitted(self._desk, self._arm, names, min(unit.detected for unit in found))
        else:
            before = self._arm
            for unit in found:
                before = before.with_values(self._before(unit, {unit.parameter: self._arm.get(unit.parameter)}))
            arm = estimated(self._desk, before, self._record.arm, names)
            if arm == self._arm:
                raise FindingWithdrawn(f"{' and '.join(names)} changed nothing that lasts")
        return Taken(self._adopt(arm), {name: arm.get(name) for name in names})

    def _rescale(self, found: Sequence[MonitoredUnit]) -> Taken:
        share = 1.0 + found[0].size
        self._desk.say(f"takes all voltage constants times {share:.3f}")
        before = self._before(found[0], {name: self._arm.get(name) for name in _CONSTANTS})
        arm = scaled(self._arm.with_values(before), "K", share)
        return Taken(self._adopt(arm), {found[0].parameter: share})

    def _before(self, unit: MonitoredUnit, values: dict[str, float]) -> dict[str, float]:
        """What the values that a finding changes, as they are now by name, were before it was first answered.

        The size of a finding counts from there, however often it is answered.
        """
        since, before = self._befores.get(unit.parameter, (unit.since, values))
        self._befores[unit.parameter] = unit.since, before if since == unit.since else values
        return self._befores[unit.parameter][1]

    def _adopt(self, arm: ArmParameters) -> float:
        """Gives the controller a model of the arm as it is now, and settings with which that arm works; when, s.

        The model comes first, since it helps at once, and settings are searched while it is on trial; but an arm that
        needs more time before it can follow its paths gets that first, and so does one whose gains have too small
        margins with the model get lower ones. What comes first has to keep its margins with the old model, too.
        """
        desk, in_force = self._desk, self._desk.settings()
        model = knowing(in_force.model, self._arm, arm)
        expect = self._expecting(arm, model)
        weak = bool(self._beyond_strength(arm, max(self.boxes)))
        now = msgspec.structs.replace(in_force, model=model)
        gains = in_force.gains if weak else self._with_margins(arm, in_force, now)
        lower = gains != in_force.gains
        able = not weak and not lower and worst_ratio(expect(gains, in_force.target_time), self._reference) <= BOUND
        uploaded = desk.upload("the arm has changed", model=model, arm=arm) if able else None
        states = (now,) if able else (in_force, now)
        stiffer = (1.0,) if weak or lower else self._stiffer(arm, *states)
        tuned = self._tuned(msgspec.structs.replace(in_force, gains=gains), arm, self.boxes, expect, stiffer)
        changes = (tuned.gains, tuned.target_time) != (in_force.gains, in_force.target_time)
        if uploaded is None:
            if changes:
                try:
                    desk.confirm(self._tune(tuned, in_force, arm))
                    changes = False
                except (CommunicationError, ParameterError) as refused:
                    if isinstance(refused, RolledBack):
                        raise
                    desk.say(f"begins with the model: {refused}")  # it would leave its path with the old one
            uploaded = desk.upload("the arm has changed", model=model, arm=arm)
        desk.confirm(uploaded)
        self._arm = arm
        if changes:
            uploaded = self._tune(tuned, in_force, arm)
            desk.confirm(uploaded)
        elif able:
            desk.say(f"gains and target time can stay: {tuned.expected}")
        return uploaded.time

    def _with_margins(self, arm: ArmParameters, in_force: Upload, then: Upload) -> Gains:
        """The gains of settings that come, if they can be, or lower ones, which are in force before already."""
        before, settings = (control_settings(state, self._record) for state in (in_force, then))
        how = (arm, self._record, self._desk.late)
        try:
            gains = gains_with_margins(settings, *how)
            return gains if gains == then.gains else gains_with_margins(settings, *how, [before])
        except ParameterError as error:
            raise TooWeak(str(error)) from None

    def _stiffer(self, arm: ArmParameters, *states: Upload) -> tuple[float, ...]:
        """Factors on Kp and Ki with which settings that are in force one after the other all have their margins."""
        known, how = self._record, (arm, self._record, self._desk.late)
        each = [stiffer_with_margins(control_settings(state, known), *how) for state in states]
        return tuple(factor for factor in each[0] if all(factor in other for other in each))

    def _tuned(
        self, in_force: Upload, arm: ArmParameters, boxes: Sequence[float], expect: Expect, stiffer: Sequence[float]
    ) -> Tuned:
        """Settings with which an arm works with boxes of some masses (kg)."""
        heaviest = max(boxes)
        load, gains, time = self._load * heaviest, in_force.gains, in_force.target_time
        tuned = search(arm, load, self._strength, expect, gains, time, self._reference, stiffer)
        if not tuned.works:
            places = ", ".join(self._beyond_strength(arm, heaviest))
            held = f", it cannot hold a box of {1e3 * heaviest:.0f} g at {places}" if places else ""
            raise TooWeak(f"{TOO_WEAK[tuned.ability]}{held}")
        return tuned

    def _beyond_strength(self, arm: ArmParameters, box: float) -> list[str]:
        """The places at which an arm cannot hold a box (kg)."""
        return self._strength.beyond(arm, self._load * box)

    def _tune(self, tuned: Tuned, in_force: Upload, arm: ArmParameters) -> Upload:
        stiffer, slower = tuned.gains.kp[0] / in_force.gains.kp[0], tuned.target_time / in_force.target_time
        why = f"Kp and Ki times {stiffer:g}, target time times {slower:g}: {tuned.expected}"
        return self._desk.upload(why, gains=tuned.gains, target_time=tuned.target_time, arm=arm)

    def _take_off(self, found: Sequence[MonitoredUnit]) -> Taken:
        """Takes offsets off as soon as they are known well, and again if they turn out otherwise."""
        desk = self._desk
        before = list(desk.settings().encoder_offset)
        names = [unit.parameter for unit in found]
        joints = {name: parse_fault_id(name).joint - 1 for name in names}
        for unit in found:
            name = unit.parameter
            before[joints[name]] = self._before(unit, {name: before[joints[name]]})[name]
        self._await_precise(names)
        taken = {name: size for name, (size, _) in self._offsets(names).items()}
        if not any(taken.values()):
            raise FindingWithdrawn(f"{' and '.join(names)} is none after all")
        upload = self._upload_offsets(before, joints, taken)
        known = self._offsets(names)
        if any(abs(size - taken[name]) > max(WRONG, 3.0 * deviation) for name, (size, deviation) in known.items()):
            taken = {name: size for name, (size, _) in known.items()}
            upload = self._upload_offsets(before, joints, taken)
        return Taken(upload.time, taken)

    def _offsets(self, names: Sequence[str]) -> dict[str, tuple[float, float]]:
        """Offsets and their standard deviations, rad, by the names of findings; what has been withdrawn is none."""
        known = {name: self._desk.findings.get(name) for name in names}
        return {name: (unit.size, unit.deviation) if unit else (0.0, 0.0) for name, unit in known.items()}

    def _upload_offsets(
        self, before: Sequence[float], joints: Mapping[str, int], taken: Mapping[str, float]
    ) -> Upload:
        """Takes offsets off beside those that were taken off before, on trial."""
        offsets = list(before)
        for name, size in taken.items():
            offsets[joints[name]] += size
        if max(map(abs, offsets)) > ENCODER_OFFSETS[1]:
            raise TooWeak("an offset is too large to be taken off")
        why = ", ".join(f"{name} is {1e3 * size:+.2f} mrad" for name, size in taken.items())
        upload = self._desk.upload(why, encoder_offset=tuple(offsets), arm=self._arm)
        self.offsets.append((upload.time, tuple(offsets)))
        self._desk.confirm(upload)
        return upload

    def _await_precise(self, names: Sequence[str]) -> None:
        """Waits until offsets are known well, or as well as patience allows, or withdrawn."""
        desk, began = self._desk, self._desk.time
        for _ in desk.messages():
            known = [desk.findings[name] for name in names if name in desk.findings]
            sure = all(abs(unit.size) >= DOUBTFUL * unit.deviation for unit in known)
            patience = PATIENCE if sure else LONGER * PATIENCE
            well = all(unit.deviation <= max(PRECISE, ROUGH * abs(unit.size)) for unit in known)
            if well or desk.time >= began + patience:
                return

    def _count_on(self, found: Sequence[MonitoredUnit]) -> Taken:
        """Has the controller count on the mass that was measured, at a target time at which the arm can carry it.

        An arm that needs more time, or lower gains, gets that first: without it the heavier box would be refused.
        Other boxes may differ from this one as usual ones do, so it is asked for the heaviest, too.
        """
        desk, in_force = self._desk, self._desk.settings()
        self._followed = len(desk.boxes)
        mass = self._mean_box()
        values = {found[0].parameter: mass}
        if abs(mass - in_force.payload) <= SAME_MASS:
            desk.say(f"the controller counts on {1e3 * in_force.payload:.0f} g already")
            return Taken(None, values)
        boxes = (mass, mass + max(self.boxes) - self.boxes[0])
        heavier = msgspec.structs.replace(in_force, payload=mass)
        weak = bool(self._beyond_strength(self._arm, max(boxes)))
        gains = in_force.gains if weak else self._with_margins(self._arm, in_force, heavier)
        lower = gains != in_force.gains
        tuned = self._tuned(
            msgspec.structs.replace(in_force, gains=gains),
            self._arm,
            boxes,
            lambda gains, time: self._expect(PredictionRequest(gains, time, arm=self._arm, payload=mass), boxes),
            (1.0,) if weak or lower else self._stiffer(self._arm, in_force, heavier),
        )
        first = lower or tuned.target_time > in_force.target_time
        if first:
            desk.confirm(self._tune(tuned, in_force, self._arm))
        upload = desk.upload(f"the box weighs {1e3 * mass:.0f} g", payload=mass, arm=self._arm)
        desk.confirm(upload)
        if not first and tuned.gains != in_force.gains:
            upload = self._tune(tuned, in_force, self._arm)
            desk.confirm(upload)
        return Taken(upload.time, values)

    def follow_boxes(self) -> None:
        """Has the controller count on the mean of all boxes that differed, once the first of them was answered."""
        boxes = self._desk.boxes
        if not self._followed or len(boxes) == self._followed:
            return
        self._followed = len(boxes)
        mass = self._mean_box()
        if abs(mass - self._desk.settings().payload) > SAME_MASS:
            why = f"the last {len(boxes)} boxes that differed weighed {1e3 * mass:.0f} g in the mean"
            self._desk.confirm(self._desk.upload(why, payload=mass, arm=self._arm))

    def _mean_box(self) -> float:
        """Mean mass of all boxes that differed, kg."""
        boxes = self._desk.boxes
        return self.boxes[0] + sum(boxes.values()) / len(boxes) / self._load

    def _stand_delay(self, found: Sequence[MonitoredUnit]) -> Taken:
        """Lowers the gains until the loop has its margins with the delay, and the speed until the arm tracks well."""
        desk, in_force, expect = self._desk, self._desk.settings(), self._expecting(self._arm)
        desk.late = LATE
        try:
            known = control_settings(in_force, self._record)
            tuned = settings_for_late(
                known, self._arm, self._record, self._load * max(self.boxes), self._strength, expect, self._reference
            )
        except ParameterError as error:
            raise TooWeak(str(error)) from None
        if not tuned.works:
            raise TooWeak(TOO_WEAK[tuned.ability])
        if (tuned.gains, tuned.target_time) == (in_force.gains, in_force.target_time):
            desk.say(f"gains and target time can stay though commands are late: {tuned.expected}")
            return Taken(None, {})
        upload = self._tune(tuned, in_force, self._arm)
        desk.confirm(upload)
        return Taken(upload.time, {})

    def _expecting(self, arm: ArmParameters, model: ArmParameters | None = None) -> Expect:
        """What simulation expects of all motions of an arm by gains and target time, whatever is in force."""
        return lambda gains, time: self._expect(PredictionRequest(gains, time, model=model, arm=arm))

    def _expect(self, request: PredictionRequest, boxes: Sequence[float] | None = None) -> list[PredictedMotion]:
        """What simulation expects of all motions, with boxes of some masses (kg), on the arm as it is known."""
        return [
            motion
            for box in boxes or self.boxes
            for motion in self._desk.bus.ask(
                PREDICT,
                msgspec.structs.replace(request, box=self._load * box, late=self._desk.late),
                Predicted,
            ).motions
        ]
