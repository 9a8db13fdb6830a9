"""Checks the options of an emulated cell in a process that ends again, so that its starter need not load MuJoCo."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Final

from dtwin.run.emulate import emulate
from dtwin.run.options import PlantOptions
from dtwin.services.service import main

NAME: Final = "check"


@dataclass(frozen=True, kw_only=True)
class Options(PlantOptions):
    """Make the emulated cell of the options, without running it."""

    def run(self) -> int:
        emulate(self.settings())
        return 0


if __name__ == "__main__":
    sys.exit(main(NAME, Options))
