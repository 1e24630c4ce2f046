"""In place of ROS 2's rclpy and rosidl_runtime_py: functions that their documentation has, and a network of a file.

ROS_STAND_IN names it: rows of a topic, its type, the node and its namespace, the identity of the endpoint, whether it
is reliable, from when on it is there, how often it sends, and the messages, in turn, as CDR in hex digits.
"""

import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

qos_profile_sensor_data = "sensor data"
FIELDS = {
    "std_msgs/msg/String": {"data": "string"},
    "std_msgs/msg/Float32": {"data": "float"},
    "sensor_msgs/msg/NavSatFix": {"header": "std_msgs/Header", "latitude": "double"},
    "rcl_interfaces/msg/Log": {"stamp": "builtin_interfaces/Time"},
}
"""Of the types that are installed: one of the partners' is not."""
_STARTED: list[str] = []


def init(*, args: list[str]) -> None:
    assert args == []
    _STARTED.append(os.environ["ROS_DOMAIN_ID"])


def create_node(node_name: str) -> "_Node":
    assert _STARTED, "init comes first"
    return _Node(node_name)


def spin_once(node: "_Node", *, timeout_sec: float) -> None:
    time.sleep(timeout_sec)
    for row in node.due():
        node.send(row)


class _Node:
    def __init__(self, name: str) -> None:
        self._rows: list[dict[str, Any]] = json.loads(Path(os.environ["ROS_STAND_IN"]).read_text(encoding="ascii"))
        own = {"topic": "/rosout", "type": "rcl_interfaces/msg/Log", "node": name, "namespace": "/", "gid": "ff" * 16}
        self._rows.append({**own, "reliable": True, "rate_hz": 0, "messages": []})
        self._subscriptions: list[tuple[str, str, Callable[[bytes], None]]] = []
        self._sent = [0] * len(self._rows)
        self._began = time.monotonic()

    def _present(self) -> list[dict[str, Any]]:
        now = time.monotonic() - self._began
        return [row for row in self._rows if row.get("from_s", 0) <= now]

    def get_topic_names_and_types(self) -> list[tuple[str, list[str]]]:
        names = {row["topic"] for row in self._present()}
        types = {name: sorted({row["type"] for row in self._rows if row["topic"] == name}) for name in names}
        return [*types.items(), ("/nobody/publishes", ["std_msgs/msg/Bool"])]

    def get_publishers_info_by_topic(self, topic_name: str) -> list[SimpleNamespace]:
        return [
            SimpleNamespace(
                node_name=row["node"],
                node_namespace=row["namespace"],
                topic_type=row["type"],
                endpoint_gid=list(bytes.fromhex(row["gid"]).ljust(24, b"\0")),
                qos_profile=SimpleNamespace(
                    reliability=SimpleNamespace(
                        name="RMW_QOS_POLICY_RELIABILITY_RELIABLE" if row["reliable"] else "BEST_EFFORT"
                    )
                ),
            )
            for row in self._present()
            if row["topic"] == topic_name
        ]

    def create_subscription(
        self,
        msg_type: SimpleNamespace,
        topic: str,
        callback: Callable[[bytes], None],
        qos_profile: object,
        *,
        raw: bool,
    ) -> object:
        assert raw
        assert qos_profile is qos_profile_sensor_data
        self._subscriptions.append((topic, msg_type.name, callback))
        return object()

    def due(self) -> list[int]:
        now = time.monotonic() - self._began
        return [n for n, row in enumerate(self._rows) if self._sent[n] < (now - row.get("from_s", 0)) * row["rate_hz"]]

    def send(self, number: int) -> None:
        row = self._rows[number]
        data = bytes.fromhex(row["messages"][self._sent[number] % len(row["messages"])])
        self._sent[number] += 1
        for topic, kind, callback in self._subscriptions:
            if (topic, kind) == (row["topic"], row["type"]):
                callback(data)


class _Type:
    def __init__(self, name: str) -> None:
        self.name = name

    def get_fields_and_field_types(self) -> dict[str, str]:
        return FIELDS[self.name]


def get_message(identifier: str) -> _Type:
    if identifier not in FIELDS:
        raise ModuleNotFoundError(f"No module named '{identifier.partition('/')[0]}'")
    return _Type(identifier)
