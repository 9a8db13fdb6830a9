"""All commands of `dtwin`: where each is, and its line of help."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from dtwin.options import parse_apart, parse_options


@dataclass(frozen=True)
class Subcommand:
    """A subcommand.

    Attributes:
        module: module that holds its options, under dtwin.commands unless its name begins with iec61499.
        options: class of the options there.
        summary: line of help.
        read: function that reads the options from the command line.
    """

    module: str
    options: str
    summary: str
    read: Callable[[type[Any], str, Sequence[str]], Any] = parse_options

    @property
    def kind(self) -> type[Any]:
        """The class of the options, whose module is loaded."""
        found: type[Any] = getattr(importlib.import_module(self.path), self.options)
        return found

    @property
    def path(self) -> str:
        """The whole name of the module."""
        return self.module if self.module.startswith("iec61499.") else f"dtwin.commands.{self.module}"


GROUPS: Final[dict[str, dict[str, Subcommand]]] = {
    "the cell": {
        "run": Subcommand("cell.run", "Run", "run the cell: arm, boxes and function blocks; record and summarise"),
        "show": Subcommand("cell.show", "Show", "open a recording where it is worth a look"),
        "film": Subcommand("cell.film", "FilmCommand", "render a log to a film, MP4 or GIF"),
        "validate": Subcommand("cell.validate", "Validate", "hold the emulation against the analytic twin"),
        "reproduce": Subcommand(
            "cell.reproduce", "Reproduce", "measure the thesis's whole evaluation again, beside its numbers"
        ),
        "bench": Subcommand("cell.bench", "Bench", "measure the speed of the parts on this machine"),
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
        "experiment clearance": Subcommand(
            "cell.clearance", "ExperimentClearance", "sweep the arm's ways through the geometry of the cell"
        ),
        "experiment integrators": Subcommand(
            "cell.integrators", "ExperimentIntegrators", "integrate arms of machines in several ways; report"
        ),
        "experiment machines": Subcommand(
            "cell.sorting", "ExperimentMachines", "let drawn machines sort boxes among bodies that touch; report"
        ),
        "experiment soak": Subcommand(
            "cell.soak", "ExperimentSoak", "run all services for long, or trouble them; report"
        ),
    },
    "the production line": {
        "line run": Subcommand("line.run", "LineRunCommand", "run a line of cells with vehicles and twins"),
        "line demo": Subcommand("line.run", "LineDemo", "show a line that goes on when an arm fails"),
        "line up": Subcommand("line.live", "LineUp", "run a line that can be asked while it runs"),
        "line status": Subcommand("line.live", "LineStatus", "show how a running line does"),
        "line setup": Subcommand("line.live", "LineSetUp", "have other stations of a running line do operations"),
        "line release": Subcommand("line.live", "LineRelease", "let a stopped arm of a running line move again"),
        "line report": Subcommand("line.run", "LineReport", "write the page of a run of a line"),
        "experiment line": Subcommand(
            "line.experiment", "ExperimentLine", "let arms of a line fail at random; report"
        ),
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
        "fb diff": Subcommand("blocks.library", "FbDiff", "compare files, projects, or a device with a system"),
        "fb trace": Subcommand("blocks.trace", "FbTrace", "record the events of a run or a device with their data"),
        "fb replay": Subcommand("blocks.trace", "FbReplay", "repeat a trace; stop at the first event that differs"),
        "fb fuzz": Subcommand("blocks.fuzz", "FbFuzz", "trouble a device of its own with mutated input; report"),
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
        "experiment ai": Subcommand(
            "live.ai", "ExperimentAi", "let an AI answer drawn faults, call at random, change badly; report"
        ),
        "bench start": Subcommand("live.bench", "BenchStart", "time the start of a cell with all services"),
        "bench services": Subcommand("live.bench", "BenchServices", "measure what each service of a cell takes"),
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
        "experiment real": Subcommand(
            "measurements.real",
            "ExperimentReal",
            "identify an arm from a folder of real logs, beside least squares; report",
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
        "bench identify": Subcommand("identification.bench", "BenchIdentify", "time a fit against mujoco.sysid"),
        "experiment synthetic": Subcommand(
            "identification.synthetic",
            "ExperimentSynthetic",
            "identify drawn arms whose numbers are known, beside others; report",
        ),
        "experiment arms": Subcommand(
            "identification.arms", "ExperimentArms", "identify drawn machines of any arm from their motion; report"
        ),
        "experiment arm-faults": Subcommand(
            "monitoring.arm_faults", "ExperimentArmFaults", "monitor drawn machines of any arm with faults; report"
        ),
        "experiment arm-recovery": Subcommand(
            "monitoring.arm_faults", "ExperimentArmRecovery", "have faults of any arm found and answered; report"
        ),
        "experiment noise": Subcommand(
            "identification.experiment", "ExperimentNoise", "identify under encoder noise; report"
        ),
        "experiment mass": Subcommand(
            "identification.experiment", "ExperimentMass", "identify with a wrong load; report"
        ),
        "experiment strangers": Subcommand(
            "identification.strangers", "ExperimentStrangers", "identify drawn machines from their work; report"
        ),
        "experiment friction": Subcommand(
            "identification.experiment", "ExperimentFriction", "compare friction laws; report"
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
        "experiment failure": Subcommand("monitoring.experiment", "ExperimentFailure", "monitor K2 failing; report"),
        "experiment faults": Subcommand(
            "monitoring.experiment", "ExperimentFaults", "score the monitor on faults; report"
        ),
        "experiment alarms": Subcommand(
            "monitoring.alarms", "ExperimentAlarms", "commission drawn machines, watch them with faults; report"
        ),
        "experiment false-alarms": Subcommand(
            "monitoring.false_alarms", "ExperimentFalseAlarms", "count the monitor's alarms over days; report"
        ),
        "experiment sampling": Subcommand(
            "monitoring.experiment", "ExperimentSampling", "find the limits of the monitors; report"
        ),
        "experiment stop": Subcommand("monitoring.experiment", "ExperimentStop", "stop the arm on faults; report"),
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
        "bench upload": Subcommand("simulation.bench", "BenchUpload", "time uploads to a running cell"),
        "experiment margins": Subcommand(
            "simulation.experiment", "ExperimentMargins", "design the controller's gains, measure its margins; report"
        ),
        "experiment accuracy": Subcommand(
            "simulation.experiment",
            "ExperimentAccuracy",
            "hold the twin's motions against the arm's; report",
        ),
        "experiment upload": Subcommand(
            "simulation.experiment",
            "ExperimentUpload",
            "upload gains and a model to a running cell; report",
        ),
        "experiment recovery": Subcommand(
            "simulation.demo", "ExperimentRecovery", "draw faults, have each answered in a cell; report"
        ),
        "demo recovery": Subcommand("simulation.demo", "DemoRecovery", "let the twin find a fault and put it right"),
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
COMMANDS: Final = {name: entry for group in GROUPS.values() for name, entry in group.items()}
