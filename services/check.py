"""Checks the options of an emulated cell in a process that ends again, so that its starter need not load MuJoCo."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Final

from dtwin.errors import ParameterError
from dtwin.run.emulate import emulate
from dtwin.run.options import PlantOptions
from services.service import main

NAME: Final = "check"


@dataclass(frozen=True, kw_only=True)
class Options(PlantOptions):
    """Make the emulated cell of the options, without running it."""

    def run(self) -> int:
        settings = self.settings()
        if settings.machine.contact.enabled:
            raise ParameterError(
                f"machine {settings.machine.name}: the line of services has no sequence for bodies that touch,"
                " expected a machine without contact"
            )
        emulate(settings)
        return 0


if __name__ == "__main__":
    sys.exit(main(NAME, Options))
