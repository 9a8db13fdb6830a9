"""Compiled kernels on disk: found again by other processes, and made anew when they are damaged."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

SOURCE = """
from dtwin.twin.compiled import kernel

@kernel
def twice(x):
    return x + x

print(twice(21.0), *twice.stats.cache_hits.values())
"""


def run(folder: Path, **variables: str) -> list[str]:
    """The result of the kernel and how often it was found, in a new process."""
    done = subprocess.run(
        [sys.executable, str(folder / "kernels.py")],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), **variables},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "kernels.py").write_text(SOURCE)
    return tmp_path


def damage(file: Path) -> None:
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 0xFF
    file.write_bytes(content)


@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
@pytest.mark.parametrize("how", ["cut", "changed", "empty"])
def test_a_damaged_file_is_made_anew(folder: Path, suffix: str, how: str) -> None:
    assert run(folder) == ["42.0"]
    assert run(folder) == ["42.0", "1"]
    (file,) = (folder / "__pycache__").glob(f"*.{suffix}")
    if how == "changed":
        damage(file)
    else:
        file.write_bytes(b"" if how == "empty" else file.read_bytes()[: file.stat().st_size // 2])
    assert run(folder) == ["42.0"]
    assert run(folder) == ["42.0", "1"]


def test_a_folder_that_cannot_be_written_has_its_code_in_the_users_cache(folder: Path) -> None:
    (folder / "__pycache__").write_text("in the way")
    cache = folder / "home" / ".cache"
    variables = {"XDG_CACHE_HOME": str(cache), "HOME": str(folder / "home")}
    assert run(folder, **variables) == ["42.0"]
    assert run(folder, **variables) == ["42.0", "1"]
    assert list(cache.rglob("*.nbc"))


def test_without_any_folder_every_process_compiles(folder: Path) -> None:
    (folder / "__pycache__").write_text("in the way")
    (folder / "home").write_text("in the way")
    variables = {"XDG_CACHE_HOME": str(folder / "home"), "HOME": str(folder / "home")}
    assert run(folder, **variables) == ["42.0"]
    assert run(folder, **variables) == ["42.0"]
