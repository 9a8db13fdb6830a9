"""Model files of installed Python packages, such as those of example-robot-data."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Final

from dtwin.errors import ModelError, choices

SCHEME: Final = "package:"
"""How such a file begins: `package://NAME/END`, with the end of the path of a file of the package NAME."""


def installed(path: Path) -> Path:
    """The file that a path stands for: itself, or a file of an installed package.

    Args:
        path: path, or `package://NAME/END`, whose slashes a Path has joined.

    Raises:
        ModelError: the package is not installed, or has no such file or several.
    """
    scheme, *rest = path.parts
    if scheme != SCHEME:
        return path
    if len(rest) < 2:
        raise ModelError(f"{path}: expected package://NAME/FILE, such as package://example-robot-data/panda.urdf")
    name, end = rest[0], tuple(rest[1:])
    try:
        files = distribution(name).files or []
    except PackageNotFoundError:
        raise ModelError(f"package {name}: is not installed: `pip install {name}`") from None
    found = [file for file in files if tuple(file.parts[-len(end) :]) == end]
    if len(found) != 1:
        alike = sorted("/".join(file.parts[-3:]) for file in (found or files) if file.suffix == path.suffix)
        raise ModelError(f"package {name}: expected one of its files, {choices(alike)}, got {'/'.join(end)}")
    return Path(str(found[0].locate()))
