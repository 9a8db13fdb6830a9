"""The commands that measure what the project claims: where each is, and its line of help."""

from __future__ import annotations

from typing import Final

from dtwin.commands.subcommand import Subcommand

COMMANDS: Final[dict[str, Subcommand]] = {
    "demo recovery": Subcommand(
        "evidence.recovery.demo", "DemoRecovery", "let the twin find a fault and put it right"
    ),
    "validate": Subcommand("evidence.validation", "Validate", "hold the emulation against the analytic twin"),
    "reproduce": Subcommand(
        "evidence.reproduce.book", "Reproduce", "measure the thesis's whole evaluation again, beside its numbers"
    ),
    "bench": Subcommand("evidence.bench.parts", "Bench", "measure the speed of the parts on this machine"),
    "bench start": Subcommand("evidence.bench.services", "BenchStart", "time the start of a cell with all services"),
    "bench services": Subcommand(
        "evidence.bench.services", "BenchServices", "measure what each service of a cell takes"
    ),
    "bench line": Subcommand("evidence.bench.line", "BenchLine", "measure how fast lines of arms run headless"),
    "bench arm": Subcommand("evidence.bench.arm", "BenchArm", "measure the speed of the parts of any serial arm"),
    "bench identify": Subcommand("evidence.bench.identify", "BenchIdentify", "time a fit against mujoco.sysid"),
    "bench upload": Subcommand("evidence.bench.upload", "BenchUpload", "time uploads to a running cell"),
    "experiment clearance": Subcommand(
        "evidence.clearance", "ExperimentClearance", "sweep the arm's ways through the geometry of the cell"
    ),
    "experiment integrators": Subcommand(
        "evidence.integrators", "ExperimentIntegrators", "integrate arms of machines in several ways; report"
    ),
    "experiment machines": Subcommand(
        "evidence.sorting", "ExperimentMachines", "let drawn machines sort boxes among bodies that touch; report"
    ),
    "experiment soak": Subcommand(
        "evidence.soak.command", "ExperimentSoak", "run all services for long, or trouble them; report"
    ),
    "experiment line": Subcommand(
        "evidence.line.faults", "ExperimentLine", "let arms of a line fail at random; report"
    ),
    "experiment line-kills": Subcommand(
        "evidence.line.kills", "ExperimentLineKills", "end and freeze the processes that control a line; report"
    ),
    "experiment line-losses": Subcommand(
        "evidence.line.losses", "ExperimentLineLosses", "lose messages of a line's control, end its devices; report"
    ),
    "experiment line-outages": Subcommand(
        "evidence.line.outages", "ExperimentLineOutages", "end, freeze and cut off the twins of a line; report"
    ),
    "experiment line-answer": Subcommand(
        "evidence.line.answer", "ExperimentLineAnswer", "time the answer of a line in processes to a fault; report"
    ),
    "experiment line-scale": Subcommand(
        "evidence.line.scale", "ExperimentLineScale", "run sixteen arms in real time over a router; report"
    ),
    "experiment ai": Subcommand(
        "evidence.ai.experiment",
        "ExperimentAi",
        "let an AI answer drawn faults, call at random, change badly; report",
    ),
    "experiment real": Subcommand(
        "evidence.logs.real",
        "ExperimentReal",
        "identify an arm from a folder of real logs, beside least squares; report",
    ),
    "experiment synthetic": Subcommand(
        "evidence.synthetic.report",
        "ExperimentSynthetic",
        "identify drawn arms whose numbers are known, beside others; report",
    ),
    "experiment arms": Subcommand(
        "evidence.identification.arms",
        "ExperimentArms",
        "identify drawn machines of any arm from their motion; report",
    ),
    "experiment arm-faults": Subcommand(
        "evidence.monitoring.arm_faults",
        "ExperimentArmFaults",
        "monitor drawn machines of any arm with faults; report",
    ),
    "experiment arm-sorting": Subcommand(
        "evidence.arm_sorting",
        "ExperimentArmSorting",
        "let drawn machines of any arm sort boxes in hard circumstances; report",
    ),
    "experiment arm-encoders": Subcommand(
        "evidence.arm_encoders",
        "ExperimentArmEncoders",
        "let every encoder of any arm lie, with the function blocks alone; report",
    ),
    "experiment arm-days": Subcommand(
        "evidence.monitoring.arm_days",
        "ExperimentArmDays",
        "count false alarms of healthy arms of any kind; report",
    ),
    "experiment arm-recovery": Subcommand(
        "evidence.recovery.arms", "ExperimentArmRecovery", "have faults of any arm found and answered; report"
    ),
    "experiment noise": Subcommand(
        "evidence.identification.noise", "ExperimentNoise", "identify under encoder noise; report"
    ),
    "experiment mass": Subcommand(
        "evidence.identification.mass", "ExperimentMass", "identify with a wrong load; report"
    ),
    "experiment strangers": Subcommand(
        "evidence.identification.strangers", "ExperimentStrangers", "identify drawn machines from their work; report"
    ),
    "experiment friction": Subcommand(
        "evidence.identification.friction", "ExperimentFriction", "compare friction laws; report"
    ),
    "experiment failure": Subcommand(
        "evidence.monitoring.failure", "ExperimentFailure", "monitor K2 failing; report"
    ),
    "experiment faults": Subcommand(
        "evidence.monitoring.scorecard_report", "ExperimentFaults", "score the monitor on faults; report"
    ),
    "experiment alarms": Subcommand(
        "evidence.monitoring.alarms", "ExperimentAlarms", "commission drawn machines, watch them with faults; report"
    ),
    "experiment false-alarms": Subcommand(
        "evidence.monitoring.false_alarms", "ExperimentFalseAlarms", "count the monitor's alarms over days; report"
    ),
    "experiment healthy-stops": Subcommand(
        "evidence.monitoring.healthy_stops",
        "ExperimentHealthyStops",
        "count how often the blocks alone stop healthy arms; report",
    ),
    "experiment sampling": Subcommand(
        "evidence.monitoring.sampling", "ExperimentSampling", "find the limits of the monitors; report"
    ),
    "experiment stop": Subcommand("evidence.monitoring.stopping", "ExperimentStop", "stop the arm on faults; report"),
    "experiment margins": Subcommand(
        "evidence.simulation.margins",
        "ExperimentMargins",
        "design the controller's gains, measure its margins; report",
    ),
    "experiment accuracy": Subcommand(
        "evidence.simulation.accuracy", "ExperimentAccuracy", "hold the twin's motions against the arm's; report"
    ),
    "experiment upload": Subcommand(
        "evidence.simulation.upload", "ExperimentUpload", "upload gains and a model to a running cell; report"
    ),
    "experiment recovery": Subcommand(
        "evidence.recovery.campaign", "ExperimentRecovery", "draw faults, have each answered in a cell; report"
    ),
    "experiment frozen": Subcommand(
        "evidence.recovery.frozen", "ExperimentFrozen", "stop encoders in motion; report how the arm is held"
    ),
    "fb fuzz": Subcommand(
        "evidence.hostile.trial", "FbFuzz", "trouble a device of its own with mutated input; report"
    ),
}
