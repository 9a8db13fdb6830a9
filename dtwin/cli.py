"""The `dtwin` command: finds the subcommand's module, reads its options, prints errors as one line.

Only the chosen subcommand's module is imported, so that `dtwin --help` and short commands start fast.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import os
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from dtwin import __version__
from dtwin.errors import DtwinError, choices

DESCRIPTION: Final = "A digital twin of a box-sorting arm controlled by IEC 61499 function blocks."


@dataclass(frozen=True)
class Entry:
    """A subcommand: the module that holds its options, the name of the class there, and a line of help."""

    module: str
    options: str
    summary: str


GROUPS: Final[dict[str, dict[str, Entry]]] = {
    "the cell": {
        "run": Entry(
            "dtwin.commands.run", "Run", "run the cell: arm, boxes and function blocks; record and summarise"
        ),
        "validate": Entry("dtwin.commands.validate", "Validate", "hold the emulation against the analytic twin"),
        "bench": Entry("dtwin.commands.bench", "Bench", "measure the speed of the parts on this machine"),
    },
    "function blocks": {
        "fb check": Entry("dtwin.commands.fb_library", "FbCheck", "check function-block files"),
        "fb export": Entry(
            "dtwin.commands.fb_library", "FbExport", "write block types as Lua, or systems as boot files"
        ),
        "fb run": Entry(
            "dtwin.commands.fb", "FbRun", "serve function blocks as a device that management can build on"
        ),
        "fb deploy": Entry("dtwin.commands.fb_library", "FbDeploy", "build a system on a device"),
        "fb watch": Entry("dtwin.commands.fb", "FbWatch", "read values of a running device"),
        "fb stop": Entry("dtwin.commands.fb", "FbStop", "stop what runs on a device"),
    },
    "the cell as services": {
        "up": Entry("dtwin.commands.up", "UpCommand", "start the services of a cell on Zenoh and keep them running"),
        "status": Entry("dtwin.commands.up", "StatusCommand", "show how the services of a cell do"),
        "down": Entry("dtwin.commands.up", "DownCommand", "stop a cell that is up"),
        "watch": Entry("dtwin.commands.watch", "WatchCommand", "print what passes on a cell's bus"),
        "gains set": Entry("dtwin.commands.settings", "GainsSet", "set gains of the running controller"),
        "model set": Entry("dtwin.commands.settings", "ModelSet", "set the arm model of the running controller"),
        "target set": Entry("dtwin.commands.settings", "TargetSet", "set how long the motions take"),
        "stop": Entry("dtwin.commands.stop", "StopCommand", "let the function blocks stop the arm"),
        "release": Entry("dtwin.commands.stop", "ReleaseCommand", "let a stopped arm move again"),
    },
    "identification": {
        "identify": Entry(
            "dtwin.commands.identify", "Identify", "identify the arm from a log or a simulated experiment"
        ),
        "identify live": Entry("dtwin.commands.identify_live", "IdentifyLive", "excite and identify the running arm"),
        "model list": Entry("dtwin.commands.model", "ModelList", "list the identified models"),
        "model show": Entry("dtwin.commands.model", "ModelShow", "show an identified model"),
        "model diff": Entry("dtwin.commands.model", "ModelDiff", "compare two identified models"),
        "model export": Entry(
            "dtwin.commands.model", "ModelExport", "write an identified model as MJCF or parameters"
        ),
        "bench identify": Entry("dtwin.commands.bench_identify", "BenchIdentify", "time a fit against mujoco.sysid"),
        "experiment noise": Entry(
            "dtwin.commands.experiment", "ExperimentNoise", "identify under encoder noise; report"
        ),
        "experiment mass": Entry("dtwin.commands.experiment", "ExperimentMass", "identify with a wrong load; report"),
        "experiment friction": Entry(
            "dtwin.commands.experiment", "ExperimentFriction", "compare friction laws; report"
        ),
    },
    "monitoring": {
        "monitor": Entry("dtwin.commands.monitor", "MonitorCommand", "find faults of the arm in a log"),
        "monitor acknowledge": Entry(
            "dtwin.commands.acknowledge", "MonitorAcknowledge", "take the running arm as it is to be normal"
        ),
        "experiment failure": Entry(
            "dtwin.commands.experiment_monitoring", "ExperimentFailure", "monitor K2 failing; report"
        ),
        "experiment faults": Entry(
            "dtwin.commands.experiment_monitoring", "ExperimentFaults", "score the monitor on faults"
        ),
        "experiment sampling": Entry(
            "dtwin.commands.experiment_monitoring", "ExperimentSampling", "limits of the monitors"
        ),
        "experiment stop": Entry(
            "dtwin.commands.experiment_monitoring", "ExperimentStop", "stop the arm on faults; report"
        ),
    },
    "simulation": {
        "simulate": Entry(
            "dtwin.commands.simulate", "Simulate", "try a motion on the twin with the real function blocks"
        ),
        "optimise": Entry("dtwin.commands.optimise", "Optimise", "search the best gains and target time on the twin"),
        "upload gains": Entry(
            "dtwin.commands.upload", "UploadGains", "check gains, upload them to a running cell, on trial"
        ),
        "upload model": Entry("dtwin.commands.upload", "UploadModel", "the same with an identified model"),
        "upload target": Entry("dtwin.commands.upload", "UploadTarget", "the same with the target time"),
        "upload version": Entry("dtwin.commands.upload", "UploadVersion", "the same with an earlier version"),
        "upload rollback": Entry("dtwin.commands.upload", "RollBack", "take back the settings on trial"),
        "history": Entry("dtwin.commands.history", "ShowHistory", "show all changes of the controller's settings"),
        "bench upload": Entry("dtwin.commands.bench_upload", "BenchUpload", "time uploads to a running cell"),
        "experiment accuracy": Entry(
            "dtwin.commands.experiment_simulation",
            "ExperimentAccuracy",
            "hold the twin's motions against the arm's; report",
        ),
        "experiment upload": Entry(
            "dtwin.commands.experiment_simulation",
            "ExperimentUpload",
            "upload gains and a model to a running cell; report",
        ),
        "demo recovery": Entry("dtwin.commands.demo", "DemoRecovery", "let the twin find a fault and put it right"),
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
    options = getattr(importlib.import_module(entry.module), entry.options)
    command = parse_options(options, f"dtwin {name}", arguments[words:])
    status: int = command.execute()
    return status


def parse_options(options: Callable[..., Any], prog: str, arguments: Sequence[str]) -> Any:
    """An instance of the dataclass `options` from command-line arguments.

    Raises:
        DtwinError: the arguments cannot be read. SystemExit: help was asked for and printed.
    """
    import tyro

    complaint = io.StringIO()
    try:
        with contextlib.redirect_stderr(complaint):
            return tyro.cli(
                options,
                prog=prog,
                args=list(arguments),
                config=(tyro.conf.UseAppendAction, tyro.conf.FlagCreatePairsOff),
            )
    except SystemExit as exit_:
        if exit_.code == 0:
            raise
        raise DtwinError(_one_line(complaint.getvalue(), prog)) from None


def _one_line(box: str, prog: str) -> str:
    """The parser's boxed complaint as one line: what is wrong, the nearest options, where to read more."""
    sections = re.split(r"[─-]{3,}", " ".join(line.strip("│|╭╮╰╯+ ") for line in box.splitlines()[1:]))
    complaint, *rest = [section.strip() for section in sections if section.strip()]
    suggestion = next((section for section in rest if "Perhaps you meant" in section), "")
    nearest = dict.fromkeys(re.findall(r"--[a-z][a-z-]*", suggestion))
    hint = f"; perhaps you meant {choices(nearest)}" if nearest else ""
    return f"{complaint}{hint} (see {prog} --help)"


def _overview() -> str:
    width = max(len(name) for name in COMMANDS)
    lines = [f"usage: dtwin COMMAND [OPTIONS]\n\n{DESCRIPTION}"]
    for title, group in GROUPS.items():
        lines += [f"\n{title}:", *(f"  {name:<{width}}  {entry.summary}" for name, entry in group.items())]
    lines.append("\ndtwin COMMAND --help shows the options of one command; dtwin --version the version.")
    return "\n".join(lines)
