"""The commands between two samples, and how far they are in doubt."""

import numpy as np
import pytest

from dtwin.monitoring.sensing.commands import closes, commands_between

OPEN, CLOSING = np.array([1.0, 2.0, 3.0, 3.0]), np.array([1.0, 2.0, 3.0, -3.0])


def test_a_command_that_was_received_is_in_no_doubt() -> None:
    ((command, doubt),) = commands_between(OPEN, CLOSING, 1, False, 0.9)
    assert (command.tolist(), doubt) == ([1.0, 2.0, 3.0], 0.0)


def test_closing_jaws_push_the_arm_until_a_box_is_held() -> None:
    assert closes(CLOSING, False)
    assert not closes(CLOSING, True)
    assert not closes(OPEN, False)
    ((_, doubt),) = commands_between(CLOSING, CLOSING, 1, False, 0.9)
    assert doubt == 0.9


def test_missing_commands_are_guessed_on_a_straight_line_and_doubted_by_how_far_it_goes() -> None:
    after = OPEN + np.array([3.0, 0.0, 0.0, 0.0])
    found = list(commands_between(OPEN, after, 3, False, 0.0))
    assert [command[0] for command, _ in found] == pytest.approx([1.0, 2.0, 3.0])
    assert [doubt for _, doubt in found] == pytest.approx([0.4] * 3)
