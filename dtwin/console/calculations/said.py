"""What the process of a job says, line by line."""

from __future__ import annotations

import sys
from typing import Any

import msgspec


def say(**words: Any) -> None:
    """Writes one line to standard output."""
    sys.stdout.buffer.write(msgspec.json.encode(words) + b"\n")
    sys.stdout.buffer.flush()
