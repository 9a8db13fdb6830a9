"""The arguments of tools: types with units and ranges, from which the schemas come that a client sees."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from dtwin.controller.bounds import ENCODER_OFFSETS, HIGHEST_GAINS, PAYLOADS, TARGET_TIMES
from dtwin.parameters import JOINTS

Why = Annotated[str, Field(min_length=3, max_length=500, description="Reason in your own words, for people")]
FaultName = Annotated[
    str,
    Field(
        pattern=r"^[A-Za-z]{1,16}[123]?$",
        description="What a finding names, such as K2, bias1 or payload; `findings` lists them",
    ),
]
FaultNames = Annotated[list[FaultName], Field(min_length=1, max_length=8)]
ModelName = Annotated[
    str, Field(max_length=60, description="Model of the store, NAME or NAME@REVISION; see `models`")
]
Version = Annotated[int, Field(ge=0, description="Version of the settings that you have seen; see `settings`")]
Joint = Literal[1, 2, 3]
Kp = Annotated[
    list[Annotated[float, Field(ge=0.0, le=HIGHEST_GAINS["kp"])]],
    Field(min_length=JOINTS, max_length=JOINTS, description="Proportional gains of joints 1 to 3, 1/s^2"),
]
Ki = Annotated[
    list[Annotated[float, Field(ge=0.0, le=HIGHEST_GAINS["ki"])]],
    Field(min_length=JOINTS, max_length=JOINTS, description="Integral gains of joints 1 to 3, 1/s^3"),
]
Kd = Annotated[
    list[Annotated[float, Field(ge=0.0, le=HIGHEST_GAINS["kd"])]],
    Field(min_length=JOINTS, max_length=JOINTS, description="Derivative gains of joints 1 to 3, 1/s"),
]
Offsets = Annotated[
    list[Annotated[float, Field(ge=ENCODER_OFFSETS[0], le=ENCODER_OFFSETS[1])]],
    Field(min_length=JOINTS, max_length=JOINTS, description="Offsets taken off the encoders of joints 1 to 3, rad"),
]
TargetTime = Annotated[float, Field(ge=TARGET_TIMES[0], le=TARGET_TIMES[1], description="Duration of a motion, s")]
Box = Annotated[float, Field(ge=PAYLOADS[0], le=PAYLOADS[1], description="Mass of a box, kg")]
