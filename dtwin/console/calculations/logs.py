"""The logs that can be looked at."""

from __future__ import annotations

from pathlib import Path


def logs_in(folder: Path | None) -> list[str]:
    """Names of the logs in a folder."""
    return [] if folder is None or not folder.is_dir() else sorted(path.name for path in folder.glob("*.parquet"))
