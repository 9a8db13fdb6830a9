"""How many examples hypothesis tries: all of them in thorough runs, some of them, always the same, in any other."""

from __future__ import annotations

from typing import Any, Final

from hypothesis import settings

USUAL: Final = "usual"
THOROUGH: Final = "thorough"
EXAMPLES: Final = 50
"""Number of examples of a test that says none, in a thorough run."""
_SHARE: Final = 0.4
_FEWEST: Final = 8


def usual(count: int) -> int:
    """Number of examples of a test in a usual run that has `count` of them in a thorough one."""
    return min(count, max(_FEWEST, round(_SHARE * count)))


def examples(count: int, **options: Any) -> settings:
    """Settings of a test with `count` examples in a thorough run."""
    thorough = settings.get_current_profile_name() == THOROUGH
    return settings(max_examples=count if thorough else usual(count), **options)
