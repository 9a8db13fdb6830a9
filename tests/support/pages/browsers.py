"""Where the browser of the tests is."""

import os
import shutil
from typing import Final

ARGUMENTS: Final = ["--no-sandbox"]
"""In a container there is no room for chromium's own sandbox; what it opens here is the project's own page."""

DISPLAYS: Final = ("overview", "identification", "monitoring", "simulation", "alarms", "replay")
"""Names of the displays in addresses."""


def find_chromium() -> str | None:
    """Path of a chromium, None without one."""
    return os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
