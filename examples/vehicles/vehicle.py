"""A vehicle that speaks VDA 5050 3.0 and nothing else: JSON over Zenoh, without a line of dtwin.

It is somebody else's vehicle as far as a line is concerned: it takes orders and instant actions, drives straight from
node to node, picks and drops, and tells state, connection and factsheet. Numbers of sections are those of the
recommendation, https://github.com/VDA5050/VDA5050.
"""

import argparse
import json
import math
import queue
import signal
import time
from datetime import UTC, datetime

import zenoh

STEP = 0.02
"""Time from one look to the next, s."""
ACCELERATION = 0.5
"""m/s^2, at a speed of 1 m/s; it grows with the speed."""


class Robot:
    """What the vehicle knows and does; it knows nothing of how messages come and go."""

    def __init__(self, options, send):
        self.options, self.send = options, send
        self.numbers = {}
        self.order, self.update, self.stops, self.edges = "", 0, [], {}
        self.reached, self.node, self.sequence = 0, options.node, 0
        self.x, self.y = options.x, options.y
        self.speed, self.load, self.running, self.began = 0.0, "", None, 0.0
        self.states, self.instants, self.errors = {}, {}, []
        self.paused = self.cancelled = False
        self.charge, self.told, self.due = 100.0, None, 0.0
        self.sheet()
        self.publish("connection", connectionState="ONLINE")

    def publish(self, topic, **fields):
        number = self.numbers[topic] = self.numbers.get(topic, -1) + 1
        now = datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
        head = {"headerId": number, "timestamp": now, "version": "3.0.0"}
        head |= {"manufacturer": self.options.manufacturer, "serialNumber": self.options.serial}
        self.send(topic, head | fields)

    # Orders (6.1.2 and 6.1.4)

    def take_order(self, order):
        new = order["orderId"] != self.order
        nodes, edges = order["nodes"], order["edges"]
        if len(edges) != len(nodes) - 1 or not nodes[0]["released"]:
            return self.fault("VALIDATION_FAILURE", order)
        if new and not self.idle:
            return self.fault("OTHER_ORDER_ACTIVE", order)
        if new and nodes[0]["nodeId"] != self.node:
            return self.fault("START_NODE_OUT_OF_RANGE", order)
        if not new and (order["orderUpdateId"] < self.update):
            return self.fault("OUTDATED_ORDER_UPDATE", order)
        if not new and order["orderUpdateId"] == self.update:
            return None  # sent again, because no state has come yet
        if not new and self.cancelled:
            return self.fault("ORDER_UPDATE_FOLLOWING_CANCEL", order)
        last = None if new else self.stops[-1]
        if last and (nodes[0]["nodeId"], nodes[0]["sequenceId"]) != (last["nodeId"], last["sequenceId"]):
            return self.fault("START_NODE_OUT_OF_RANGE", order)
        if any(node["nodePosition"]["mapId"] != self.options.map for node in nodes):
            return self.fault("UNKNOWN_MAP_ID", order)
        acts = [action for node in nodes for action in node["actions"]]
        if any(action["actionType"] not in ("pick", "drop") for action in acts):
            return self.fault("INVALID_ORDER_ACTION", order)
        if new:
            self.stops, self.states, self.reached, self.cancelled = [nodes[0]], {}, 0, False
            self.sequence = nodes[0]["sequenceId"]
        self.stops += [node for node in nodes[1:] if node["released"]]
        self.edges |= {edge["sequenceId"]: edge["edgeId"] for edge in edges}
        self.order, self.update, self.errors = order["orderId"], order["orderUpdateId"], []
        for action in acts:
            self.states.setdefault(action["actionId"], [action["actionType"], "WAITING"])
        return None

    def fault(self, kind, order, level="WARNING"):
        words = [{"referenceKey": "orderId", "referenceValue": str(order.get("orderId", ""))}]
        self.errors = [*self.errors[-9:], {"errorType": kind, "errorLevel": level, "errorReferences": words}]

    @property
    def idle(self):
        over = all(status in ("FINISHED", "FAILED") for _, status in self.states.values())
        return not self.stops[self.reached + 1 :] and over

    # Instant actions (6.2.1)

    def take_actions(self, message):
        for action in message["actions"]:
            kind, name = action["actionType"], action["actionId"]
            status = "FINISHED"
            if kind == "cancelOrder":
                status = self.cancel(action)
            elif kind in ("startPause", "stopPause"):
                self.paused = kind == "startPause"
            elif kind == "factsheetRequest":
                self.sheet()
            elif kind == "clearInstantActions":
                self.instants = {}
            elif kind != "stateRequest":
                status = "FAILED"
                self.fault("INVALID_INSTANT_ACTION", {"orderId": name})
            self.instants = dict(list(self.instants.items())[-20:]) | {name: [kind, status]}
            self.told = None

    def cancel(self, action):
        wanted = {p["key"]: p["value"] for p in action.get("actionParameters", ())}.get("orderId", self.order)
        if self.idle or wanted != self.order:
            self.fault("NO_ORDER_TO_CANCEL", {"orderId": action["actionId"]})
            return "FAILED"
        self.cancelled, self.running = True, None
        for state in self.states.values():
            state[1] = state[1] if state[1] == "FINISHED" else "FAILED"
        moving = math.hypot(self.x - self.at(self.reached)[0], self.y - self.at(self.reached)[1]) > 1e-6
        del self.stops[self.reached + (2 if moving else 1) :]  # line-guided: it stops at the next node
        return "FINISHED"

    # Driving and handling

    def at(self, number):
        position = self.stops[number]["nodePosition"]
        return position["x"], position["y"]

    def step(self, seconds):
        if self.paused or self.running or self.reached + 1 >= len(self.stops):
            self.speed = 0.0
        else:
            self.drive(seconds)
        self.handle()
        if not self.order or (self.idle and not self.speed):
            self.charge = min(100.0, self.charge + 0.3 * seconds)

    def drive(self, seconds):
        ahead, (x, y) = 0.0, (self.x, self.y)
        for number in range(self.reached + 1, len(self.stops)):
            ahead += math.dist((x, y), self.at(number))
            x, y = self.at(number)
        limit = ACCELERATION * self.options.speed**2
        self.speed = min(self.speed + limit * seconds, self.options.speed, math.sqrt(2.0 * limit * ahead) + 0.01)
        way = self.speed * seconds
        self.charge = max(0.0, self.charge - 0.02 * way)
        while self.reached + 1 < len(self.stops):
            x, y = self.at(self.reached + 1)
            left = math.dist((self.x, self.y), (x, y))
            if left > way:
                self.x += (x - self.x) * way / left
                self.y += (y - self.y) * way / left
                return
            self.x, self.y, way = x, y, way - left
            self.reached += 1
            self.node, self.sequence = self.stops[self.reached]["nodeId"], self.stops[self.reached]["sequenceId"]
            if not self.cancelled and self.stops[self.reached]["actions"]:
                return

    def handle(self):
        """Does what is to be done at the node where it is, one after the other."""
        acts = self.stops[self.reached]["actions"] if self.stops and not self.cancelled else ()
        action = next((a for a in acts if self.states[a["actionId"]][1] in ("WAITING", "RUNNING")), None)
        if action is None:
            self.running = None
        elif self.running != action["actionId"]:
            self.running, self.began = action["actionId"], time.monotonic()
            self.states[self.running][1] = "RUNNING"
        elif time.monotonic() - self.began >= self.options.handling:
            words = {p["key"]: p["value"] for p in action.get("actionParameters", ())}
            self.load = words.get("loadId", "a box") if action["actionType"] == "pick" else ""
            self.states[self.running][1] = "FINISHED"
            self.running = None

    # What it tells (6.6 and 6.10)

    def tell(self):
        """Its state, when something has happened, and after a while."""
        left = self.stops[self.reached + 1 :]
        words = {
            "orderId": self.order,
            "orderUpdateId": self.update,
            "lastNodeId": self.node,
            "lastNodeSequenceId": self.sequence,
            "nodeStates": [{key: node[key] for key in ("nodeId", "sequenceId", "released")} for node in left],
            "edgeStates": [
                {"edgeId": self.edges[n["sequenceId"] - 1], "sequenceId": n["sequenceId"] - 1, "released": True}
                for n in left
            ],
            "driving": self.speed > 0.0,
            "paused": self.paused,
            "actionStates": [
                {"actionId": name, "actionType": kind, "actionStatus": status}
                for name, (kind, status) in self.states.items()
            ],
            "instantActionStates": [
                {"actionId": name, "actionType": kind, "actionStatus": status}
                for name, (kind, status) in self.instants.items()
            ],
            "loads": [{"loadId": self.load}] if self.load else [],
            "operatingMode": "AUTOMATIC",
            "errors": self.errors,
            "safetyState": {"activeEmergencyStop": "NONE", "fieldViolation": False},
        }
        happened = json.dumps(words)
        if happened == self.told and time.monotonic() < self.due:
            return
        self.told, self.due = happened, time.monotonic() + self.options.interval
        place = {"x": self.x, "y": self.y, "theta": 0.0, "mapId": self.options.map, "localized": True}
        power = {"stateOfCharge": round(self.charge, 2), "charging": self.charge < 100.0 and not self.speed}
        self.publish("state", **words, mobileRobotPosition=place, powerSupply=power)

    def sheet(self):
        speed = self.options.speed
        can = [("pick", "NODE"), ("drop", "NODE")]
        can += [(kind, "INSTANT") for kind in ("cancelOrder", "startPause", "stopPause", "stateRequest")]
        self.publish(
            "factsheet",
            typeSpecification={
                "seriesName": "example",
                "mobileRobotKinematics": "DIFFERENTIAL",
                "mobileRobotClass": "CARRIER",
                "maximumLoadMass": 5.0,
                "localizationTypes": ["NATURAL"],
                "navigationTypes": ["VIRTUAL_LINE_GUIDED"],
            },
            physicalParameters={
                "minimumSpeed": 0.0,
                "maximumSpeed": speed,
                "maximumAcceleration": ACCELERATION * speed**2,
                "maximumDeceleration": ACCELERATION * speed**2,
                "minimumHeight": 0.3,
                "maximumHeight": 0.3,
                "width": 0.4,
                "length": self.options.length,
            },
            protocolLimits={
                "maximumStringLengths": {},
                "maximumArrayLengths": {},
                "timing": {
                    "minimumOrderInterval": 0.0,
                    "minimumStateInterval": 0.0,
                    "defaultStateInterval": self.options.interval,
                },
            },
            protocolFeatures={
                "optionalParameters": [],
                "mobileRobotActions": [
                    {"actionType": kind, "actionScopes": [scope], "pauseAllowed": False, "cancelAllowed": True}
                    for kind, scope in can
                ],
            },
            mobileRobotGeometry={},
            loadSpecification={},
        )


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    add = parser.add_argument
    add("meet", help="where the line's Zenoh sessions meet, such as tcp/127.0.0.1:7447")
    add("--scope", default="dtwin/line/line", help="what stands before the topics: dtwin/NAME/line of a line NAME")
    add("--manufacturer", default="example")
    add("--serial", default="cart")
    add("--map", default="one", help="name of its zone")
    add("--node", default="home", help="node at which it begins")
    add("--x", type=float, default=3.0, help="m")
    add("--y", type=float, default=-4.0, help="m")
    add("--speed", type=float, default=1.0, help="m/s")
    add("--handling", type=float, default=2.0, help="time to pick or drop a load, s")
    add("--interval", type=float, default=1.0, help="longest time from one state to the next, s")
    add("--length", type=float, default=0.4, help="m")
    options = parser.parse_args()
    config = zenoh.Config.from_json5(
        json.dumps(
            {
                "mode": "peer" if "127.0.0.1" in options.meet else "client",
                "scouting": {"multicast": {"enabled": False}},
                "connect": {"endpoints": [options.meet]},
            }
        )
    )
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    came = queue.SimpleQueue()
    base = f"{options.scope}/vda5050/v3/{options.manufacturer}/{options.serial}"
    with zenoh.open(config) as session:
        for topic in ("order", "instantActions"):
            session.declare_subscriber(f"{base}/{topic}", lambda s, t=topic: came.put((t, s.payload.to_bytes())))
        robot = Robot(options, lambda topic, message: session.put(f"{base}/{topic}", json.dumps(message)))
        last = time.monotonic()
        try:
            while True:
                while not came.empty():
                    topic, text = came.get()
                    take = robot.take_order if topic == "order" else robot.take_actions
                    try:
                        take(json.loads(text))
                    except (ValueError, KeyError, TypeError, IndexError):
                        robot.fault("VALIDATION_FAILURE", {})
                now = time.monotonic()
                robot.step(now - last)
                last = now
                robot.tell()
                time.sleep(STEP)
        except KeyboardInterrupt:
            robot.publish("connection", connectionState="OFFLINE")


if __name__ == "__main__":
    main()
