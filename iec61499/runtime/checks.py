"""What the blocks TEST_CONDITION and STEST_END of a program have found."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from iec61499.errors import FunctionBlockError

CHECK: Final = "TEST_CONDITION"
"""Type of a block that checks."""
END: Final = "STEST_END"
"""Type of the block that ends a test."""
NAMED: Final = 5
"""Most blocks whose failure is told by name."""


class EndOfTest(FunctionBlockError):
    """An STEST_END has ended the test; all checks may have passed."""


@dataclass(slots=True)
class Checks:
    """The checks of a program so far.

    Attributes:
        made: how many there were.
        failed: names of the blocks that found FALSE, in the order in which they first did.
    """

    made: int = 0
    failed: dict[str, None] = field(default_factory=dict)

    def add(self, block: str, passed: bool) -> None:
        """Counts what a block has found."""
        self.made += 1
        if not passed:
            self.failed[block] = None

    def __str__(self) -> str:
        if self.failed:
            names = ", ".join(list(self.failed)[:NAMED])
            return f"test failed at {names}{' and others' * (len(self.failed) > NAMED)}; checks made: {self.made}"
        return f"test passed; checks made: {self.made}"
