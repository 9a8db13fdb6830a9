"""The text of an arm's file as it is made from a model: what the model tells, and what a person must add."""

from __future__ import annotations

import math
from pathlib import Path

from dtwin.arm.chain import Arm, Joint
from dtwin.arm.file import meaning, missing
from dtwin.names import counted


def imported(chain: Arm, model: str, tip: str | None) -> str:
    """The text of the file of a chain.

    Args:
        chain: the chain of the model.
        model: path of the model from the folder of the file.
        tip: last link that a person asked for.
    """
    name = Path(model).name
    size = counted(len(chain), "joint")
    lines = [f"# {chain.name}: {size}, from {name}. Lines that begin with `# add` are for a person."]
    lines += [f"# {remark}" for remark in chain.remarks]
    lines += [f'model = "{model}"', *([f'tip = "{tip}"'] if tip else []), "period = 0.01                  # s"]
    for joint in chain.joints:
        lines += ["", f"[joints.{_key(joint.name)}]", *_joint_lines(joint)]
    lines += ["", *_TOLERANCES]
    return "\n".join(lines) + "\n"


_TOLERANCES = (
    "[tolerances]                   # standard deviations: relative, centre in m, noise in rad",
    "# add constant, mass, inertia, friction, centre, noise where they are known; without them the usual ones hold",
    "",
    "# add [gripper] with payload (kg) if something holds a load",
)


def summary(arm: Arm) -> list[str]:
    """What an arm is, as lines for people."""
    reach = sum(float((joint.translation @ joint.translation) ** 0.5) for joint in arm.joints)
    mass, size = sum(link.mass for link in arm.links), counted(len(arm), "joint")
    held = f", holds {arm.gripper.payload:g} kg" if arm.gripper else ""
    lines = [f"{arm.name}: {size}, {mass:.3g} kg, joints {reach:.3g} m along{held}, {arm.period:g} s a tick"]
    return [*lines, *_brakes(arm), *(f"note: {remark}" for remark in arm.remarks)]


def _brakes(arm: Arm) -> list[str]:
    """What holds the joints without torque, as lines for people."""
    fitted = {joint.name: joint.brake for joint in arm.joints if joint.brake is not None}
    bare = [joint.name for joint in arm.joints if joint.brake is None]
    held = [f"{name} {brake.torque:g} after {1e3 * brake.delay:g} ms" for name, brake in fitted.items()]
    found = [f"brakes, N m or N: {', '.join(held)}"] if held else []
    if bare and not arm.servos:
        whose = ", ".join(bare) if held else "every joint"
        found.append(f"without a brake (`brake`), so that nothing holds it without torque: {whose}")
    return found


def findings(arm: Arm) -> list[str]:
    """What is still to be added before an arm can be driven, and what cannot be, as lines for people."""
    found = [f"add {key}: {meaning(key)}" for key in missing(arm)]
    if 0 < len(arm.servos) < len(arm):
        found.append(f"commanded: expected a position in every joint or in none, got one in {', '.join(arm.servos)}")
    return found


def _key(name: str) -> str:
    """A name as a key of TOML."""
    plain = name.replace("_", "").replace("-", "")
    return name if plain.isascii() and plain.isalnum() else f'"{name}"'


def _joint_lines(joint: Joint) -> list[str]:
    said = {
        "lower": joint.lower,
        "upper": joint.upper,
        "speed": joint.speed,
        "effort": joint.effort,
        "viscous": joint.friction.viscous or math.inf,
        "coulomb": joint.friction.coulomb or math.inf,
        "rotor": joint.actuator.rotor or math.inf,
        "constant": math.inf if joint.actuator.constant is None else joint.actuator.constant,
        "limit": joint.actuator.limit,
    }
    numbers = ", ".join(f"{key} {value:.6g}" for key, value in said.items() if math.isfinite(value))
    lines = [f"# the model has: {numbers or 'none of these numbers'}"]
    constant = joint.actuator.constant
    actuator = joint.actuator
    if actuator.commanded == "position":
        lines.append(f'commanded = "{joint.unit}"')
        if actuator.stiffness is None:
            lines.append(f"# add stiffness = {meaning('stiffness')}")
        else:
            lines += [f"stiffness = {actuator.stiffness:g}", f"damping = {actuator.damping:g}"]
        if not math.isfinite(joint.effort):
            lines.append(f"# add effort = {meaning('effort')}")
    elif constant is None:
        commanded = f'commanded = "{joint.effort_unit}"'
        lines.append(f"{commanded:32}# change where it takes V or A, and add constant")
    for key in ("speed", "acceleration") if actuator.commanded == "position" else ("limit", "speed", "acceleration"):
        known = {"limit": joint.actuator.limit, "speed": joint.speed, "acceleration": joint.acceleration}[key]
        if key == "limit" and not math.isfinite(known) and math.isfinite(joint.effort):
            lines.append(f"limit = {joint.effort:g}{' ' * 20}# the largest effort of the model")
        elif not math.isfinite(known):
            lines.append(f"# add {key} = {meaning(key)}")
    for key in ("gear", "rotor", "viscous", "coulomb", "encoder", "brake"):
        if not math.isfinite(said.get(key, math.inf)):
            lines.append(f"# add {key}, if it is known: {meaning(key)}")
    return lines
