"""The topics of a production line; those of its plant and of the twin of the line have `line` in the place of an arm
in their keys, those of a zone its name, and those of a station's arm are the same as in a cell."""

from __future__ import annotations

from typing import Final

from dtwin.bus.line.messages import (
    FlowEffect,
    LinePlan,
    LineState,
    SetUpDone,
    SetUpQuestion,
    SetUpRequest,
    StationWord,
    ZoneDeskRequest,
    ZoneDesks,
)
from dtwin.bus.line.plant import FlowAnswer, FlowQuestion, PlantSetUp, PlantState, PlantWord, ZoneState
from dtwin.bus.line.situation import PlantSituation
from dtwin.bus.proposals.messages import LineLook, LookRequest, Proposal, ProposalDecision, ProposalRequest
from dtwin.bus.topics.topic import CHECKED, Topic

PLANT_STATE: Final = Topic("plant/state", "publication", PlantState, None, "plant")
PLANT_SET_UP: Final = Topic("plant/setup", "query", PlantSetUp, PlantState, "plant")
PLANT_WORD: Final = Topic("plant/station", "query", PlantWord, PlantState, "plant")
PLANT_NOW: Final = Topic("plant/now", "query", LookRequest, PlantSituation, "plant")
ZONE_STATE: Final = Topic("twin/zone/state", "publication", ZoneState, None, "zone")
ZONE_FLOW: Final = Topic("twin/zone/flow", "query", FlowQuestion, FlowAnswer, "zone", patience=CHECKED)
LINE_STATE: Final = Topic("twin/overall/state", "query", LookRequest, LineState, "line", patience=CHECKED)
LINE_PREDICT: Final = Topic("twin/overall/predict", "query", SetUpQuestion, FlowEffect, "line", patience=CHECKED)
LINE_LOOK: Final = Topic("twin/overall/look", "query", LookRequest, LineLook, "line", patience=CHECKED)
LINE_PROPOSE: Final = Topic("twin/overall/propose", "query", ProposalRequest, Proposal, "line", patience=CHECKED)
LINE_DECIDE: Final = Topic("twin/overall/decide", "query", ProposalDecision, Proposal, "line", patience=CHECKED)
SET_UP: Final = Topic("twin/overall/setup", "query", SetUpRequest, SetUpDone, "line", patience=CHECKED)
LINE_STOP: Final = Topic("twin/overall/stop", "query", StationWord, LineState, "line", patience=CHECKED)
LINE_SETTLE: Final = Topic("twin/overall/settle", "query", StationWord, LineState, "line", patience=CHECKED)
LINE_RELEASE: Final = Topic("twin/overall/release", "query", StationWord, LineState, "line", patience=CHECKED)
LINE_PLAN: Final = Topic("twin/overall/plan", "query", LookRequest, LinePlan, "line")
LINE_DESK: Final = Topic("twin/overall/desk", "query", ZoneDeskRequest, ZoneDesks, "line")
LINE_TOPICS: Final = (
    *(PLANT_STATE, PLANT_SET_UP, PLANT_WORD, PLANT_NOW, ZONE_STATE, ZONE_FLOW),
    *(LINE_STATE, LINE_PREDICT, LINE_LOOK, LINE_PROPOSE, LINE_DECIDE, SET_UP, LINE_STOP, LINE_SETTLE, LINE_RELEASE),
    *(LINE_PLAN, LINE_DESK),
)
