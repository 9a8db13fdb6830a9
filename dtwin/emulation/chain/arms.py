"""Arms by their names and files, with their models."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from dtwin.arm.chain import Arm
from dtwin.arm.file import MODELS, ArmFile, complete, path_of, read_file
from dtwin.arm.urdf import read_urdf
from dtwin.emulation.chain.mjcf import read_mjcf
from dtwin.errors import ModelError, choices


def arm_of(text: str, tip: str | None = None) -> Arm:
    """The arm that a name of `arms/`, an arm's file (*.toml) or a model alone (*.urdf, *.xml) stands for.

    Args:
        text: name or path.
        tip: last link of the chain of a model alone; a file of an arm has its own.

    Raises:
        ModelError: there is no such arm, or one of its files cannot be used.
    """
    path = path_of(text)
    if path.suffix.lower() in MODELS:
        return complete(ArmFile(path, path), chain_of(path, tip))
    file = read_file(path)
    return complete(file, chain_of(file.model, tip or file.tip))


def chain_of(model: Path, tip: str | None = None) -> Arm:
    """The chain of a model file.

    Raises:
        ModelError: the file cannot be used, or is no MJCF or URDF.
    """
    suffix = model.suffix.lower()
    if suffix == ".urdf":
        return replace(read_urdf(model, tip=tip), model=model)
    if suffix not in MODELS:
        raise ModelError(f"{model}: expected a model that ends in {choices(MODELS)}")
    return replace(read_mjcf(model, tip), model=model)
