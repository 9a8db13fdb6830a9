"""Uploads models and tunings to the running blocks of an arm: checked, tried, kept in a history, and taken back."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Protocol

from dtwin.arm.model import ArmSettings
from dtwin.errors import CommunicationError, ParameterError
from dtwin.parameters import JointVector
from dtwin.simulation.chain.history import ArmEntry, ArmHistory
from dtwin.simulation.history import SELF, Action
from dtwin.simulation.trial import Trial, TrialRules

RULES: Final = TrialRules(longest=30.0)
"""A trial lasts at least 10 s and until a whole way has been judged; at most 30 s where an arm never rests."""


class SettingsPort(Protocol):
    """The running blocks, as uploads see them. Both raise CommunicationError when nobody answers, or refuses."""

    def send(self, who: str, why: str, settings: ArmSettings) -> None:
        """Gives the blocks other settings."""

    def read_back(self) -> ArmSettings:
        """The settings that they have."""


class ArmUploads:
    """Changes the settings of running blocks and watches them on trial.

    Args:
        port: way to the blocks.
        history: history of the settings.
        check: the distances from the path that the twin expects with settings; raises ParameterError.
        time: plant time, s.
        rules: rules of the trial.

    Attributes:
        last: newest entry of the history, whose settings are in force.
        trial: trial that is running, or None.

    Raises:
        CommunicationError: the blocks do not answer.
        RecordingError: the history cannot be used.
    """

    def __init__(
        self,
        port: SettingsPort,
        history: ArmHistory,
        check: Callable[[ArmSettings], JointVector],
        time: float = 0.0,
        rules: TrialRules = RULES,
    ) -> None:
        self.trial: Trial | None = None
        self._port = port
        self._history = history
        self._check = check
        self._rules = rules
        self._before: ArmSettings | None = None
        self._target: JointVector = ()
        self._stood = False
        found, entries = port.read_back(), history.entries()
        if entries and entries[-1].settings == found:
            self.last = entries[-1]
            self._take_up(entries)
        else:
            version = entries[-1].version + 1 if entries else 1
            self.last = self._record("start", version, SELF, "found in force", found, time)

    @property
    def version(self) -> int:
        """Version of the settings in force."""
        return self.last.version

    @property
    def on_trial(self) -> bool:
        """Whether the settings in force are on trial."""
        return self.trial is not None

    def _take_up(self, entries: list[ArmEntry]) -> None:
        """Goes on with a trial that the end of an earlier process cut short, from the next sample on."""
        acts = [entry for entry in entries if entry.action != "refuse"]
        if len(acts) > 1 and acts[-1].action == "upload" and acts[-1].predicted is not None:
            self._before, self.trial = acts[-2].settings, Trial(self._rules, acts[-1].predicted)

    @property
    def settings(self) -> ArmSettings:
        """Those in force."""
        return self.last.settings

    def look_again(self) -> bool:
        """Gives blocks that have forgotten the settings, such as those of another bridge, those in force again.

        A trial begins anew then, since nobody knows since when it has judged others.

        Returns:
            whether they had forgotten them.

        Raises:
            CommunicationError: they do not answer, or refuse.
        """
        if self._port.read_back() == self.settings:
            return False
        self._port.send(SELF, f"version {self.version} again", self.settings)
        if self.trial is not None:
            self.trial = Trial(self._rules, self.trial.predicted)
        return True

    def upload(self, who: str, why: str, based_on: int, wished: ArmSettings, time: float) -> ArmEntry:
        """Puts settings into force, on trial.

        Args:
            who: who wants it.
            why: reason in the words of who wants it.
            based_on: version that they have seen.
            wished: the settings.
            time: plant time, s.

        Raises:
            ParameterError: they must not be uploaded; the refusal is in the history.
            CommunicationError: the blocks do not answer, or refuse.
        """
        try:
            if self.on_trial:
                raise ParameterError(f"version {self.version} is on trial: wait for it, or roll it back")
            if based_on != self.version:
                raise ParameterError(f"the settings have changed: expected version {self.version}, got {based_on}")
            predicted = self._check(wished)
        except ParameterError as error:
            self.last = self._record("refuse", self.version, who, why, self.settings, time, str(error))
            raise
        before = self.settings
        # The history comes first: if this process ends now, the next one finds in it what it has to restore.
        entry = self._record("upload", self.version + 1, who, why, wished, time, predicted=predicted)
        try:
            self._port.send(who, why, wished)
        except CommunicationError:
            text = "the blocks have not taken them"
            self.last = self._record("roll back", entry.version + 1, SELF, text, before, time, text)
            raise
        self.last, self._before = entry, before
        self.trial = Trial(self._rules, predicted)
        return entry

    def earlier(self, version: int) -> ArmSettings:
        """The settings of an earlier version.

        Raises:
            ParameterError: the history has no such version.
        """
        found = {entry.version: entry.settings for entry in self._history.entries()}
        if version not in found:
            raise ParameterError(f"version {version}: expected one of the history, 1 to {self.version}")
        return found[version]

    def roll_back(self, who: str, why: str, time: float, measured: JointVector | None = None) -> ArmEntry:
        """Puts the settings before those on trial into force again, at once.

        Raises:
            ParameterError: nothing is on trial.
            CommunicationError: the blocks do not answer.
        """
        before = self._before
        if not self.on_trial or before is None:
            raise ParameterError("nothing is on trial: expected an upload before, upload an earlier version")
        self._port.send(who, why, before)
        # Who asks meanwhile finds no trial that is over without what came of it.
        self.last = self._record("roll back", self.version + 1, who, why, before, time, measured=measured)
        self.trial = self._before = None
        return self.last

    def observe(self, time: float, target: JointVector, measured: JointVector) -> ArmEntry | None:
        """Judges a sample while a trial runs.

        Args:
            time: plant time, s.
            target: desired positions, (n,).
            measured: positions without what the encoders are known to read too much, (n,).

        Returns:
            The entry of the history if this sample ends the trial.

        Raises:
            CommunicationError: the blocks do not say which settings they have, or do not take the old ones.
        """
        trial = self.trial
        if trial is None:
            return None
        begins = self._stood and target != self._target
        self._stood, self._target = target == self._target, target
        verdict = trial.observe(time, target, measured, begins)
        if verdict == "running":
            return None
        if verdict == "failed":
            return self.roll_back(SELF, trial.why(), time, trial.measured)
        if self.look_again():
            return None
        seen = "tracking was as predicted" if trial.judged_motion else "the arm stood still"
        text, measured = f"{seen} for {time - trial.began:.1f} s", trial.measured
        self.last = self._record("confirm", self.version, SELF, text, self.settings, time, text, measured=measured)
        self.trial = self._before = None
        return self.last

    def miss(self, time: float) -> ArmEntry | None:
        """Takes note that the command which answers the sample of a plant time (s) came late or never.

        Returns:
            The entry of the history if this ends the trial: an arm that is stopped obeys nothing, and cannot be
            judged.

        Raises:
            CommunicationError: the blocks do not take the old settings.
        """
        trial = self.trial
        if trial is None:
            return None
        trial.miss(time)
        return self.roll_back(SELF, trial.why(), time, trial.measured) if trial.is_over(time) else None

    def _record(
        self,
        action: Action,
        version: int,
        who: str,
        why: str,
        settings: ArmSettings,
        time: float,
        text: str = "",
        *,
        predicted: JointVector | None = None,
        measured: JointVector | None = None,
    ) -> ArmEntry:
        entry = ArmEntry(
            version,
            time,
            action,
            who,
            why[:1000],
            settings.model,
            text[:1000],
            predicted,
            measured,
            settings.tuning,
        )
        self._history.append(entry)
        return entry
