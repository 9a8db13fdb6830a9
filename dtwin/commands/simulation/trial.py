"""How a command waits for the trial of settings that it has uploaded."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final, TypeVar

from dtwin.bus.chain.messages import JointUpload
from dtwin.bus.twin_messages import Upload
from dtwin.errors import CommunicationError
from dtwin.terminal import print_json

_LOOK: Final = 0.2
"""Time between two looks at a trial, s."""
_PATIENCE: Final = 120.0
"""Time for a trial to end, s."""
U = TypeVar("U", Upload, JointUpload)


def outcome(answer: U, look: Callable[[], U], wait: bool) -> int:
    """Prints the answer to an upload and, if that is waited for, what came of its trial.

    Args:
        answer: the answer.
        look: gives how the settings are on trial now.
        wait: whether to wait until the trial is over.

    Returns:
        The exit status of the command: 1 if the settings were rolled back.

    Raises:
        CommunicationError: nobody answers, or the trial does not end.
    """
    print_json(answer)
    if not wait:
        return 0
    deadline = time.monotonic() + _PATIENCE
    while answer.on_trial:
        if time.monotonic() > deadline:
            raise CommunicationError(f"the trial of version {answer.version} goes on after {_PATIENCE:g} s")
        time.sleep(_LOOK)
        answer = look()
    print_json(answer)
    return 0 if answer.action == "confirm" else 1
