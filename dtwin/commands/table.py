"""All commands of `dtwin`: where each is, and its line of help."""

from __future__ import annotations

import importlib
from typing import Final

from dtwin.commands.subcommand import Subcommand
from dtwin.options import parse_apart
from dtwin.parameters import ROOT

GROUPS: Final[dict[str, dict[str, Subcommand]]] = {
    "the cell": {
        "run": Subcommand("cell.run", "Run", "run the cell: arm, boxes and function blocks; record and summarise"),
        "show": Subcommand("cell.show", "Show", "open a recording where it is worth a look"),
        "film": Subcommand("cell.film", "FilmCommand", "render a log to a film, MP4 or GIF"),
        "cell show": Subcommand("cell.cells", "CellShow", "show the file of a cell, to make another from it"),
        "cell check": Subcommand("cell.cells", "CellCheck", "check a cell file; tell how the arm reaches its places"),
        "machine list": Subcommand("cell.machine", "MachineList", "list the machines that the arm can be"),
        "machine show": Subcommand("cell.machine", "MachineShow", "show a machine as a file that can be read again"),
        "machine draw": Subcommand("cell.machine", "MachineDraw", "write the machine of a number to a file"),
        "arm import": Subcommand("arm.arms", "ArmImport", "make the file of an arm from its MJCF or URDF"),
        "arm show": Subcommand("arm.arms", "ArmShow", "show an arm: joints, drives, limits, links"),
        "arm check": Subcommand("arm.arms", "ArmCheck", "check the file of an arm; tell what is still to be added"),
        "arm list": Subcommand("arm.arms", "ArmList", "list the arms of the folder arms"),
        "arm excite": Subcommand("arm.excite", "ArmExcite", "design poses whose motion tells most of an arm"),
    },
    "the production line": {
        "line run": Subcommand("line.run", "LineRunCommand", "run a line of cells with vehicles and twins"),
        "line demo": Subcommand("line.run", "LineDemo", "show a line that goes on when an arm fails"),
        "line up": Subcommand("line.up", "LineUp", "run a line that can be asked while it runs"),
        "line status": Subcommand("line.live", "LineStatus", "show how a running line does"),
        "line setup": Subcommand("line.live", "LineSetUp", "have other stations of a running line do operations"),
        "line fault": Subcommand("line.live", "LineFault", "let the arm of a station of a running line fail"),
        "line settle": Subcommand(
            "line.live", "LineSettle", "have an arm work with the settings that its twin proposes"
        ),
        "line release": Subcommand("line.live", "LineRelease", "let a stopped arm of a running line move again"),
        "line query": Subcommand("line.run", "LineQuery", "answer a question in SQL about runs of lines"),
        "line report": Subcommand("line.run", "LineReport", "write the page of a run of a line"),
    },
    "function blocks": {
        "fb check": Subcommand("blocks.library", "FbCheck", "check function-block files"),
        "fb format": Subcommand("iec61499.commands.formatting", "FbFormat", "lay out Structured Text of block types"),
        "fb test": Subcommand("iec61499.commands.testing", "FbTest", "test function blocks"),
        "fb outline": Subcommand("iec61499.commands.comparing", "FbOutline", "print what function-block files say"),
        "fb make": Subcommand("arm.making", "FbMake", "make the function blocks of an arm"),
        "fb export": Subcommand("blocks.library", "FbExport", "write block types as Lua, or systems as boot files"),
        "fb run": Subcommand(
            "blocks.device", "FbRun", "serve function blocks as a device that management can build on"
        ),
        "fb deploy": Subcommand("blocks.library", "FbDeploy", "build a system on a device"),
        "fb diff": Subcommand(
            "iec61499.commands.deploying", "FbDiff", "compare files, projects, or a device with a system"
        ),
        "fb trace": Subcommand("blocks.trace", "FbTrace", "record the events of a run or a device with their data"),
        "fb replay": Subcommand("blocks.trace", "FbReplay", "repeat a trace; stop at the first event that differs"),
        "fb watch": Subcommand("iec61499.commands.devices", "FbWatch", "read values and counts of running devices"),
        "fb force": Subcommand("iec61499.commands.devices", "FbForce", "force values of running devices, for a time"),
        "fb trigger": Subcommand("iec61499.commands.devices", "FbTrigger", "let events of running devices happen"),
        "fb start": Subcommand("iec61499.commands.devices", "FbStart", "start resources or blocks of devices"),
        "fb stop": Subcommand("iec61499.commands.devices", "FbStop", "stop resources or blocks of devices"),
    },
    "the cell as services": {
        "up": Subcommand(
            "live.up", "UpCommand", "start the services of a cell on Zenoh and keep them running", parse_apart
        ),
        "status": Subcommand("live.status", "StatusCommand", "show how the services of a cell do", parse_apart),
        "down": Subcommand("live.status", "DownCommand", "stop a cell that is up", parse_apart),
        "watch": Subcommand("live.watch", "WatchCommand", "print what passes on a cell's bus"),
        "gains set": Subcommand("live.settings", "GainsSet", "set gains of the running controller"),
        "model set": Subcommand("live.settings", "ModelSet", "set the arm model of the running controller"),
        "target set": Subcommand("live.settings", "TargetSet", "set how long the motions take"),
        "console": Subcommand("live.console", "ConsoleCommandLine", "show a cell to its operators on a web page"),
        "console user": Subcommand("live.console", "ConsoleUser", "let somebody log in at consoles"),
        "console audit": Subcommand(
            "live.console", "ConsoleAudit", "show and check what was commanded from consoles"
        ),
        "mcp": Subcommand("live.mcp", "McpCommand", "serve a cell to an AI by the Model Context Protocol"),
        "mcp audit": Subcommand("live.mcp", "McpAudit", "show and check what an AI has called"),
        "mcp proposals": Subcommand("live.mcp", "McpProposals", "show what an AI has proposed"),
        "mcp approve": Subcommand("live.mcp", "McpApprove", "approve a proposal of an AI, which is carried out"),
        "mcp decline": Subcommand("live.mcp", "McpDecline", "decline a proposal of an AI"),
        "stop": Subcommand("live.stop", "StopCommand", "let the function blocks stop the arm", parse_apart),
        "release": Subcommand("live.stop", "ReleaseCommand", "let a stopped arm move again", parse_apart),
        "fault inject": Subcommand("live.fault", "FaultInject", "let a fault happen to the emulated arm"),
    },
    "identification": {
        "identify": Subcommand(
            "identification.identify",
            "Identify",
            "identify the arm from a log or a simulated experiment",
        ),
        "log show": Subcommand("measurements.log", "LogShow", "show what is in a log of any arm, and what is odd"),
        "log convert": Subcommand(
            "measurements.log", "LogConvert", "write a log of any arm as CSV, Parquet or MCAP, in SI units"
        ),
        "health": Subcommand(
            "measurements.health", "HealthCommand", "tell the health of a position-controlled arm from its data set"
        ),
        "commission": Subcommand(
            "identification.commission", "Commission", "identify a real arm from a log of its work; write a record"
        ),
        "identify live": Subcommand("identification.live", "IdentifyLive", "excite and identify the running arm"),
        "model list": Subcommand("identification.model", "ModelList", "list the identified models"),
        "model show": Subcommand("identification.model", "ModelShow", "show an identified model"),
        "model diff": Subcommand("identification.model", "ModelDiff", "compare two identified models"),
        "model export": Subcommand(
            "identification.model", "ModelExport", "write an identified model as MJCF or parameters"
        ),
    },
    "monitoring": {
        "monitor": Subcommand("monitoring.monitor", "MonitorCommand", "find faults of the arm in a log"),
        "monitor start": Subcommand("monitoring.watch", "MonitorStart", "let the monitor watch the arm, anew"),
        "monitor stop": Subcommand("monitoring.watch", "MonitorStop", "let the monitor leave the arm alone"),
        "monitor acknowledge": Subcommand(
            "monitoring.acknowledge",
            "MonitorAcknowledge",
            "take the running arm as it is to be normal",
        ),
    },
    "simulation": {
        "simulate": Subcommand(
            "simulation.simulate", "Simulate", "try a motion on the twin with the real function blocks"
        ),
        "margins": Subcommand(
            "simulation.margins", "MarginsCommand", "compute what change of the arm the controller stands"
        ),
        "optimise": Subcommand(
            "simulation.optimise", "Optimise", "search the best gains and target time on the twin"
        ),
        "upload arm": Subcommand(
            "simulation.upload_arm", "UploadArm", "check a model of any arm, upload it to its blocks, on trial"
        ),
        "upload gains": Subcommand(
            "simulation.upload", "UploadGains", "check gains, upload them to a running cell, on trial"
        ),
        "upload model": Subcommand(
            "simulation.upload", "UploadModel", "check an identified model, upload it, on trial"
        ),
        "upload target": Subcommand("simulation.upload", "UploadTarget", "check a target time, upload it, on trial"),
        "upload version": Subcommand(
            "simulation.upload", "UploadVersion", "check an earlier version, upload it, on trial"
        ),
        "upload rollback": Subcommand("simulation.upload", "RollBack", "take back the settings on trial"),
        "history": Subcommand("simulation.history", "ShowHistory", "show all changes of the controller's settings"),
    },
    "other simulators": {
        "fmu twin": Subcommand("exchange.fmu", "FmuTwin", "write the analytic twin as an FMU, with C inside"),
        "fmu controller": Subcommand("exchange.fmu", "FmuController", "write the control application as an FMU"),
        "fmu cell": Subcommand("exchange.fmu", "FmuCell", "write the arm under its control application as an FMU"),
    },
    "this machine": {
        "doctor": Subcommand("setup.doctor", "Doctor", "tell what is missing on this machine and how to get it"),
        "sbom": Subcommand("setup.sbom", "Sbom", "write a software bill of materials of what is installed"),
        "completion": Subcommand(
            "setup.completion", "Completion", "print a script that lets a shell complete commands"
        ),
    },
}
EVIDENCE: Final = ("demo", "validate", "reproduce", "bench", "experiment")
"""First words of commands that measure what the project claims, which a checkout has and a wheel has not."""

if (ROOT / "evidence" / "table.py").is_file():
    GROUPS["what is claimed, measured"] = importlib.import_module("evidence.table").COMMANDS

COMMANDS: Final = {name: entry for group in GROUPS.values() for name, entry in group.items()}
