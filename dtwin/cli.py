"""The `dtwin` command: finds the subcommand's module, reads its options, prints errors as one line.

Only the chosen subcommand's module is imported, so that `dtwin --help` and short commands start fast.
"""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from dtwin import __version__
from dtwin.errors import DtwinError, choices
from dtwin.options import parse_options

DESCRIPTION: Final = "A digital twin of a box-sorting arm controlled by IEC 61499 function blocks."


@dataclass(frozen=True)
class Entry:
    """A subcommand: the module under dtwin.commands that holds its options, the class there, and a line of help."""

    module: str
    options: str
    summary: str


GROUPS: Final[dict[str, dict[str, Entry]]] = {
    "the cell": {
        "run": Entry("cell.run", "Run", "run the cell: arm, boxes and function blocks; record and summarise"),
        "validate": Entry("cell.validate", "Validate", "hold the emulation against the analytic twin"),
        "bench": Entry("cell.bench", "Bench", "measure the speed of the parts on this machine"),
    },
    "function blocks": {
        "fb check": Entry("blocks.library", "FbCheck", "check function-block files"),
        "fb export": Entry("blocks.library", "FbExport", "write block types as Lua, or systems as boot files"),
        "fb run": Entry("blocks.device", "FbRun", "serve function blocks as a device that management can build on"),
        "fb deploy": Entry("blocks.library", "FbDeploy", "build a system on a device"),
        "fb watch": Entry("blocks.device", "FbWatch", "read values of a running device"),
        "fb stop": Entry("blocks.device", "FbStop", "stop what runs on a device"),
    },
    "the cell as services": {
        "up": Entry("live.up", "UpCommand", "start the services of a cell on Zenoh and keep them running"),
        "status": Entry("live.up", "StatusCommand", "show how the services of a cell do"),
        "down": Entry("live.up", "DownCommand", "stop a cell that is up"),
        "watch": Entry("live.watch", "WatchCommand", "print what passes on a cell's bus"),
        "gains set": Entry("live.settings", "GainsSet", "set gains of the running controller"),
        "model set": Entry("live.settings", "ModelSet", "set the arm model of the running controller"),
        "target set": Entry("live.settings", "TargetSet", "set how long the motions take"),
        "stop": Entry("live.stop", "StopCommand", "let the function blocks stop the arm"),
        "release": Entry("live.stop", "ReleaseCommand", "let a stopped arm move again"),
    },
    "identification": {
        "identify": Entry(
            "identification.identify",
            "Identify",
            "identify the arm from a log or a simulated experiment",
        ),
        "identify live": Entry("identification.live", "IdentifyLive", "excite and identify the running arm"),
        "model list": Entry("identification.model", "ModelList", "list the identified models"),
        "model show": Entry("identification.model", "ModelShow", "show an identified model"),
        "model diff": Entry("identification.model", "ModelDiff", "compare two identified models"),
        "model export": Entry(
            "identification.model", "ModelExport", "write an identified model as MJCF or parameters"
        ),
        "bench identify": Entry("identification.bench", "BenchIdentify", "time a fit against mujoco.sysid"),
        "experiment noise": Entry(
            "identification.experiment", "ExperimentNoise", "identify under encoder noise; report"
        ),
        "experiment mass": Entry("identification.experiment", "ExperimentMass", "identify with a wrong load; report"),
        "experiment friction": Entry(
            "identification.experiment", "ExperimentFriction", "compare friction laws; report"
        ),
    },
    "monitoring": {
        "monitor": Entry("monitoring.monitor", "MonitorCommand", "find faults of the arm in a log"),
        "monitor acknowledge": Entry(
            "monitoring.acknowledge",
            "MonitorAcknowledge",
            "take the running arm as it is to be normal",
        ),
        "experiment failure": Entry("monitoring.experiment", "ExperimentFailure", "monitor K2 failing; report"),
        "experiment faults": Entry("monitoring.experiment", "ExperimentFaults", "score the monitor on faults"),
        "experiment sampling": Entry("monitoring.experiment", "ExperimentSampling", "limits of the monitors"),
        "experiment stop": Entry("monitoring.experiment", "ExperimentStop", "stop the arm on faults; report"),
    },
    "simulation": {
        "simulate": Entry(
            "simulation.simulate", "Simulate", "try a motion on the twin with the real function blocks"
        ),
        "optimise": Entry("simulation.optimise", "Optimise", "search the best gains and target time on the twin"),
        "upload gains": Entry(
            "simulation.upload", "UploadGains", "check gains, upload them to a running cell, on trial"
        ),
        "upload model": Entry("simulation.upload", "UploadModel", "the same with an identified model"),
        "upload target": Entry("simulation.upload", "UploadTarget", "the same with the target time"),
        "upload version": Entry("simulation.upload", "UploadVersion", "the same with an earlier version"),
        "upload rollback": Entry("simulation.upload", "RollBack", "take back the settings on trial"),
        "history": Entry("simulation.history", "ShowHistory", "show all changes of the controller's settings"),
        "bench upload": Entry("simulation.bench", "BenchUpload", "time uploads to a running cell"),
        "experiment accuracy": Entry(
            "simulation.experiment",
            "ExperimentAccuracy",
            "hold the twin's motions against the arm's; report",
        ),
        "experiment upload": Entry(
            "simulation.experiment",
            "ExperimentUpload",
            "upload gains and a model to a running cell; report",
        ),
        "demo recovery": Entry("simulation.demo", "DemoRecovery", "let the twin find a fault and put it right"),
    },
}
COMMANDS: Final = {name: entry for group in GROUPS.values() for name, entry in group.items()}


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command line; returns the exit status (0 done, 1 a check failed, 2 bad input, 130 interrupted)."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    try:
        status = _dispatch(arguments)
        sys.stdout.flush()
        return status
    except DtwinError as error:
        print(f"dtwin: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("dtwin: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:
        # the reader of our output has gone; keep the interpreter's own flush at exit from complaining
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141


def _dispatch(arguments: list[str]) -> int:
    name = arguments[0] if arguments else "--help"
    if name in ("-h", "--help"):
        print(_overview())
        return 0
    if name == "--version":
        print(f"dtwin {__version__}")
        return 0
    words = 2 if " ".join(arguments[:2]) in COMMANDS else 1
    name = " ".join(arguments[:words])
    if name not in COMMANDS:
        under = [key for key in COMMANDS if key.startswith(f"{name} ")]
        raise DtwinError(f"unknown command {name!r}: expected {choices(under or COMMANDS)}")
    # All matrices here are small: threads of the linear algebra would only fight over the cores.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    entry = COMMANDS[name]
    options = getattr(importlib.import_module(f"dtwin.commands.{entry.module}"), entry.options)
    command = parse_options(options, f"dtwin {name}", arguments[words:])
    status: int = command.execute()
    return status


def _overview() -> str:
    width = max(len(name) for name in COMMANDS)
    lines = [f"usage: dtwin COMMAND [OPTIONS]\n\n{DESCRIPTION}"]
    for title, group in GROUPS.items():
        lines += [f"\n{title}:", *(f"  {name:<{width}}  {entry.summary}" for name, entry in group.items())]
    lines.append("\ndtwin COMMAND --help shows the options of one command; dtwin --version the version.")
    return "\n".join(lines)
