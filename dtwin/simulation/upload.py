"""Uploads settings to a running controller: checked, acknowledged, on trial, taken back when they disappoint."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Final, Literal

from dtwin.controller.ports import MODEL, TUNING
from dtwin.controller.settings import ControlSettings
from dtwin.controller.settings_port import SettingsPort
from dtwin.errors import CommunicationError, ParameterError
from dtwin.parameters import ArmParameters, Gains, Triple
from dtwin.simulation.checks import Checker, Refused
from dtwin.simulation.history import Action, Entry, History
from dtwin.simulation.trial import Trial, TrialRules

Kind = Literal["gains", "target", "model", ""]
SELF: Final = "dtwin"
"""who it is that confirms and rolls back"""


@dataclass(frozen=True, slots=True)
class Proposal:
    """New settings: gains and target time, one of them, or a model.

    Attributes:
        who: wants it.
        why: in their words.
        based_on: version of the settings that they have seen.
        gains: new gains.
        target_time: new target time, s.
        model: new model of the arm.

    Raises:
        ParameterError: there is nothing new, or a model together with something else: they are two messages and could
            not come into force at once.
    """

    who: str
    why: str
    based_on: int
    gains: Gains | None = None
    target_time: float | None = None
    model: ArmParameters | None = None

    def __post_init__(self) -> None:
        tuned = self.gains is not None or self.target_time is not None
        if tuned == (self.model is not None):
            raise ParameterError("upload: expected gains, a target time or both, or a model alone")

    @property
    def kind(self) -> Kind:
        """What is to change, by the name of the command."""
        if self.model is not None:
            return "model"
        return "gains" if self.gains is not None else "target"

    def applied(self, settings: ControlSettings) -> ControlSettings:
        """The settings as they will be."""
        return changed(settings, self.gains, self.target_time, self.model)


def changed(
    settings: ControlSettings, gains: Gains | None, target_time: float | None, model: ArmParameters | None
) -> ControlSettings:
    """The settings with what is not None in place of theirs."""
    return replace(
        settings,
        gains=settings.gains if gains is None else gains,
        target_time=settings.target_time if target_time is None else target_time,
        model=settings.model if model is None else model,
    )


class Uploader:
    """The one who changes a controller's settings, and answers for it.

    Args:
        port: to the controller.
        history: of its settings; what it says to be in force is compared with what is.
        checker: that must agree to new settings.
        rules: of the trial.
        time: plant time, s.

    Attributes:
        last: newest entry of the history; its settings are in force.
        trial: that is running; None when there is none.

    Raises:
        CommunicationError: the controller does not answer. RecordingError: the history cannot be used.
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
            self._resume_trial(entries, time)
        else:
            self.last = self._found(entries[-1].version + 1 if entries else 1, found, time)

    @property
    def settings(self) -> ControlSettings:
        """In force."""
        return self.last.settings

    @property
    def version(self) -> int:
        """Of the settings in force."""
        return self.last.version

    def look_again(self, time: float) -> None:
        """Notices settings that somebody else has given the controller; they end a trial.

        Raises:
            CommunicationError: the controller does not answer.
        """
        found = self._port.read_back()
        if self.settings.differing(found):
            self.trial = None
            self.last = self._found(self.version + 1, found, time)

    def upload(self, proposal: Proposal, time: float, arm: ArmParameters | None = None) -> Entry:
        """Puts new settings into force, on trial.

        Args:
            proposal: what to change, by whom and why.
            time: plant time, s.
            arm: as the twin knows it; the controller's model, as proposed, when None.

        Returns:
            the entry of the history, after the controller has shown that it has the settings.

        Raises:
            Refused: there is a reason not to; it is in the history.
            CommunicationError: the controller does not answer, or has not taken what it was sent.
        """
        settings = proposal.applied(self.settings)
        try:
            self._refuse_untimely(proposal)
            prediction = self._checker.check(settings, arm or settings.model)
        except Refused as reason:
            self._record("refuse", proposal, self.settings, time, str(reason))
            raise
        self._before, self._tried = self.settings, proposal
        self.trial = Trial(self._rules, time, prediction.tracking)
        # in the history first: should this process end now, the next one watches them or finds the old ones
        entry = self._record("upload", proposal, settings, time, predicted=prediction.tracking)
        try:
            self._send(settings, proposal.kind)
        except CommunicationError:
            with suppress(CommunicationError):
                self.look_again(time)
            raise
        return entry

    def observe(self, time: float, path: Triple, measured: Triple) -> Entry | None:
        """Judges a sample, while a trial runs.

        Args:
            time: plant time, s.
            path: desired angles, rad.
            measured: angles, rad.

        Returns:
            the entry that ends the trial, when this sample does: the settings are confirmed or rolled back, or others
            are found in force.

        Raises:
            CommunicationError: the controller does not answer, or does not take the settings back.
        """
        trial = self.trial
        if trial is None:
            return None
        verdict = trial.observe(time, path, measured)
        if verdict == "running":
            return None
        if verdict == "failed":
            away, bound = trial.measured[trial.offender - 1], trial.bounds[trial.offender - 1]
            why = f"joint {trial.offender} is {away:.3g} rad from its path, expected at most {bound:.3g}"
            return self.roll_back(SELF, why, time)
        self.look_again(time)
        if self.trial is None:
            return self.last
        self.trial = None
        seen = "tracking was as predicted" if trial.judged_motion else "the arm stood still"
        text = f"{seen} for {time - trial.began:.1f} s"
        return self._record("confirm", self._tried, self.settings, time, text, measured=trial.measured)

    def earlier(self, version: int, who: str, why: str, based_on: int) -> Proposal:
        """What would put the settings of an earlier version into force again; they need the checks of any upload.

        Raises:
            ParameterError: the history has no such version, it is in force, or one message cannot change all that
                differs.
        """
        found = {entry.version: entry.settings for entry in self._history.entries()}
        if version not in found:
            raise ParameterError(f"version {version}: expected one of the history, 1 to {self.version}")
        wanted = found[version]
        differing = wanted.differing(self.settings)
        if not differing:
            raise ParameterError(f"version {version}: expected another one, its settings are in force")
        if differing <= set(TUNING):
            return Proposal(who, why, based_on, wanted.gains, wanted.target_time)
        if differing <= set(MODEL):
            return Proposal(who, why, based_on, model=wanted.model)
        raise ParameterError(
            f"version {version}: expected that gains and target time or the model alone differ from what is in force,"
            f" got {', '.join(sorted(differing))}: between two messages the controller would have a mixture"
        )

    def roll_back(self, who: str, why: str, time: float) -> Entry:
        """Puts the settings before those on trial into force again; they need no check, they were in force.

        Raises:
            Refused: nothing is on trial. CommunicationError: the controller does not take them.
        """
        trial, before = self.trial, self._before
        if trial is None or before is None:
            raise Refused("roll back: nothing is on trial")
        if before.differing(self.settings) <= set(TUNING):
            proposal = Proposal(who, why, self.version, before.gains, before.target_time)
        else:
            proposal = Proposal(who, why, self.version, model=before.model)
        self._send(before, proposal.kind)
        self.trial = None
        return self._record("roll back", proposal, before, time, measured=trial.measured)

    def _refuse_untimely(self, proposal: Proposal) -> None:
        if proposal.based_on != self.version:
            raise Refused(f"the settings have changed: expected version {self.version}, got {proposal.based_on}")
        if self.trial is not None:
            end = self.trial.began + self._rules.duration
            raise Refused(
                f"version {self.version} is on trial until {end:.2f} s and the end of a motion: expected to wait"
            )

    def _send(self, settings: ControlSettings, kind: Kind) -> None:
        if kind == "model":
            found = self._port.send_model(settings.model)
        else:
            found = self._port.send_gains(settings.gains, settings.target_time)
        if settings.differing(found):
            raise CommunicationError(f"the controller has not taken the {kind} it was sent: its settings are others")

    def _record(
        self,
        action: Action,
        proposal: Proposal | None,
        settings: ControlSettings,
        time: float,
        text: str = "",
        predicted: Triple | None = None,
        measured: Triple | None = None,
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

    def _resume_trial(self, entries: list[Entry], time: float) -> None:
        """Takes up a trial that the end of a process cut short."""
        acts = [entry for entry in entries if entry.action != "refuse"]
        if len(acts) > 1 and acts[-1].action == "upload" and acts[-1].predicted is not None:
            self._before = acts[-2].settings
            self.trial = Trial(self._rules, time, acts[-1].predicted)
