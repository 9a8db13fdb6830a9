"""FMUs are made once for all tests, whichever process has them first."""

from __future__ import annotations

import fcntl
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from dtwin.fmu.archive import write_fmu
from dtwin.fmu.sources import Subject, Version

Made = Callable[[Subject, Version], Path]
"""Gives the folder of an unpacked FMU."""


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Made:
    own = tmp_path_factory.getbasetemp()
    base = (own if worker_id == "master" else own.parent) / "fmus"
    base.mkdir(exist_ok=True)

    def make(subject: Subject, version: Version) -> Path:
        file, folder = base / f"{subject}-{version}.fmu", base / f"{subject}-{version}"
        with file.with_suffix(".lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not folder.exists():
                write_fmu(file, subject, version)
                with zipfile.ZipFile(file) as archive:
                    archive.extractall(folder)
        return folder

    return make
