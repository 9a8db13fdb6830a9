"""FMUs are made once for all tests."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from dtwin.fmu.archive import write_fmu
from dtwin.fmu.sources import Subject, Version

Made = Callable[[Subject, Version], Path]
"""Gives the folder of an unpacked FMU."""


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    base = tmp_path_factory.mktemp("fmus")

    def make(subject: Subject, version: Version) -> Path:
        file, folder = base / f"{subject}-{version}.fmu", base / f"{subject}-{version}"
        if not folder.exists():
            write_fmu(file, subject, version)
            with zipfile.ZipFile(file) as archive:
                archive.extractall(folder)
        return folder

    return make
