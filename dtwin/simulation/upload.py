"""Uploads settings to a running controller: checked, acknowledged, tried, and rolled back when the trial fails."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any, Final, Generic, Protocol, TypeVar

from dtwin.errors import CommunicationError, ParameterError
from dtwin.parameters import JointVector
from dtwin.settings.change import Change, Proposal, Refused, S
from dtwin.simulation.history import SELF, Action
from dtwin.simulation.trial import Trial, TrialRules

LONGEST_TEXT: Final = 1000
"""Length of a reason or an outcome in a history, characters."""


class Port(Protocol[S]):
    """A running controller as uploads see it. Both raise CommunicationError when it does not answer, or refuses."""

    def put(self, group: tuple[str, ...], settings: S, who: str, why: str) -> S:
        """Puts one of the groups of some settings into force; returns all that are in force then."""

    def read_back(self) -> S:
        """The settings in force."""


class Act(Protocol):
    """An entry of a history: one action on the settings."""

    @property
    def version(self) -> int: ...
    @property
    def time(self) -> float: ...
    @property
    def action(self) -> Action: ...
    @property
    def why(self) -> str: ...
    @property
    def kind(self) -> str: ...
    @property
    def settings(self) -> Any: ...
    @property
    def text(self) -> str: ...
    @property
    def predicted(self) -> JointVector | None: ...


E = TypeVar("E", bound=Act)


class Entries(Protocol[E]):
    """A history of settings."""

    @property
    def make(self) -> Callable[..., E]: ...
    def entries(self) -> list[E]: ...
    def append(self, *entries: E) -> None: ...


class Uploader(Generic[S, E]):
    """Changes the settings of a controller and watches them on trial.

    Args:
        port: port through which settings reach the controller.
        history: history of the settings, which is compared with the settings in force.
        check: largest distance of each joint from its path that the twin expects of settings beside those in force;
            raises ParameterError for settings that must not be uploaded.
        rules: rules of the trial.
        time: plant time, s.
        forgotten: settings with which the controller begins anew, if nobody else gives it those that were in force.
            A controller that has them has forgotten the others.

    Attributes:
        last: newest entry of the history, whose settings are in force.
        trial: trial that is running, or None.

    Raises:
        CommunicationError: the controller does not answer.
        RecordingError: the history cannot be used.
    """

    def __init__(
        self,
        port: Port[S],
        history: Entries[E],
        check: Callable[[S, S], JointVector],
        rules: TrialRules | None = None,
        time: float = 0.0,
        forgotten: S | None = None,
    ) -> None:
        self.trial: Trial | None = None
        self._port = port
        self._history = history
        self._check = check
        self._rules = rules or TrialRules()
        self._forgotten = forgotten
        self._before: S | None = None
        self._tried: Proposal[S] | None = None
        entries = history.entries()
        found = port.read_back()
        if entries and not entries[-1].settings.differing(found):
            self.last = entries[-1]
            self._resume_trial(entries)
        else:
            self.last = self._found(entries[-1].version + 1 if entries else 1, found, time)

    @property
    def settings(self) -> S:
        """The settings in force."""
        settings: S = self.last.settings
        return settings

    @property
    def version(self) -> int:
        """The version of the settings in force."""
        return self.last.version

    def look_again(self, time: float) -> bool:
        """Looks whether the controller still has the settings in force.

        Those that it has forgotten are given to it again; a trial begins anew then, since nobody knows since when it
        has judged others. Those that something else has given it are recorded, and end a trial.

        Returns:
            whether it had forgotten them.

        Raises:
            CommunicationError: the controller does not answer, or refuses.
        """
        found, forgotten = self._port.read_back(), self._forgotten
        if not self.settings.differing(found):
            return False
        lost = Change.towards(self.settings, found)
        if lost is None or forgotten is None or forgotten.differing(found):
            self._note(found, time)
            return False
        self._send(SELF, f"version {self.version} again", lost, self.settings)
        if self.trial is not None:
            self.trial = self.trial.anew()
        return True

    def upload(self, proposal: Proposal[S], time: float, check: Callable[[S, S], JointVector] | None = None) -> E:
        """Puts new settings into force, on trial.

        Args:
            proposal: new settings.
            time: plant time, s.
            check: what takes the place of the usual check, such as that of another arm.

        Returns:
            The entry of the history, after the settings have been read back from the controller.

        Raises:
            ParameterError: the settings must not be uploaded; the refusal is in the history.
            CommunicationError: the controller does not answer, or has not taken over the settings.
        """
        try:
            self.refuse_outdated(proposal)
            settings = proposal.change.apply(self.settings)
            if self.trial is not None:
                raise Refused(f"version {self.version} is on trial until {self.trial.ends()}: expected to wait")
            predicted = (check or self._check)(settings, self.settings)
        except ParameterError as reason:
            self._record("refuse", proposal, self.settings, time, str(reason))
            raise
        self._before, self._tried = self.settings, proposal
        self.trial = Trial(self._rules, predicted)
        # The history comes first: if this process ends now, the next one watches the settings or finds the old ones.
        entry = self._record("upload", proposal, settings, time, predicted=predicted)
        try:
            self._send(proposal.who, proposal.why, proposal.change, settings)
        except CommunicationError:
            with suppress(CommunicationError):
                self._note(self._port.read_back(), time)
            raise
        return entry

    def refuse_outdated(self, proposal: Proposal[S]) -> None:
        """Refuses what is based on settings that are not in force any more; raises Refused."""
        if proposal.based_on != self.version:
            raise Refused(f"the settings have changed: expected version {self.version}, got {proposal.based_on}")

    def observe(self, time: float, path: JointVector, measured: JointVector) -> E | None:
        """Judges a sample while a trial runs.

        Args:
            time: plant time, s.
            path: desired positions, rad or m.
            measured: measured positions without what the encoders are known to read too much, rad or m.

        Returns:
            The entry of the history if this sample ends the trial, otherwise None. The settings are then confirmed or
            rolled back, or other settings were found in force.

        Raises:
            CommunicationError: the controller does not answer, or does not take over the old settings.
        """
        trial = self.trial
        if trial is None:
            return None
        verdict = trial.observe(time, path, measured)
        if verdict == "running":
            return None
        if verdict == "failed":
            return self.roll_back(SELF, trial.why(), time)
        if self.look_again(time):
            return None
        if self.trial is None:
            return self.last
        seen = "tracking was as predicted" if trial.judged_motion else "the arm stood still"
        text = f"{seen} for {time - trial.began:.1f} s"
        entry = self._record("confirm", self._tried, self.settings, time, text, measured=trial.measured)
        self.trial = None
        return entry

    def miss(self, time: float) -> E | None:
        """Takes note that the command which answers the sample of a plant time (s) came late or never.

        Returns:
            The entry of the history if this ends the trial: an arm that is stopped obeys nothing, and cannot be
            judged.

        Raises:
            CommunicationError: the controller does not take over the old settings.
        """
        trial = self.trial
        if trial is None:
            return None
        trial.miss(time)
        return self.roll_back(SELF, trial.why(), time) if trial.is_over(time) else None

    def earlier(self, version: int) -> Change[S]:
        """The change that puts the settings of an earlier version into force again; it is checked like any other.

        Raises:
            ParameterError: the history has no such version, its settings are in force, or one message cannot change
                all values that differ.
        """
        found = {entry.version: entry.settings for entry in self._history.entries()}
        if version not in found:
            raise ParameterError(f"version {version}: expected one of the history, 1 to {self.version}")
        wanted: S = found[version]
        if not (differing := wanted.differing(self.settings)):
            raise ParameterError(f"version {version}: expected another one, its settings are in force")
        if (change := Change.towards(wanted, self.settings)) is not None:
            return change
        raise ParameterError(
            f"version {version}: expected that {wanted.EXPECTED} differ from what is in force, got"
            f" {', '.join(sorted(differing))}: between two messages the controller would have a mixture"
        )

    def roll_back(self, who: str, why: str, time: float) -> E:
        """Puts the settings before those on trial into force again, without checks, since they were in force.

        Raises:
            Refused: no settings are on trial.
            CommunicationError: the controller does not take over the settings.
        """
        trial, before = self.trial, self._before
        if trial is None or before is None:
            raise Refused("roll back: nothing is on trial")
        change = Change.towards(before, self.settings)
        if change is None:
            raise Refused(f"roll back: version {self.version} differs in more than one message can change")
        self._send(who, why, change, before)
        # Who asks meanwhile finds no trial that is over without what came of it.
        proposal = Proposal(who, why, self.version, change)
        entry = self._record("roll back", proposal, before, time, measured=trial.measured)
        self.trial = None
        return entry

    def _send(self, who: str, why: str, change: Change[S], settings: S) -> None:
        found = self._port.put(change.group, settings, who, why[:LONGEST_TEXT])
        if settings.differing(found):
            raise CommunicationError(
                f"the controller has not taken the {change.kind} it was sent: its settings are others"
            )

    def _record(
        self,
        action: Action,
        proposal: Proposal[S] | None,
        settings: S,
        time: float,
        text: str = "",
        *,
        predicted: JointVector | None = None,
        measured: JointVector | None = None,
    ) -> E:
        version = self.version + (action in ("upload", "roll back"))
        who, why, kind = (proposal.who, proposal.why, proposal.change.kind) if proposal else (SELF, "", "")
        told = why[:LONGEST_TEXT], kind, settings, text[:LONGEST_TEXT]
        self.last = self._history.make(version, time, action, who, *told, predicted=predicted, measured=measured)
        self._history.append(self.last)
        return self.last

    def _note(self, found: S, time: float) -> None:
        """Records settings in force that are others than those of the history; they end a trial."""
        if self.settings.differing(found):
            self.trial = None
            self.last = self._found(self.version + 1, found, time)

    def _found(self, version: int, settings: S, time: float) -> E:
        entry = self._history.make(version, time, "start", SELF, "", "", settings, "found in force")
        self._history.append(entry)
        return entry

    def _resume_trial(self, entries: list[E]) -> None:
        """Begins a trial anew that the end of an earlier process interrupted."""
        acts = [entry for entry in entries if entry.action != "refuse"]
        if len(acts) > 1 and acts[-1].action == "upload" and acts[-1].predicted is not None:
            self._before = acts[-2].settings
            self.trial = Trial(self._rules, acts[-1].predicted)
