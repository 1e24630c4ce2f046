"""TEST_ROBOT of a rehearsal: a DDS participant at a gateway's VPN address, and its listener at the control centre.

    python -m atlantis_netcfg.operations.pilot_network.robot say|hear ARGUMENTS

Each runs as a process in the network namespace of its computer, with the DDS settings that mock robots have. The robot
publishes a configuration at 1 Hz; the listener prints the text of each one that arrives.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from atlantis_netcfg.inventory import load
from atlantis_netcfg.inventory.robots import reading
from atlantis_netcfg.operations.robots import dds_of
from atlantis_netcfg.robots import listener, message_types, network

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from atlantis_netcfg.inventory import Inventory

NAME: Final = "TEST_ROBOT"
_MARK: Final = f"namespace: {NAME}, at "
_PERIOD_S: Final = 1.0
_END_S: Final = 5.0


class RobotProcess:
    """One of the two programs in a namespace, and the lines that it prints."""

    def __init__(self, namespace: str, role: str, arguments: dict[str, Any]) -> None:
        self._last_heard_s: dict[str, float] = {}
        self._arrival = threading.Condition()
        words = (sys.executable, "-P", "-m", __name__, role, json.dumps(arguments))
        self._process = subprocess.Popen(  # noqa: S603 - our interpreter and our module
            ("ip", "netns", "exec", namespace, *words),  # noqa: S607 - a program of the system
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            start_new_session=True,
        )
        self._reader = threading.Thread(target=self._read, name=f"{NAME}-{role}", daemon=True)
        self._reader.start()

    def close(self) -> None:
        """End the program."""
        self._process.kill()
        self._process.wait(_END_S)
        self._reader.join()

    def wait_for(self, host: str, timeout_s: float) -> bool:
        """Return whether the robot at a host is heard from now on, within `timeout_s`; any thread may wait."""
        begin = time.monotonic()
        with self._arrival:
            return self._arrival.wait_for(lambda: self._last_heard_s.get(host, begin) > begin, timeout_s)

    def _read(self) -> None:
        assert self._process.stdout is not None  # noqa: S101 - it is a pipe
        with self._process.stdout as lines:
            for line in lines:
                with self._arrival:
                    self._last_heard_s[line.strip()] = time.monotonic()
                    self._arrival.notify_all()


@contextmanager
def run_robots(
    inventory: Inventory, robots: Sequence[tuple[str, str, str]], centre: tuple[str, str]
) -> Iterator[RobotProcess]:
    """Run a robot at each host (name, namespace, VPN address); yield the listener at `centre` (namespace, address)."""
    common = {"inventory": str(inventory.root), "participants": dds_of(inventory).participants}
    processes: list[RobotProcess] = []
    try:
        for name, namespace, address in robots:
            place = {**common, "host": name, "address": address, "peers": [centre[1]]}
            processes.append(RobotProcess(namespace, "say", place))
        place = {**common, "address": centre[1], "peers": [address for _, _, address in robots]}
        processes.append(RobotProcess(centre[0], "hear", place))
        yield processes[-1]
    finally:
        for process in processes:
            process.close()


def _main(role: str, place: dict[str, Any]) -> None:
    inventory = load(Path(place["inventory"]))
    topic = reading.key_names(inventory)[0].configuration_topic
    types = message_types.MessageTypes(inventory.root / reading.FOLDER / message_types.INTERFACES)
    profile = network.profile(place["address"], place["peers"], place["participants"])
    with network.domain(dds_of(inventory).domain, profile) as number:
        if role == "say":
            _say(network.Publisher(number, types), types, topic, place["host"])
        _hear(number, types, topic)


def _say(publisher: network.Publisher, types: message_types.MessageTypes, topic: str, host: str) -> None:
    kind: Any = types.idl(listener.CONFIGURATION_TYPE)
    message = kind(data=f"{_MARK}{host}\n")
    while True:
        publisher.publish(topic, listener.CONFIGURATION_TYPE, message)
        time.sleep(_PERIOD_S)


def _hear(number: int, types: message_types.MessageTypes, topic: str) -> None:
    def keep(_writer: object, data: bytes) -> None:
        _, mark, rest = data.partition(_MARK.encode())
        if mark:
            sys.stdout.buffer.write(rest.partition(b"\n")[0] + b"\n")
            sys.stdout.flush()

    network.RobotListener(number, types, topic, keep=keep).listen(math.inf)


if __name__ == "__main__":
    _main(sys.argv[1], json.loads(sys.argv[2]))
