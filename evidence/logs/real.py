"""Real logs: identification against others on the same files, on motion that none was fitted to.

The others are ordinary least squares and, where they are installed, figaroh and mujoco.sysid.

A folder holds logs, a description of the arm, and `benchmark.toml`, which says what is trained on and what is tested:

    arm = "ur10e.urdf"
    columns = "map.toml"
    source = "where the logs come from, and under what licence"
    train = ["a.csv", "b.csv"]
    test = ["c.csv", "d.csv"]
    load = { "b.csv" = 2.805 }       # kg; 0 for one that is to be found
    truth = { "d.csv" = 2.6 }        # kg, only compared with
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final

import msgspec
import numpy as np
import tyro

from dtwin.arm.chain import Arm, Array
from dtwin.arm.urdf import read_urdf
from dtwin.campaign.spread import Progress
from dtwin.emulation.peer import is_installed
from dtwin.errors import DtwinError, IdentificationError, RecordingError
from dtwin.files import reason_of
from dtwin.identification.chain.baseline import Baseline, Regressor
from dtwin.identification.chain.design import Filtering
from dtwin.identification.chain.identify import Identification, Sample, Settings, identify, unexplained
from dtwin.measurements.columns import read_map
from dtwin.measurements.measurement import Measurement
from dtwin.measurements.reading import read_measurement
from evidence.experiment import ExperimentCommand
from evidence.logs.figaroh import ABSENT, Figaroh
from evidence.logs.sysid import ABSENT as NO_SYSID
from evidence.logs.sysid import Sysid
from evidence.report import Report, page, table

FILE: Final = "benchmark.toml"
_NINETY_FIVE: Final = 1.96


class Plan(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What is trained on and what is tested; names of files are those inside the folder."""

    arm: str
    train: tuple[str, ...]
    test: tuple[str, ...]
    tip: str | None = None
    columns: str = ""
    source: str = ""
    load: dict[str, float] = {}
    truth: dict[str, float] = {}


class Tested(msgspec.Struct, frozen=True):
    """One file that neither was fitted to.

    Attributes:
        file: its name.
        ours: unexplained share of the torque, joint by joint.
        theirs: that of ordinary least squares.
        figaroh: that of figaroh; empty where it is not installed.
        sysid: that of mujoco.sysid; empty where it is not installed.
    """

    file: str
    ours: tuple[float, ...]
    theirs: tuple[float, ...]
    figaroh: tuple[float, ...] = ()
    sysid: tuple[float, ...] = ()

    def joints(self) -> list[tuple[float, ...]]:
        """The shares of all who were asked, joint by joint."""
        asked = (self.ours, self.theirs, self.figaroh, self.sysid)
        return list(zip(*(shares for shares in asked if shares), strict=True))


class Load(msgspec.Struct, frozen=True):
    """A load: as found, half width of its 95 % interval, and what it truly is where that is known; kg."""

    file: str
    found: float
    half: float
    truth: float | None


class Benchmark(msgspec.Struct, frozen=True):
    """What came of a folder.

    Attributes:
        source: where the logs come from.
        baseline: whose regressor ordinary least squares took.
        tested: file by file.
        loads: loads that were found.
        groups: friction terms that proved themselves on the training files.
        fit_seconds: time that identification and least squares took.
        figaroh: its version where it was asked, or why not.
        sysid: mujoco.sysid and the time that it took where it was asked, or why not.
    """

    source: str
    baseline: str
    tested: tuple[Tested, ...]
    loads: tuple[Load, ...]
    groups: tuple[str, ...]
    fit_seconds: tuple[float, float]
    figaroh: str = ABSENT
    sysid: str = NO_SYSID

    @property
    def ratios(self) -> Array:
        """Our share over theirs, the geometric mean over the files, joint by joint, (n,)."""
        ratios = [np.array(each.ours) / np.array(each.theirs) for each in self.tested]
        mean: Array = np.exp(np.mean(np.log(ratios), axis=0))
        return mean


def read_plan(folder: Path) -> Plan:
    """Reads what a folder is to be tested on.

    Raises:
        RecordingError: the file is missing, or is no such plan.
    """
    try:
        plan = msgspec.toml.decode((folder / FILE).read_bytes(), type=Plan)
    except OSError as error:
        raise RecordingError(f"{folder / FILE}: cannot be read: {reason_of(error)}") from None
    except (msgspec.MsgspecError, ValueError) as error:
        raise RecordingError(f"{folder / FILE}: expected a benchmark: {error}") from None
    if unknown := [name for name in (*plan.load, *plan.truth) if name not in plan.train]:
        raise RecordingError(f"{folder / FILE}: load of {unknown[0]!r}: expected one of the files of train")
    if not set(plan.train) - set(plan.load):
        raise RecordingError(f"{folder / FILE}: expected a file of train with an empty hand")
    return plan


def real_experiment(folder: Path, progress: Progress) -> Benchmark:
    """Identifies the arm of a folder and tests it.

    Raises:
        DtwinError: a file cannot be read, or tells too little.
    """
    plan = read_plan(folder)
    arm = read_urdf(folder / plan.arm, tip=plan.tip)
    columns = read_map(folder / plan.columns) if plan.columns else None
    names = [*plan.train, *plan.test]
    logs = {}
    for done, name in enumerate(names):
        progress(done, len(names))
        logs[name] = read_measurement(folder / name, columns, arm)
    began = time.perf_counter()
    samples = [Sample(logs[name], name if name in plan.load else "") for name in plan.train]
    found = identify(arm, samples, Settings({name: mass for name, mass in plan.load.items() if mass}))
    ours = time.perf_counter() - began
    began = time.perf_counter()
    whose, of = _regressor(folder / plan.arm, arm)
    empty = [logs[name] for name in plan.train if name not in plan.load]
    baseline = Baseline(arm, empty, found.found.gain, Filtering(), of)
    theirs = time.perf_counter() - began
    peer, said = _figaroh(folder / plan.arm, arm, empty, found.found.gain)
    simulating, by_simulation = _sysid(arm, empty, found)
    tested = []
    for name in plan.test:
        everybody = (found, baseline, peer, simulating)
        shares = [() if who is None else unexplained(*who.predicted(logs[name])).tolist() for who in everybody]
        tested.append(Tested(name, *(tuple(share) for share in shares)))
    if not tested:
        raise IdentificationError(f"{folder / FILE}: expected at least one file to test")
    loads = [Load(n, found.load(n)[0], _NINETY_FIVE * found.load(n)[1], _true(plan, n)) for n in plan.load]
    return Benchmark(
        plan.source, whose, tuple(tested), tuple(loads), found.groups, (ours, theirs), said, by_simulation
    )


def _figaroh(urdf: Path, arm: Arm, logs: Sequence[Measurement], gain: Array) -> tuple[Figaroh | None, str]:
    """figaroh's fit and its name; why there is none."""
    try:
        peer = Figaroh(urdf, arm, logs, gain)
    except ImportError as error:
        return None, str(error) if "joints" in str(error) else ABSENT
    return peer, peer.name


def _sysid(arm: Arm, logs: Sequence[Measurement], found: Identification) -> tuple[Sysid | None, str]:
    """mujoco.sysid's fit and its name with its time; why there is none."""
    if not is_installed():
        return None, NO_SYSID
    try:
        peer = Sysid(arm, logs, found.found.gain, found.design.scales, found.design.filtering)
    except DtwinError as error:
        return None, str(error)
    return peer, f"mujoco.sysid, which took {peer.seconds:.1f} s"


def _true(plan: Plan, name: str) -> float | None:
    return plan.truth.get(name) or plan.load[name] or None


def _regressor(urdf: Path, arm: Arm) -> tuple[str, Regressor | None]:
    """Pinocchio's regressor where it is installed and reads the same chain; else ours, which tests hold equal."""
    try:
        import pinocchio
    except ImportError:
        return "dtwin's regressor (Pinocchio is not installed: pip install pin)", None
    model = pinocchio.buildModelFromUrdf(str(urdf))
    if model.nv != len(arm) or model.nq != len(arm):
        return "dtwin's regressor (Pinocchio reads more joints than the chain has)", None
    data = model.createData()

    def regressor(q: Array, v: Array, a: Array) -> Array:
        rows = [
            pinocchio.computeJointTorqueRegressor(model, data, *state).copy() for state in zip(q, v, a, strict=True)
        ]
        return np.array(rows)

    return f"Pinocchio {pinocchio.__version__}", regressor


def real_report(result: Benchmark) -> Report:
    """The page of a benchmark."""
    joints = range(1, len(result.tested[0].ours) + 1)
    head = ["file", *(f"joint {joint}" for joint in joints)]
    rows = [
        [each.file, *(" / ".join(f"{share:.3f}" for share in shares) for shares in each.joints())]
        for each in result.tested
    ]
    rows.append(["ratio, geometric mean", *(f"{ratio:.2f}" for ratio in result.ratios)])
    loads = [[each.file, f"{each.found:.3f}", f"+- {each.half:.3f}", _known(each.truth)] for each in result.loads]
    overall = float(np.exp(np.mean(np.log(result.ratios))))
    ours, theirs = result.fit_seconds
    friction = ", ".join(result.groups) or "basic alone"
    first = result.tested[0]
    beside = "".join(
        f" / {name}" for name, asked in (("figaroh", first.figaroh), ("mujoco.sysid", first.sysid)) if asked
    )
    words = (
        f"{result.source or 'The logs have no source.'} Root mean square of the torque that is not explained, in "
        f"parts of its standard deviation, on files that were not fitted: ours / ordinary least squares on "
        f"{result.baseline}{beside}. All see the torque through the same filter. Over all joints the ratio is "
        f"{overall:.2f}. Friction that proved itself on the training files: {friction}. Identification took "
        f"{ours:.1f} s, least squares {theirs:.1f} s. {_peer_words(result)}"
    )
    parts = [words, table(head, rows)]
    if loads:
        parts.append(table(["load", "found, kg", "95 % interval", "known, kg"], loads))
    return page("Real logs", *parts)


def _peer_words(result: Benchmark) -> str:
    """What came of the other programs: our share over theirs, the geometric mean, or why they were not asked."""
    said = []
    for name, shares in (
        (result.figaroh, [each.figaroh for each in result.tested]),
        (result.sysid, [each.sysid for each in result.tested]),
    ):
        logs = [np.log(each.ours) - np.log(other) for each, other in zip(result.tested, shares, strict=True) if other]
        said.append(f"Against {name} the ratio is {float(np.exp(np.mean(logs))):.2f}." if logs else f"{name}.")
    return " ".join(said)


def _known(mass: float | None) -> str:
    return "" if mass is None else f"{mass:g}"


def figures(result: Benchmark) -> Mapping[str, Any]:
    """The benchmark as values for JSON."""
    found: dict[str, Any] = msgspec.to_builtins(result)
    return found | {"ratios": result.ratios.tolist()}


@dataclass(frozen=True)
class ExperimentReal(ExperimentCommand[Benchmark]):
    """Identify the arm whose logs lie in a folder, and hold it against ordinary least squares on files not fitted."""

    name: ClassVar = "real"

    folder_of_logs: Annotated[Path, tyro.conf.Positional] = Path()
    """Folder with logs, the arm's description, and benchmark.toml, which says what is trained on and tested."""

    def measure(self, progress: Progress) -> Benchmark:
        return real_experiment(self.folder_of_logs, progress)

    def report(self, result: Benchmark) -> Report:
        return real_report(result)

    def figures(self, result: Benchmark) -> dict[str, Any]:
        return dict(figures(result))
