"""Logs that have to be the same: where they are not, what differs first."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dtwin.logs.reading import read_log


def difference(found: Path, expected: Path) -> str:
    """What is not the same in two log files, in words; "" when their bytes are equal."""
    if found.read_bytes() == expected.read_bytes():
        return ""
    one, other = read_log(found), read_log(expected)
    said = [f"{len(one)} and {len(other)} rows"]
    rows = min(len(one), len(other))
    for name, column in other.columns.items():
        a, b = one.columns[name][:rows], column[:rows]
        differing = np.flatnonzero(~((a == b) | ((a != a) & (b != b))))
        if len(differing):
            row = differing[0]
            said.append(f"{name}: {a[row]} and {b[row]} at row {row}, {len(differing)} rows in all")
    return "; ".join(said)
