"""Schemas of the messages of VDA 5050 3.0, written after the tables of its chapter 7: what must be there, and how."""

from __future__ import annotations

import json
from functools import cache
from typing import Any


def _object(required: dict[str, Any], **optional: Any) -> dict[str, Any]:
    return {"type": "object", "properties": required | optional, "required": list(required)}


def _list(of: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {"type": "array", "items": of, **more}


def _one(*names: str) -> dict[str, Any]:
    return {"enum": list(names)}


STRING = {"type": "string"}
BOOLEAN = {"type": "boolean"}
NUMBER = {"type": "number"}
UINT32 = {"type": "integer", "minimum": 0, "maximum": 2**32 - 1}
NOT_NEGATIVE = {"type": "number", "minimum": 0}
ANGLE = {"type": "number", "minimum": -3.14159265359, "maximum": 3.14159265359}
PERCENT = {"type": "number", "minimum": 0, "maximum": 100}
HEADER: dict[str, Any] = {
    "headerId": UINT32,
    "timestamp": {"type": "string", "pattern": r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z$"},
    "version": {"const": "3.0.0"},
    "manufacturer": STRING,
    "serialNumber": {"type": "string", "pattern": r"^[A-Za-z0-9_.:-]+$"},
}
PARAMETER = _object({"key": STRING, "value": {}})
ACTION = _object(
    {"actionType": STRING, "actionId": STRING, "blockingType": _one("NONE", "SINGLE", "SOFT", "HARD")},
    actionParameters=_list(PARAMETER),
)
NODE_POSITION = _object({"x": NUMBER, "y": NUMBER, "mapId": STRING}, theta=ANGLE)
NODE = _object(
    {"nodeId": STRING, "sequenceId": UINT32, "released": BOOLEAN, "actions": _list(ACTION)},
    nodePosition=NODE_POSITION,
)
EDGE = _object({"edgeId": STRING, "sequenceId": UINT32, "released": BOOLEAN, "actions": _list(ACTION)})
ACTION_STATE = _object(
    {
        "actionId": STRING,
        "actionStatus": _one("WAITING", "INITIALIZING", "RUNNING", "PAUSED", "RETRIABLE", "FINISHED", "FAILED"),
    },
    actionType=STRING,
)
ERROR = _object(
    {"errorType": STRING, "errorLevel": _one("WARNING", "URGENT", "CRITICAL", "FATAL")},
    errorReferences=_list(_object({"referenceKey": STRING, "referenceValue": STRING})),
)
INSTANT = {**ACTION, "properties": {**ACTION["properties"], "blockingType": _one("NONE")}}
SCHEMAS: dict[str, dict[str, Any]] = {
    "order": _object(
        {
            **HEADER,
            "orderId": STRING,
            "orderUpdateId": UINT32,
            "nodes": _list(NODE, minItems=1),
            "edges": _list(EDGE),
        }
    ),
    "instantActions": _object({**HEADER, "actions": _list(INSTANT)}),
    "connection": _object(
        {**HEADER, "connectionState": _one("ONLINE", "OFFLINE", "HIBERNATING", "CONNECTION_BROKEN")}
    ),
    "state": _object(
        {
            **HEADER,
            "orderId": STRING,
            "orderUpdateId": UINT32,
            "lastNodeId": STRING,
            "lastNodeSequenceId": UINT32,
            "nodeStates": _list(_object({"nodeId": STRING, "sequenceId": UINT32, "released": BOOLEAN})),
            "edgeStates": _list(_object({"edgeId": STRING, "sequenceId": UINT32, "released": BOOLEAN})),
            "driving": BOOLEAN,
            "actionStates": _list(ACTION_STATE),
            "instantActionStates": _list(ACTION_STATE),
            "powerSupply": _object({"stateOfCharge": PERCENT, "charging": BOOLEAN}),
            "operatingMode": _one(
                "STARTUP", "AUTOMATIC", "SEMIAUTOMATIC", "INTERVENED", "MANUAL", "SERVICE", "TEACH_IN"
            ),
            "errors": _list(ERROR),
            "safetyState": _object(
                {"activeEmergencyStop": _one("MANUAL", "REMOTE", "NONE"), "fieldViolation": BOOLEAN}
            ),
        },
        mobileRobotPosition=_object(
            {"x": NUMBER, "y": NUMBER, "theta": ANGLE, "mapId": STRING, "localized": BOOLEAN}
        ),
        loads=_list(_object({}, loadId=STRING)),
        paused=BOOLEAN,
    ),
    "factsheet": _object(
        {
            **HEADER,
            "typeSpecification": _object(
                {
                    "seriesName": STRING,
                    "mobileRobotKinematics": STRING,
                    "mobileRobotClass": STRING,
                    "maximumLoadMass": NOT_NEGATIVE,
                    "localizationTypes": _list(STRING),
                    "navigationTypes": _list(STRING),
                }
            ),
            "physicalParameters": _object(
                dict.fromkeys(("minimumSpeed", "maximumSpeed", "maximumAcceleration"), NOT_NEGATIVE)
                | dict.fromkeys(("maximumDeceleration", "minimumHeight", "maximumHeight", "width", "length"), NUMBER)
            ),
            "protocolLimits": _object(
                {
                    "maximumStringLengths": _object({}),
                    "maximumArrayLengths": _object({}),
                    "timing": _object({"minimumOrderInterval": NOT_NEGATIVE, "minimumStateInterval": NOT_NEGATIVE}),
                }
            ),
            "protocolFeatures": _object(
                {
                    "optionalParameters": _list({}),
                    "mobileRobotActions": _list(
                        _object(
                            {
                                "actionType": STRING,
                                "actionScopes": _list(_one("INSTANT", "NODE", "EDGE", "ZONE")),
                                "pauseAllowed": BOOLEAN,
                                "cancelAllowed": BOOLEAN,
                            }
                        )
                    ),
                }
            ),
            "mobileRobotGeometry": _object({}),
            "loadSpecification": _object({}),
        }
    ),
}


@cache
def _check(topic: str) -> Any:
    import jsonschema  # takes seconds to load, which only the workers that check shall take

    return jsonschema.Draft202012Validator(SCHEMAS[topic])


def checked(topic: str, payload: bytes) -> dict[str, Any]:
    """A message that has the form of the recommendation; fails the test if it has not."""
    message: dict[str, Any] = json.loads(payload)
    wrong = [f"{topic}: {error.json_path}: {error.message}" for error in _check(topic).iter_errors(message)]
    assert not wrong, wrong
    return message
