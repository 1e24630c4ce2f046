"""Publishes or hears one cell after the other with Cyclone DDS: `dds_cells.py publish|hear PLAN`, a JSON file.

PLAN: `cells` (kind, label, octets, messages a second, seconds) and `patience_s`, for which nothing is sent between two
cells. Both run on this computer, so the clock of a sample's
departure is that of its arrival, and a delay one way is exact. Who hears prints `heard CELL SECONDS` for each sample.
"""

# No `from __future__ import annotations`: the type below is read at run time.
import json
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from cyclonedds.core import InstanceState, Policy, Qos, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

_AROUND = 28
"""Octets of a sample beside its text: CDR's header, cell, departure, and the text's length and end."""


@dataclass
class Message(IdlStruct, typename="atlantis::satcom::Message"):
    """One of a cell."""

    cell: int
    sent_s: float
    text: str


def say(what: str) -> None:
    """Print a line, at once."""
    sys.stdout.write(f"{what}\n")
    sys.stdout.flush()


def publish(participant: DomainParticipant, topic: Topic[Message], qos: Qos, plan: Path) -> None:
    """Wait for the hearer, then send every cell on its schedule."""
    told = json.loads(plan.read_text(encoding="utf-8"))
    writer = DataWriter(participant, topic, qos=qos)
    while not writer.get_matched_subscriptions():
        time.sleep(0.1)
    say("met")
    for number, (_, _, octets, rate_hz, seconds) in enumerate(told["cells"]):
        text = "x" * max(1, round(octets) - _AROUND)
        begin, count = time.monotonic() + told["patience_s"], max(1, round(rate_hz * seconds))
        for message in range(count):
            time.sleep(max(0.0, begin + message / rate_hz - time.monotonic()))
            writer.write(Message(number, time.monotonic(), text))
        say(f"sent {number} {count}")
    time.sleep(told["patience_s"])
    say("done")
    sys.stdin.read()


def hear(participant: DomainParticipant, topic: Topic[Message], qos: Qos) -> None:
    """Say of every sample how long it took, until it is stopped."""
    reader = DataReader(participant, topic, qos=qos)
    waits = WaitSet(participant)
    waits.attach(ReadCondition(reader, SampleState.Any | ViewState.Any | InstanceState.Any))
    while True:
        waits.wait(duration(seconds=1))
        now = time.monotonic()
        for message in reader.take(N=100):
            if isinstance(message, Message):
                say(f"heard {message.cell} {now - message.sent_s:.4f}")


def main(what: str, plan: Path) -> None:
    """Do either."""
    participant = DomainParticipant(0)
    qos = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(64))
    topic = Topic(participant, "atlantis/satcom", Message)
    if what == "hear":
        hear(participant, topic, qos)
    else:
        publish(participant, topic, qos, plan)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
