"""The shipped configuration of a secured cell, with certificates of its own."""

import subprocess
from pathlib import Path
from typing import Final

from dtwin.parameters import ROOT
from tests.support.ports import free_port

SECURED: Final = ROOT / "config" / "secured"


def certify(folder: Path, *names: str) -> None:
    subprocess.run([ROOT / "scripts" / "certificates", folder, *names], check=True, timeout=60)


def copy_secured(folder: Path) -> None:
    """Writes the configuration to a folder, at a free port, and makes its certificates."""
    port = str(free_port())
    for file in SECURED.glob("*.json5"):
        text = file.read_text().replace("7447", port).replace("0.0.0.0", "127.0.0.1")
        (folder / file.name).write_text(text)
    certify(folder / "certificates")
