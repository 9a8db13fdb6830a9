"""The `fb` command: checks, tests, lays out, compares, runs, deploys and watches function blocks without a cell."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import Any, Final

import tyro

from iec61499 import __version__
from iec61499.commands.check import FbCheck
from iec61499.commands.comparing import FbOutline
from iec61499.commands.deploying import FbDeploy, FbDiff, FbExport
from iec61499.commands.devices import FbForce, FbStart, FbStop, FbTrigger, FbWatch
from iec61499.commands.formatting import FbFormat
from iec61499.commands.running import FbRun
from iec61499.commands.testing import FbTest
from iec61499.commands.tracing import FbReplay, FbTrace
from iec61499.errors import ToolError
from iec61499.output import printable

COMMANDS: Final[dict[str, Any]] = {
    "check": FbCheck,
    "test": FbTest,
    "format": FbFormat,
    "outline": FbOutline,
    "diff": FbDiff,
    "run": FbRun,
    "deploy": FbDeploy,
    "export": FbExport,
    "watch": FbWatch,
    "force": FbForce,
    "trigger": FbTrigger,
    "start": FbStart,
    "stop": FbStop,
    "trace": FbTrace,
    "replay": FbReplay,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command line; returns the exit status (0 done, 1 a check failed, 2 bad input, 130 interrupted,
    141 nobody reads on)."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    if words == ["--version"]:
        print(f"fb {__version__}")
        return 0
    try:
        command: Any = tyro.extras.subcommand_cli_from_dict(
            COMMANDS,
            prog="fb",
            description="Check, test, lay out, run, deploy and watch IEC 61499 function blocks.",
            args=words,
        )
        status: int = command.execute()
        return status
    except ToolError as error:
        print(f"fb: {printable(str(error))}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("fb: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:  # its reader has gone; what is left must not fail once more at the end
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141


if __name__ == "__main__":
    sys.exit(main())
