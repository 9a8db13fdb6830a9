"""Twin, controller and cell of any serial arm as FMUs, with the same C around n joints as for the arm of the cell.

The equations are those of dtwin/equations/chain.c. Parameters of a body are in the frame of its link, as in the file
of the arm; the C code turns them into the frames whose z axes are the axes of the joints.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import numpy as np

from dtwin.arm.chain import Arm, Array, aligned, without_servos
from dtwin.arm.poses import Poses
from dtwin.controller.chain.application import ARM, LIBRARY, Control, inputs, messages, network
from dtwin.controller.chain.embedded import started_network
from dtwin.equations.rigid import usual_inertia
from dtwin.errors import ModelError
from dtwin.fmu.archive import Model, write_model
from dtwin.fmu.chain_variables import arm_variables, cell_variables, controller_variables, exposed
from dtwin.fmu.sources import Parts, Subject, Version, texts_of
from iec61499.library import Library
from iec61499.native.layout import Layout, network_layout
from iec61499.types import ArrayType

STEPS: Final = 4
"""Integration steps in a sample of the controller, as in the emulation."""
_SUMMARIES: Final[dict[Subject, str]] = {
    "twin": "commands of the drives in, positions out",
    "controller": "its control application in IEC 61499 function blocks: samples in, commands out",
    "cell": "under its control application in IEC 61499 function blocks",
}
_ARM: Final = ("arm.h", "arm_state.h", "arm.c")
_CONTROL: Final = ("control.h", "control_state.h", "control.c", "tick.c")
_PARTS: Final[dict[Subject, tuple[str, ...]]] = {
    "twin": _ARM,
    "controller": _CONTROL,
    "cell": (*_ARM, *_CONTROL, "exchange.h"),
}


def write_chain_fmu(
    path: Path,
    subject: Subject,
    version: Version,
    arm: Arm,
    *,
    known: Arm | None = None,
    poses: Poses | None = None,
    control: Control | None = None,
) -> None:
    """Writes an FMU of a serial arm for co-simulation with a binary for this machine and all sources.

    Args:
        path: the file to write.
        subject: the model.
        version: version of FMI.
        arm: what the arm of twin and cell is.
        known: the arm as the controller knows it; as `arm` if None.
        poses: what controller and cell do; without any they stay where they are.
        control: how the arm is controlled.

    Raises:
        ModelError: something of the arm is not known that is needed; names it.
        NativeError: there is no C compiler, or FMI has no name for this machine.
        FunctionBlockError: the function blocks cannot be used.
        RecordingError: the file cannot be written.
    """
    for joint in without_servos(arm, "FMU").joints:
        if joint.actuator.constant is None:
            raise ModelError(f"arm {arm.name}: joints.{joint.name}: expected a drive with its constant")
    reckoned = arm if known is None else known
    layout, values = None, {}
    if subject != "twin":
        layout = network_layout(started_network(network(len(arm))), Library([LIBRARY]))
        values = inputs(reckoned, usual_inertia(reckoned), control or Control(), poses)
    count = 0 if poses is None else len(poses.positions)
    if layout is None:
        variables = arm_variables(arm, arm.period / STEPS)
    elif subject == "controller":
        variables = controller_variables(reckoned, values, count)
    else:
        variables = cell_variables(arm, arm.period / STEPS, reckoned, values, count, _first(arm, poses))
    summary = f"Serial arm {arm.name} of {len(arm)} joints: {_SUMMARIES[subject]}"
    start = {} if layout is None else _start(values, layout, exposed(len(arm), count))
    write_model(path, version, Model(subject, summary, variables, layout, _parts(arm, subject, start)))


def _first(arm: Arm, poses: Poses | None) -> Array:
    """Where the arm of a cell begins, (n,)."""
    return np.zeros(len(arm)) if poses is None else poses.positions[0]


def _parts(arm: Arm, subject: Subject, start: Mapping[str, str]) -> Parts:
    texts = texts_of((f"{subject}.h", f"{subject}.c", *_PARTS[subject]), "chain")
    if subject != "controller":
        texts["geometry.h"] = _geometry(arm)
        for name in ("chain.h", "chain.c", "moving.h", "moving.c"):
            texts[name] = (files("dtwin.equations") / name).read_text()
    if subject != "twin":
        texts["messages.h"] = _messages(len(arm))
    return Parts(texts, arm.period, start, {"JOINTS": len(arm)})


def _start(values: Mapping[str, Any], layout: Layout, shown: frozenset[str]) -> dict[str, str]:
    """What is set in the blocks at the beginning and is no variable of the model, by its lvalue."""
    places = {place.name: place for place in layout.variables}
    found: dict[str, str] = {}
    for name, value in values.items():
        place = places[name]
        member = f"control.program.{place.member}"
        if isinstance(place.type, ArrayType):
            shows = {f"{name}[{k}]" for k in range(len(value))} & shown
            rows = {f"{member}[{k}]": each for k, each in enumerate(value) if f"{name}[{k}]" not in shows}
            found |= {lvalue: repr(float(each)) for lvalue, each in rows.items() if each}
        elif name not in shown:
            found[member] = str(value).lower() if isinstance(value, bool) else repr(value)
    return found


def _geometry(arm: Arm) -> str:
    """The text of geometry.h: the frames of the joints with their axes as z, as chain.c wants them."""
    chain = aligned(arm)
    frames, axes, before = [], [], np.eye(3)
    for joint, own in zip(arm.joints, chain.joints, strict=True):
        frames.append([*own.rotation.ravel(), *own.translation])
        before = joint.rotation.T @ before @ own.rotation
        axes.append(before)
    lines = [f"/* The frames of {len(arm)} joints. */", "#ifndef DTWIN_GEOMETRY_H", "#define DTWIN_GEOMETRY_H", ""]
    lines.append(f"static const double chain_gravity[3] = {_row(arm.gravity)};")
    lines.append(f"static const double chain_tool[3] = {_row(arm.tool)}; /* in the frame of the last link */")
    lines.append(f"static const double chain_turns[{len(arm)}] = {_row([float(j.turns) for j in arm.joints])};")
    lines.append("/* attitude, row by row, and origin of every frame in the one before */")
    lines.append(f"static const double chain_frames[{len(arm)}][12] = {{")
    lines += [f"    {_row(frame)}," for frame in frames]
    lines += ["};", "/* those axes in the frame of the link, as columns */"]
    lines.append(f"static const double chain_axes[{len(arm)}][3][3] = {{")
    lines += [f"    {{{', '.join(_row(line) for line in turn)}}}," for turn in axes]
    return "\n".join([*lines, "};", "", "#endif", ""])


def _row(values: Any) -> str:
    return "{" + ", ".join(repr(float(value)) for value in values) + "}"


def _messages(joints: int) -> str:
    """The text of messages.h: what the block ARM is told and answers."""
    sent, answered = messages(joints)
    assert (len(sent.types), len(answered.types)) == (joints + 1, 2 * joints + 1)
    lines = [
        "/* The message to the blocks and their answer. */",
        "#ifndef DTWIN_MESSAGES_H",
        "#define DTWIN_MESSAGES_H",
    ]
    lines += [
        "",
        f"static void set_request(struct program__{ARM}__request *request, const double *q, int32_t box)",
        "{",
    ]
    lines += [f"    request->RD_{k + 1} = q[{k}];" for k in range(joints)]
    lines += [f"    request->RD_{joints + 1} = box;", "}", ""]
    lines += [f"static bool get_answer(const struct program__{ARM}__answer *answer, double *u)", "{"]
    lines += [f"    u[{k}] = answer->SD_{k + 1};" for k in range(joints)]
    return "\n".join([*lines, f"    return answer->SD_{joints + 1};", "}", "", "#endif", ""])
