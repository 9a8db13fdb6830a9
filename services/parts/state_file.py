"""The settings in force in the controller, kept in a file of the run, so that they outlive controller and bridge."""

from __future__ import annotations

from pathlib import Path

from dtwin.bus.codec import MessageError, Reader, encode
from dtwin.bus.messages import SettingsInForce, SettingsRequest
from dtwin.controller.device import Settings
from dtwin.controller.settings import Compensation, ControlSettings
from dtwin.errors import ParameterError, RecordingError
from dtwin.files import replacing
from dtwin.settings.change import Change, asked_of


class StateFile:
    """Keeps settings in memory and in a file; the file has the old ones or the new ones, never half of them.

    Args:
        path: file, which need not exist; without it, settings are kept in memory alone.

    Attributes:
        settings: settings that are kept, or None.
        saved: whether they are in the file.

    Raises:
        RecordingError: the file cannot be read, or holds something else.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self.settings: ControlSettings | None = None
        self.saved = True
        if path is None or not path.exists():
            return
        try:
            self.settings = from_message(Reader(SettingsInForce)(path.read_bytes()))
        except OSError as error:
            raise RecordingError(f"{path}: cannot be read: {error.strerror}") from None
        except (MessageError, ParameterError) as error:
            raise RecordingError(f"{path}: expected settings in force: {error}") from None

    def keep(self, settings: ControlSettings) -> None:
        """Keeps other settings.

        Raises:
            RecordingError: the file cannot be written; `save` may be tried again.
        """
        self.settings = settings
        self.saved = False
        self.save()

    def save(self) -> None:
        """Writes the settings if they are not in the file yet.

        Raises:
            RecordingError: the file cannot be written.
        """
        if self._path is not None and self.settings is not None and not self.saved:
            with replacing(self._path) as temporary:
                temporary.write_bytes(encode(to_message(self.settings)))
        self.saved = True


def to_message(settings: ControlSettings) -> SettingsInForce:
    """The settings as they are told on the bus."""
    return SettingsInForce(
        settings.gains,
        settings.target_time,
        settings.model,
        settings.law,
        settings.payload,
        settings.box_counts,
        settings.compensation.delay,
        settings.compensation.dead_zone,
        settings.compensation.bandwidth,
        settings.encoder_offset,
        settings.compensation.repeats,
        settings.compensation.pull,
    )


def from_message(message: SettingsInForce) -> ControlSettings:
    """The settings that a message tells.

    Raises:
        ParameterError: a value is out of range.
    """
    return ControlSettings(
        message.target_time,
        message.gains,
        message.law,
        message.model,
        message.payload,
        message.payload_model,
        Compensation(message.delay, message.dead_zone, message.bandwidth, message.repeats, message.pull),
        message.encoder_offset,
    )


def to_request(group: tuple[str, ...], settings: ControlSettings, who: str, why: str) -> SettingsRequest:
    """The request that puts one of GROUPS of some settings into force; it says not for whom and why."""
    names = next(names for names, inputs in settings.GROUPS.items() if inputs == group)
    return SettingsRequest(**{name: getattr(settings, name) for name in names})


def changed(settings: Settings, asked: SettingsRequest) -> ControlSettings:
    """What is in force after a change.

    Raises:
        ParameterError: a value is out of range, or it is not one message that is asked for.
    """
    change = Change.of(ControlSettings, asked_of(ControlSettings, asked))
    return settings.put(change.group, change.apply(settings.in_force()))
