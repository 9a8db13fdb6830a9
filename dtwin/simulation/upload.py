"""Uploads settings to a running controller: checked, acknowledged, tried, and rolled back when the trial fails."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Final, Literal

from dtwin.controller.ports import LOAD, MODEL, OFFSETS, TUNING
from dtwin.controller.settings import ControlSettings
from dtwin.controller.settings_port import SettingsPort
from dtwin.errors import CommunicationError, ParameterError
from dtwin.parameters import ArmParameters, Gains, JointVector, joint_vector
from dtwin.simulation.checks import Checker, ExpectedTracking, Refused
from dtwin.simulation.history import SELF, Action, Entry, History
from dtwin.simulation.trial import Trial, TrialRules

Kind = Literal["gains", "target", "model", "payload", "offset", ""]
_GROUP_OF: Final = {"gains": TUNING, "target": TUNING, "model": MODEL, "payload": LOAD, "offset": OFFSETS}
"""The inputs that are changed together, by the name of the command."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """Proposes new settings: gains, a target time or both, or a model, or the mass of a box, or encoder offsets.

    Attributes:
        who: who wants the new settings.
        why: reason in the words of that person.
        based_on: version of the settings that this person has seen.
        gains: new gains, or None.
        target_time: new target time, s, or None.
        model: new model of the arm, or None.
        payload: new mass of a box, kg, or None.
        encoder_offset: new offsets of the encoders, rad, or None.

    Raises:
        ParameterError: there is nothing new, or more than one thing, which would be several messages that could not
            come into force at once.
    """

    who: str
    why: str
    based_on: int
    gains: Gains | None = None
    target_time: float | None = None
    model: ArmParameters | None = None
    payload: float | None = None
    encoder_offset: JointVector | None = None

    def __post_init__(self) -> None:
        tuned = self.gains is not None or self.target_time is not None
        alone = (self.model, self.payload, self.encoder_offset)
        if tuned + sum(value is not None for value in alone) != 1:
            raise ParameterError(
                "upload: expected gains, a target time or both, or a model, a payload or encoder offsets alone"
            )

    @property
    def kind(self) -> Kind:
        """What is to change, by the name of its command."""
        if self.model is not None:
            return "model"
        if self.payload is not None:
            return "payload"
        if self.encoder_offset is not None:
            return "offset"
        return "gains" if self.gains is not None else "target"

    def applied(self, settings: ControlSettings) -> ControlSettings:
        """The given settings with the proposed changes."""
        changed_settings = changed(settings, self.gains, self.target_time, self.model, self.payload)
        return replace(
            changed_settings,
            encoder_offset=settings.encoder_offset if self.encoder_offset is None else self.encoder_offset,
        )


def changed(
    settings: ControlSettings,
    gains: Gains | None,
    target_time: float | None,
    model: ArmParameters | None,
    payload: float | None,
) -> ControlSettings:
    """The given settings in which every value that is not None is replaced."""
    return replace(
        settings,
        gains=settings.gains if gains is None else gains,
        target_time=settings.target_time if target_time is None else target_time,
        model=settings.model if model is None else model,
        payload=settings.payload if payload is None else payload,
    )


class Uploader:
    """Changes the settings of a controller and watches them on trial.

    Args:
        port: port through which settings reach the controller.
        history: history of the settings, which is compared with the settings in force.
        checker: checker that new settings must pass.
        rules: rules of the trial.
        time: plant time, s.

    Attributes:
        last: newest entry of the history, whose settings are in force.
        trial: trial that is running, or None.

    Raises:
        CommunicationError: the controller does not answer.
        RecordingError: the history cannot be used.
    """

    def __init__(
        self,
        port: SettingsPort,
        history: History,
        checker: Checker,
        rules: TrialRules | None = None,
        time: float = 0.0,
    ) -> None:
        self.trial: Trial | None = None
        self._port = port
        self._history = history
        self._checker = checker
        self._rules = rules or TrialRules()
        self._before: ControlSettings | None = None
        self._tried: Proposal | None = None
        entries = history.entries()
        found = port.read_back()
        if entries and not entries[-1].settings.differing(found):
            self.last = entries[-1]
            self._resume_trial(entries)
        else:
            self.last = self._found(entries[-1].version + 1 if entries else 1, found, time)

    @property
    def settings(self) -> ControlSettings:
        """The settings in force."""
        return self.last.settings

    @property
    def version(self) -> int:
        """The version of the settings in force."""
        return self.last.version

    def look_again(self, time: float) -> None:
        """Finds settings that something else has given the controller, and records them; they end a trial.

        Raises:
            CommunicationError: the controller does not answer.
        """
        found = self._port.read_back()
        if self.settings.differing(found):
            self.trial = None
            self.last = self._found(self.version + 1, found, time)

    def upload(self, proposal: Proposal, time: float, arm: ArmParameters | None = None, late: float = 0.0) -> Entry:
        """Puts new settings into force, on trial.

        Args:
            proposal: new settings.
            time: plant time, s.
            arm: model of the arm for the checks; the controller's model with the proposed changes when None.
            late: ticks by which commands act later than they did.

        Returns:
            The entry of the history, after the settings have been read back from the controller.

        Raises:
            Refused: the settings must not be uploaded; the refusal is in the history.
            CommunicationError: the controller does not answer, or has not taken over the settings.
        """
        settings = proposal.applied(self.settings)
        try:
            self._refuse_untimely(proposal)
            prediction = self._checker.check(settings, arm or settings.model, late=late, in_force=self.settings)
        except Refused as reason:
            self._record("refuse", proposal, self.settings, time, str(reason))
            raise
        self._before, self._tried = self.settings, proposal
        self.trial = Trial(self._rules, prediction.tracking)
        # The history comes first: if this process ends now, the next one watches the settings or finds the old ones.
        entry = self._record("upload", proposal, settings, time, predicted=prediction.tracking)
        try:
            self._send(settings, proposal.kind)
        except CommunicationError:
            with suppress(CommunicationError):
                self.look_again(time)
            raise
        return entry

    def try_out(self, proposal: Proposal, arm: ArmParameters | None = None, late: float = 0.0) -> ExpectedTracking:
        """What the twin expects of new settings that are not uploaded; they are checked like an upload.

        Args:
            proposal: new settings.
            arm: model of the arm for the checks; the controller's model with the proposed changes when None.
            late: ticks by which commands act later than they did.

        Raises:
            Refused: the settings must not be uploaded; the history does not tell of it, since nothing was uploaded.
        """
        if proposal.based_on != self.version:
            raise Refused(f"the settings have changed: expected version {self.version}, got {proposal.based_on}")
        settings = proposal.applied(self.settings)
        return self._checker.check(settings, arm or settings.model, late=late, in_force=self.settings)

    def observe(self, time: float, path: JointVector, measured: JointVector) -> Entry | None:
        """Judges a sample while a trial runs.

        Args:
            time: plant time, s.
            path: desired angles, rad.
            measured: measured angles, rad, from which the trial takes the offsets in force off.

        Returns:
            The entry of the history if this sample ends the trial, otherwise None. The settings are then confirmed or
            rolled back, or other settings were found in force.

        Raises:
            CommunicationError: the controller does not answer, or does not take over the old settings.
        """
        trial = self.trial
        if trial is None:
            return None
        offset = self.settings.encoder_offset
        verdict = trial.observe(time, path, joint_vector(a - b for a, b in zip(measured, offset, strict=True)))
        if verdict == "running":
            return None
        if verdict == "failed":
            return self.roll_back(SELF, trial.why(), time)
        self.look_again(time)
        if self.trial is None:
            return self.last
        self.trial = None
        seen = "tracking was as predicted" if trial.judged_motion else "the arm stood still"
        text = f"{seen} for {time - trial.began:.1f} s"
        return self._record("confirm", self._tried, self.settings, time, text, measured=joint_vector(trial.measured))

    def earlier(self, version: int, who: str, why: str, based_on: int) -> Proposal:
        """A proposal that puts the settings of an earlier version into force again; it is checked like any other.

        Raises:
            ParameterError: the history has no such version, its settings are in force, or one message cannot change
                all values that differ.
        """
        found = {entry.version: entry.settings for entry in self._history.entries()}
        if version not in found:
            raise ParameterError(f"version {version}: expected one of the history, 1 to {self.version}")
        wanted = found[version]
        differing = wanted.differing(self.settings)
        if not differing:
            raise ParameterError(f"version {version}: expected another one, its settings are in force")
        proposal = _towards(wanted, differing, who, why, based_on)
        if proposal is not None:
            return proposal
        raise ParameterError(
            f"version {version}: expected that gains and target time, or the model, the payload or the offsets alone"
            f" differ from what is in force, got {', '.join(sorted(differing))}: between two messages the controller"
            " would have a mixture"
        )

    def roll_back(self, who: str, why: str, time: float) -> Entry:
        """Puts the settings before those on trial into force again, without checks, since they were in force.

        Raises:
            Refused: no settings are on trial.
            CommunicationError: the controller does not take over the settings.
        """
        trial, before = self.trial, self._before
        if trial is None or before is None:
            raise Refused("roll back: nothing is on trial")
        proposal = _towards(before, before.differing(self.settings), who, why, self.version)
        if proposal is None:
            raise Refused(f"roll back: version {self.version} differs in more than one message can change")
        self._send(before, proposal.kind)
        self.trial = None
        return self._record("roll back", proposal, before, time, measured=joint_vector(trial.measured))

    def _refuse_untimely(self, proposal: Proposal) -> None:
        if proposal.based_on != self.version:
            raise Refused(f"the settings have changed: expected version {self.version}, got {proposal.based_on}")
        if self.trial is not None:
            end = self.trial.began + self._rules.duration
            least = f"{end:.2f} s and " if end < math.inf else ""
            raise Refused(f"version {self.version} is on trial until {least}the end of a motion: expected to wait")

    def _send(self, settings: ControlSettings, kind: Kind) -> None:
        found = self._port.put(_GROUP_OF[kind], settings)
        if settings.differing(found):
            raise CommunicationError(f"the controller has not taken the {kind} it was sent: its settings are others")

    def _record(
        self,
        action: Action,
        proposal: Proposal | None,
        settings: ControlSettings,
        time: float,
        text: str = "",
        predicted: JointVector | None = None,
        measured: JointVector | None = None,
    ) -> Entry:
        changes = action in ("upload", "roll back")
        who, why, kind = (proposal.who, proposal.why, proposal.kind) if proposal else (SELF, "", "")
        self.last = Entry(self.version + changes, time, action, who, why, kind, settings, text, predicted, measured)
        self._history.append(self.last)
        return self.last

    def _found(self, version: int, settings: ControlSettings, time: float) -> Entry:
        entry = Entry(version, time, "start", SELF, "", "", settings, "found in force")
        self._history.append(entry)
        return entry

    def _resume_trial(self, entries: list[Entry]) -> None:
        """Begins a trial anew that the end of an earlier process interrupted."""
        acts = [entry for entry in entries if entry.action != "refuse"]
        if len(acts) > 1 and acts[-1].action == "upload" and acts[-1].predicted is not None:
            self._before = acts[-2].settings
            self.trial = Trial(self._rules, acts[-1].predicted)


def _towards(wanted: ControlSettings, differing: set[str], who: str, why: str, based_on: int) -> Proposal | None:
    """A proposal of settings that differ from those in force in some inputs, None if it takes several messages."""
    if differing <= set(TUNING):
        return Proposal(who, why, based_on, wanted.gains, wanted.target_time)
    if differing <= set(MODEL):
        return Proposal(who, why, based_on, model=wanted.model)
    if differing <= set(LOAD):
        return Proposal(who, why, based_on, payload=wanted.payload)
    if differing <= set(OFFSETS):
        return Proposal(who, why, based_on, encoder_offset=wanted.encoder_offset)
    return None
