"""A change of the settings of a running controller: one value, whoever asks for it and by whatever way."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import Field, dataclass, field, replace
from typing import Any, ClassVar, Final, Generic, Protocol, Self, TypeVar

from dtwin.errors import ParameterError

_KINDS: Final = {"target_time": "target", "encoder_offset": "offset"}
"""Kinds of changes that are not called as the setting is."""


class Refused(ParameterError):
    """Reports settings that must not be uploaded; the message is the reason."""


class Settings(Protocol):
    """All settings of a controller, a frozen dataclass.

    Attributes:
        GROUPS: what of the controller holds them, by the names of settings that come into force at once.
        NAMED: settings that nothing changes while the controller runs, but which a change may be meant for alone.
        EXPECTED: what one change may consist of, in words.
    """

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]
    GROUPS: ClassVar[Mapping[tuple[str, ...], tuple[str, ...]]]
    NAMED: ClassVar[tuple[str, ...]]
    EXPECTED: ClassVar[str]

    def differing(self, other: Self) -> set[str]:
        """Names of what in the controller differs between settings, of those that the groups list."""


S = TypeVar("S", bound=Settings)


@dataclass(frozen=True, slots=True)
class Change(Generic[S]):
    """Other values for settings that come into force together.

    Attributes:
        group: what of the controller holds them, of the settings' GROUPS.
        values: the new values by the names of the settings.
        meant_for: settings that must be in force for it, by their names, as the law that gains are of.
    """

    group: tuple[str, ...]
    values: Mapping[str, Any]
    meant_for: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, kind: type[S], values: Mapping[str, Any]) -> Change[S]:
        """A change of some settings.

        Args:
            kind: settings of the controller.
            values: new values by the names of settings; None for what stays.

        Raises:
            ParameterError: this controller has no such settings, which are named; nothing is new; or it takes
                several messages, which could not come into force at once.
        """
        given = {name: value for name, value in values.items() if value is not None}
        known = [name for names in kind.GROUPS for name in names]
        if foreign := sorted(given.keys() - {*known, *kind.NAMED}):
            raise ParameterError(f"{', '.join(foreign)}: this controller has none: expected {kind.EXPECTED}")
        new = {name: given[name] for name in known if name in given}
        groups = [group for names, group in kind.GROUPS.items() if new.keys() & set(names)]
        if len(groups) != 1:
            raise ParameterError(f"settings: expected {kind.EXPECTED}")
        return cls(groups[0], new, {name: given[name] for name in kind.NAMED if name in given})

    @classmethod
    def towards(cls, wanted: S, now: S) -> Change[S] | None:
        """The change from settings to others; None if it takes several messages."""
        differing = wanted.differing(now)
        for names, group in wanted.GROUPS.items():
            if differing <= set(group):
                others = [name for name in names if getattr(wanted, name) != getattr(now, name)]
                return cls(group, {name: getattr(wanted, name) for name in others or names})
        return None

    @property
    def kind(self) -> str:
        """What changes, in a word: that of its first setting."""
        first = next(iter(self.values))
        return _KINDS.get(first, first)

    def apply(self, settings: S) -> S:
        """The given settings with these values.

        Raises:
            Refused: it is meant for others.
        """
        for name, value in self.meant_for.items():
            if (now := getattr(settings, name)) != value:
                raise Refused(f"{self.kind}: expected those of the {name} in force, {now}, got those of {value}")
        return replace(settings, **self.values)


def asked_of(kind: type[Settings], message: object) -> dict[str, Any]:
    """What a message asks of the settings of a controller, by their names; None for what it leaves as it is."""
    return {name: getattr(message, name, None) for names in (*kind.GROUPS, kind.NAMED) for name in names}


@dataclass(frozen=True, slots=True)
class Proposal(Generic[S]):
    """A change that somebody wants.

    Attributes:
        who: who wants it.
        why: reason in the words of that person.
        based_on: version of the settings that this person has seen.
        change: what shall be others.
    """

    who: str
    why: str
    based_on: int
    change: Change[S]
