"""`fb test`: service sequences, Python tests and programs that are tests, in one run of pytest."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from iec61499.errors import ToolError


@dataclass(frozen=True)
class FbTest:
    """Test function blocks: the service sequences of block types, Python tests beside them, programs that are tests.

    Types (.fbt, .fct) are tested by their <ServiceSequence> elements, Python tests are called test_*.py, and systems
    and boot files (.sys, .fboot) are tests when they have a block STEST_END. The exit status is 1 if one fails. It
    needs pytest.
    """

    files: tyro.conf.Positional[tuple[Path, ...]] = (Path(),)
    """Files, or folders of them."""
    runtime: str = "embedded"
    """What executes the blocks: embedded, in simulated time; native, as machine code; or HOST:PORT of a device, such
    as a 4diac FORTE, in real time."""
    blocks: Path | None = None
    """Folder of the block types; without it that of each test."""
    junit: Path | None = None
    """File for the results in JUnit's XML."""
    coverage: bool = False
    """Measure which states, transitions and lines of algorithms are executed; print what is not."""
    html: Path | None = None
    """Page (*.html) for what --coverage measures."""
    only: Annotated[str, tyro.conf.arg(name="only")] = ""
    """Expression that names must match, such as "counter and not slow"."""
    verbose: bool = False
    """Print a line for each test, and why tests were left out."""

    def execute(self) -> int:
        try:
            import pytest
        except ImportError:
            raise ToolError("fb test needs pytest: pip install pytest") from None

        from iec61499.testing import plugin

        missing = [str(file) for file in self.files if not file.exists()]
        if missing:
            raise ToolError(f"{missing[0]}: there is no such file or folder")
        arguments = [*map(str, self.files), "--fb-files", "--fb-runtime", self.runtime, "-p", "no:cacheprovider"]
        if self.coverage or self.html:
            arguments += ["--fb-coverage", str(self.html or "")]
        if self.blocks:
            arguments += ["--fb-blocks", str(self.blocks)]
        if self.junit:
            arguments += ["--junitxml", str(self.junit)]
        if self.only:
            arguments += ["-k", self.only]
        arguments += ["-v", "-rs"] if self.verbose else ["-q"]
        arguments += [
            "--import-mode",
            "importlib",
            "--tb",
            "short",
            "-W",
            "ignore::pytest.PytestAssertRewriteWarning",
        ]
        status = pytest.main(arguments, plugins=[plugin])
        if status == pytest.ExitCode.NO_TESTS_COLLECTED:
            print("no tests: expected <ServiceSequence> in types, test_*.py, or programs with a block STEST_END")
            return 0
        return 0 if status == pytest.ExitCode.OK else 1
