"""The plugin of pytest: service sequences and programs are tests, and what they execute is measured.

`fb test` brings it; elsewhere `-p iec61499.testing.plugin`, or `pytest_plugins` of a conftest.py.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from iec61499.errors import ToolError
from iec61499.testing import bench, programs, session
from iec61499.testing.report import summary, write_page
from iec61499.testing.runtimes import Inapplicable
from iec61499.testing.sequences import Sequence, read_sequences, run_sequence

TYPES = (".fbt", ".fct")
PROGRAMS = (".sys", ".fboot")


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("iec61499", "IEC 61499 function blocks")
    group.addoption("--fb-runtime", default="embedded", metavar="RUNTIME", help="embedded, native, or HOST:PORT")
    group.addoption("--fb-coverage", default=None, metavar="FILE", help="measure the blocks; write a page (*.html)")
    group.addoption("--fb-blocks", default=None, metavar="DIR", help="folder of the block types")
    group.addoption("--fb-files", action="store_true", help="collect service sequences and programs that are tests")


def pytest_configure(config: pytest.Config) -> None:
    blocks = config.getoption("--fb-blocks")
    session.current = session.Session(
        config.getoption("--fb-runtime"),
        config.getoption("--fb-coverage") is not None,
        Path(blocks) if blocks else None,
    )


def pytest_unconfigure() -> None:
    session.current.end()


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    if not parent.config.getoption("--fb-files"):
        return None
    if file_path.suffix.lower() in TYPES:
        made: pytest.Collector = TypeFile.from_parent(parent, path=file_path)
        return made
    if file_path.suffix.lower() in PROGRAMS and programs.is_test(file_path):
        found: pytest.Collector = ProgramFile.from_parent(parent, path=file_path)
        return found
    return None


class BlockItem(pytest.Item):
    """A test without Python, whose failure is told in one line, and which is left out where it cannot be."""

    def runtest(self) -> None:
        try:
            self.execute()
        except Inapplicable as reason:
            pytest.skip(str(reason))

    def execute(self) -> None:
        """What is tested. Raises ToolError when it fails, Inapplicable where it cannot be tested."""
        raise NotImplementedError

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        if isinstance(excinfo.value, ToolError):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, int | None, str]:
        return self.path, None, f"{self.path.name}: {self.name}"


class TypeFile(pytest.File):
    """A type with its service sequences."""

    def collect(self) -> Iterator[pytest.Item]:
        for sequence in read_sequences(self.path):
            yield SequenceItem.from_parent(self, name=sequence.name, sequence=sequence)

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        return str(excinfo.value) if isinstance(excinfo.value, ToolError) else super().repr_failure(excinfo)


class SequenceItem(BlockItem):
    """A service sequence."""

    def __init__(self, *, sequence: Sequence, **rest: Any) -> None:
        super().__init__(**rest)
        self.sequence = sequence

    def execute(self) -> None:
        library = session.current.library(self.path.parent)
        run_sequence(self.sequence, library.find(self.path.stem))


class ProgramFile(pytest.File):
    """A program that is a test."""

    def collect(self) -> Iterator[pytest.Item]:
        yield ProgramItem.from_parent(self, name=self.path.stem)


class ProgramItem(BlockItem):
    """The run of a program to its STEST_END."""

    def execute(self) -> None:
        programs.run_program(self.path)


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown() -> None:
    session.current.close()


@pytest.fixture
def block(request: pytest.FixtureRequest) -> Any:
    """Makes blocks on a bench, as `iec61499.testing.block` does, from the folder of the test."""
    folder = bench.caller_folder({"__file__": str(request.path)})

    def make(name: str, /, **inputs: Any) -> bench.Bench:
        return bench.block(name, folder, **inputs)

    return make


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    page = config.getoption("--fb-coverage")
    if page is None:
        return
    measured = session.current.measured()
    terminalreporter.section("coverage of function blocks")
    for line in summary(measured):
        terminalreporter.write_line(line)
    if page:
        write_page(measured, Path(page))
        terminalreporter.write_line(f"page: {page}")
