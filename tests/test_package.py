"""The package as it is installed: built from a checkout, it works in an empty folder and has but one name."""

import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

import iec61499
from dtwin import __version__
from dtwin.logs.reading import read_log
from dtwin.parameters import ROOT

LINKS = (
    "services",
    "data/fb",
    "data/models",
    "data/config",
    "data/machines",
    "data/cells",
    "data/arms",
    "data/lines",
)
"""what of dtwin/ lies elsewhere in a checkout"""
IGNORED = shutil.ignore_patterns("__pycache__", "*.egg-info", "build")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wheel of a copy of the checkout, built from its source distribution."""
    folder = tmp_path_factory.mktemp("wheel")
    copy = folder / "checkout"
    for name in ("dtwin", "services", "fb", "models", "config", "machines", "cells", "arms", "lines"):
        shutil.copytree(ROOT / name, copy / name, symlinks=True, ignore=IGNORED)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, copy / name)
    return built_wheel(copy, folder)


@pytest.fixture(scope="module")
def blocks_wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wheel of the function blocks alone, built from its source distribution."""
    folder = tmp_path_factory.mktemp("blocks")
    shutil.copytree(ROOT / "iec61499", folder / "checkout", ignore=IGNORED)
    return built_wheel(folder / "checkout", folder)


def built_wheel(checkout: Path, folder: Path) -> Path:
    """A wheel in the folder, built from the source distribution of a checkout."""
    build = "import sys, setuptools.build_meta as b; print(getattr(b, f'build_{sys.argv[1]}')(sys.argv[2]))"

    def built(kind: str, where: Path) -> Path:
        command = [sys.executable, "-P", "-c", build, kind, str(folder)]
        done = subprocess.run(command, cwd=where, capture_output=True, text=True, timeout=120, check=True)
        return folder / done.stdout.split()[-1]

    source = built("sdist", checkout)
    shutil.unpack_archive(source, folder, filter="data")
    return built("wheel", folder / source.name.removesuffix(".tar.gz"))


@pytest.fixture(scope="module")
def site(wheel: Path, blocks_wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which both wheels are installed."""
    folder = tmp_path_factory.mktemp("site")
    for each in (wheel, blocks_wheel):
        with zipfile.ZipFile(each) as content:
            content.extractall(folder)
    return folder


def run(site: Path, folder: Path, *arguments: str, status: int = 0) -> str:
    """What the installed `dtwin` prints in a folder, or says of an error."""
    # The path of a Unix socket has at most 107 bytes, which a folder of pytest may already have.
    with TemporaryDirectory() as runtime:
        done = subprocess.run(
            [sys.executable, "-m", "dtwin", *arguments],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(site), "XDG_RUNTIME_DIR": runtime},
            capture_output=True,
            text=True,
            timeout=150,
        )
    assert done.returncode == status, done.stderr
    return done.stderr if status else done.stdout


def test_a_wheel_holds_all_that_a_checkout_has_and_one_package(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    assert {name.partition("/")[0] for name in names if "dist-info" not in name} == {"dtwin"}
    assert "dtwin/py.typed" in names
    for link in LINKS:
        folder = (ROOT / "dtwin" / link).resolve()
        held = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
        held = {name for name in held if "__pycache__" not in name}
        assert held
        assert held <= {name.removeprefix(f"dtwin/{link}/") for name in names}


def test_the_wheel_of_the_blocks_holds_all_of_them_and_needs_nothing_of_the_cell(blocks_wheel: Path) -> None:
    archive = zipfile.ZipFile(blocks_wheel)
    names = {name for name in archive.namelist() if "dist-info" not in name}
    files = [path for path in (ROOT / "iec61499").rglob("*") if path.is_file()]
    own = {
        str(path.relative_to(ROOT))
        for path in files
        if not {"__pycache__", "iec61499.egg-info", "build"} & {*path.parts}
    }
    assert names == own - {"iec61499/pyproject.toml", "iec61499/README.md"}
    metadata = archive.read(next(name for name in archive.namelist() if name.endswith("/METADATA"))).decode()
    needed = {line.split()[1].partition(";")[0] for line in metadata.splitlines() if line.startswith("Requires-Dist")}
    assert needed == {"asyncua", "lark", "lxml", "msgspec", "numpy", "paho-mqtt", "pytest", "tyro", "ziglang"}
    assert f"\nVersion: {iec61499.__version__}\n" in metadata


ENDING = """;<Request ID="1" Action="CREATE"><FB Name="R" Type="EMB_RES" /></Request>
R;<Request ID="2" Action="CREATE"><FB Name="END" Type="STEST_END" /></Request>
R;<Request ID="3" Action="CREATE"><Connection Source="START.COLD" Destination="END.REQ" /></Request>
R;<Request ID="4" Action="START"/>
"""
"""A boot file that ends at once."""


def test_the_wheel_of_the_blocks_checks_and_tests_a_block_without_the_cell(
    blocks_wheel: Path, tmp_path: Path
) -> None:
    site = tmp_path / "site"
    with zipfile.ZipFile(blocks_wheel) as content:
        content.extractall(site)
    shutil.copy(ROOT / "fb" / "SAFE_STOP.fbt", tmp_path)
    (tmp_path / "end.fboot").write_text(ENDING)
    code = "import sys; from iec61499.cli import main; print(main(sys.argv[1:]), *sys.modules)"
    for words, said in (
        (("check", "SAFE_STOP.fbt"), "problems: 0"),
        (("test", "SAFE_STOP.fbt"), "passed"),
        (("diff", "SAFE_STOP.fbt", "SAFE_STOP.fbt"), "files that differ: 0"),
        (("run", "end.fboot", "--listen", "127.0.0.1:0"), ""),
    ):
        done = subprocess.run(
            [sys.executable, "-P", "-c", code, *words],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(site)},
            capture_output=True,
            text=True,
            timeout=150,
        )
        *lines, last = done.stdout.splitlines()
        status, *modules = last.split()
        assert status == "0"
        assert re.fullmatch(r"(.* WARNING resource R ended: test passed; checks made: 0\n)?", done.stderr)
        assert said in "\n".join(lines)
        assert not {"dtwin", "mujoco", "zenoh", "numba"} & set(modules)


def test_the_citation_and_the_changes_name_the_version() -> None:
    citation = (ROOT / "CITATION.cff").read_text()
    assert f"version: {__version__}\n" in citation
    assert "license: Apache-2.0\n" in citation
    assert f"\n## {__version__}" in (ROOT / "CHANGELOG.md").read_text()


def test_the_installed_cell_runs_in_an_empty_folder(site: Path, tmp_path: Path) -> None:
    options = ("--cell-file", "four-colours", "--machine", "servo")
    run(site, tmp_path, "run", "--duration", "3", "--log", "run.parquet", *options)
    assert {path.name for path in tmp_path.iterdir()} == {"run.rrd", "run.parquet"}
    assert "problems: 0" in run(site, tmp_path, "fb", "check")


def test_the_installed_services_run_in_an_empty_folder(site: Path, tmp_path: Path) -> None:
    run(site, tmp_path, "up", "--pace", "lockstep", "--duration", "3", "--log", "up.parquet", "--json")
    assert len(read_log(tmp_path / "up.parquet")) == 300


def test_what_measures_the_claims_stays_in_the_checkout(site: Path, tmp_path: Path) -> None:
    assert "experiment noise" not in run(site, tmp_path, "--help")
    said = run(site, tmp_path, "experiment", "noise", status=2)
    assert (
        said
        == "dtwin: experiment measures what the project claims: only scripts/dtwin in a checkout has that command\n"
    )
