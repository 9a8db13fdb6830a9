"""A record of an arm that was commissioned, without its commissioning."""

from dtwin.identification.machine.record import (
    LEARNED,
    SCHEMA,
    EncoderCheck,
    Healthy,
    Learned,
    MachineRecord,
    Number,
    Passed,
    SensorCheck,
)
from dtwin.parameters import PARAMETER_NAMES, ArmParameters
from dtwin.twin.effects import Effects

EFFECTS = Effects(lag=(0.004, 0.004, 0.004), delay=0.013)
HEALTHY = Healthy(
    slow=(0.02, 0.01, 0.03),
    memory=0.3,
    grip=0.9,
    displacement=0.0005,
    compliance=(0.01, 0.0, 0.02),
    stick=0.5,
    tails={"K2": Passed(20.0, 36.0, 5.0)},
    misfit=3.0,
    learned={name: Learned(0.2 + 0.01 * k, 0.001 * (k + 1)) for k, name in enumerate(LEARNED)},
    duration=600.0,
)


ENCODER = EncoderCheck(None, 1e-3, 1e-3, 0.0, 0.008)
SENSORS = SensorCheck((ENCODER, ENCODER, ENCODER), 0.0, 60.0, 0.0, 600.0)


def recorded(effects: Effects = EFFECTS) -> MachineRecord:
    values = {**dict(zip(PARAMETER_NAMES, ArmParameters().vector(), strict=True)), **effects.values()}
    numbers = {name: Number(value, 0.01 * abs(value), value, 0.1, True) for name, value in values.items()}
    three = (1e-3, 2e-3, 3e-3)
    return MachineRecord(
        SCHEMA, "identified", numbers, three, three, three, SENSORS, True, [], "a log", "", 60, {}, healthy=HEALTHY
    )
