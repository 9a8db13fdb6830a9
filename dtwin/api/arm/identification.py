"""Identification of any serial arm from files of other programs, and the files that the arm is written to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, NamedTuple

from dtwin.api.arguments import AnyPath, Texts, checked, texts
from dtwin.arm.chain import Arm
from dtwin.arm.file import ArmFile, file_of
from dtwin.emulation.chain.arms import arm_of
from dtwin.emulation.chain.overlay import write_mjcf
from dtwin.errors import ParameterError
from dtwin.files import ensure_writable
from dtwin.identification.chain.identify import Identification, Sample, Settings, identify
from dtwin.identification.chain.overlay import overlaid, write_urdf
from dtwin.identification.chain.result import write_toml
from dtwin.identification.live.kept import write_beside
from dtwin.measurements.columns import ColumnMap, read_map
from dtwin.measurements.reading import read_measurement

UNKNOWN: Final = "?"
"""Stands for the mass of a load that is to be found."""


@dataclass(frozen=True, slots=True, eq=False)
class IdentifiedArm:
    """An arm that was identified from logs.

    Attributes:
        found: the numbers with their intervals, what was held out, friction.
        samples: the logs with what was held.
    """

    found: Identification
    samples: tuple[Sample, ...]


@checked
def identify_arm(
    arm: AnyPath,
    logs: AnyPath | tuple[AnyPath, ...],
    *,
    tip: str | None = None,
    columns: AnyPath | None = None,
    load: Texts = (),
    out: AnyPath | None = None,
    urdf: AnyPath | None = None,
    mjcf: AnyPath | None = None,
    arm_out: AnyPath | None = None,
    progress: Callable[[str], None] = lambda stage: None,
) -> IdentifiedArm:
    """Identifies any serial arm from logs of other programs, as `dtwin identify LOG --arm` does.

    Args:
        arm: a name of arms/, an arm's file (*.toml) or a model (*.urdf, *.xml).
        logs: a file or folder as `read_log` takes it, or several of the same arm.
        tip: last link of the chain; None for the end of the longest one.
        columns: TOML file that says what the columns of the logs mean; None for a guess.
        load: what was held in a log: FILE=KG where it was weighed, FILE=? where it is to be found.
        out: TOML file for all numbers with intervals.
        urdf: URDF file for the arm with the bodies and the friction that were found.
        mjcf: MJCF file for the same, with the inertia of rotors; of a URDF it is the chain without shapes.
        arm_out: TOML file for the arm as all commands take it, with its model of the same name beside it.
        progress: is told "reading" and "estimating" when these begin.

    Raises:
        ParameterError: an argument is unknown or of another kind, a load is of no log, or a file does not suit.
        RecordingError: a log cannot be read, or a file cannot be written.
        ModelError: the arm cannot be read.
        IdentificationError: the logs do not tell enough.
    """
    known = file_of(str(arm))
    known = replace(known, tip=tip or known.tip)
    written = _Written(*(None if path is None else Path(path) for path in (out, urdf, mjcf, arm_out)))
    written.check(known.model)
    chain = arm_of(str(arm), tip)
    progress("reading")
    paths = [Path(log) for log in (logs if isinstance(logs, tuple) else (logs,))]
    samples, masses = _samples(chain, paths, texts(load), None if columns is None else read_map(Path(columns)))
    progress("estimating")
    found = identify(chain, samples, Settings(masses))
    written.write(found, known)
    return IdentifiedArm(found, tuple(samples))


def _samples(
    arm: Arm, logs: Sequence[Path], loads: Sequence[str], columns: ColumnMap | None
) -> tuple[list[Sample], dict[str, float]]:
    """The measurements with what was held, and the masses that are known.

    Args:
        arm: the arm.
        logs: files.
        loads: what was held, FILE=KG or FILE=?.
        columns: what the columns mean; None for a guess.

    Raises:
        ParameterError: a load is not told so, or of no log.
        RecordingError: a log cannot be read.
    """
    held: dict[str, str] = {}
    masses: dict[str, float] = {}
    names = [str(log) for log in logs]
    for text in loads:
        file, equals, mass = text.rpartition("=")
        if not equals or file not in names:
            raise ParameterError(
                f"`load` {text!r}: expected FILE=KG or FILE={UNKNOWN}, FILE one of {', '.join(names)}"
            )
        # Files of one name in several folders are several loads.
        alike = [name for name in names if Path(name).stem == Path(file).stem]
        held[file] = Path(file).stem if len(alike) == 1 else file
        if mass != UNKNOWN:
            masses[held[file]] = _mass(text, mass)
    samples = [Sample(read_measurement(log, columns, arm), held.get(str(log), "")) for log in logs]
    return samples, masses


def _mass(text: str, mass: str) -> float:
    try:
        value = float(mass)
    except ValueError:
        value = float("nan")
    if not 0.0 < value < 1e4:
        raise ParameterError(f"`load` {text!r}: expected a mass above 0 kg, or {UNKNOWN}")
    return value


class _Written(NamedTuple):
    """Files that an identified arm is written to; None for those that nobody asked for.

    Attributes:
        out: all numbers, *.toml.
        urdf: the description with what was found.
        mjcf: the same as MJCF.
        arm: the file of the arm, *.toml, with its model of the same name beside it.
    """

    out: Path | None = None
    urdf: Path | None = None
    mjcf: Path | None = None
    arm: Path | None = None

    def check(self, model: Path) -> None:
        """Checks that all can be written before anything is estimated.

        Args:
            model: the arm's model file.

        Raises:
            ParameterError: a URDF is asked for of an arm that has none.
            RecordingError: a path cannot be written.
        """
        if self.urdf is not None and model.suffix.lower() != ".urdf":
            raise ParameterError(f"urdf: expected an arm whose model is a URDF file, got {model}")
        beside = self._beside(model)
        endings = ((self.out, ".toml"), (self.urdf, ".urdf"), (self.mjcf, ".xml"), (self.arm, ".toml"))
        for path, ending in (*endings, (beside, model.suffix.lower())):
            if path is not None:
                ensure_writable(path, ending)
        if self.arm is not None and self.arm == self.out:
            raise ParameterError(f"arm_out: expected another file than `out`, got {self.arm}")
        if beside is not None and beside.resolve() == model.resolve():
            raise ParameterError(f"arm_out: expected another name than that of the arm's model, got {self.arm}")

    def write(self, found: Identification, known: ArmFile) -> None:
        """Writes what was found.

        Args:
            found: what was found.
            known: what the arm's file says.
        """
        model = known.model
        template = None if model.suffix.lower() == ".urdf" else model
        if self.out is not None:
            write_toml(found, self.out)
        if self.urdf is not None:
            write_urdf(found, model, self.urdf)
        if self.mjcf is not None:
            write_mjcf(overlaid(found), template, self.mjcf)
        if self.arm is not None:
            write_beside(found, known, self.arm)

    def _beside(self, model: Path) -> Path | None:
        return None if self.arm is None else self.arm.with_suffix(model.suffix.lower())
