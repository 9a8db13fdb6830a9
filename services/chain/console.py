"""Shows a cell with an arm of n joints to its operators on a web page, and passes their commands on to the bus."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING

from dtwin.bus.session import Bus
from dtwin.services.chain.options import ArmCellOptions
from dtwin.services.console import NAME, Options
from dtwin.services.service import main

if TYPE_CHECKING:
    from dtwin.console.clocks import Clocks
    from dtwin.console.hub import Hub


@dataclass(frozen=True, kw_only=True)
class ArmOptions(ArmCellOptions, Options):
    """Show a running cell with another arm to its operators on a web page."""

    def hub(self, bus: Bus, cell: str, arm: str, clocks: Clocks) -> Hub:
        """What gathers what the cell says.

        Raises:
            DtwinError: a file of the arm or of its task cannot be used.
        """
        from dtwin.console.chain.hub import ChainHub

        settings = self.settings()
        return ChainHub(bus, cell, arm, clocks, settings.arm, settings.sorting)


if __name__ == "__main__":
    sys.exit(main(NAME, ArmOptions))
