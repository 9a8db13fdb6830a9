"""How much recovery does by itself; apart, so that what only names it loads nothing."""

from typing import Literal

RecoveryMode = Literal["propose", "act"]
"""propose: a person approves every change of settings; act: changes are made at once, on trial. A finding that stops
the arm waits for nobody in either."""
