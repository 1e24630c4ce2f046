"""Topics at steady rates on PyPI's Cyclone DDS: `steady_python.py write|read DOMAIN:BYTES:HZ:reliable|best-effort ...`.

Each topic in a domain of its own. A writer begins when it has a reader and says `matched DOMAIN`; a reader says
`got DOMAIN NUMBER` for every message. Seconds of CLOCK_MONOTONIC stand before. It runs until it is stopped.
"""

# No `from __future__ import annotations`: the type below is read at run time.
import sys
import time
from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

_HEADERS = 9
"""The header of CDR, the length of the text and the zero behind it."""


@dataclass
class Word(IdlStruct, typename="std_msgs::msg::dds_::String_"):
    """std_msgs/msg/String."""

    data: str


class Steady:
    """One topic, at its writer or its reader."""

    def __init__(self, role: str, case: str) -> None:
        domain, size, rate, reliability = case.split(":")
        self.domain, self.size, self.every_s = int(domain), int(size), 1 / float(rate)
        self.participant = DomainParticipant(self.domain)
        reliable = Policy.Reliability.Reliable(duration(seconds=1))
        qos = Qos(reliable if reliability == "reliable" else Policy.Reliability.BestEffort, Policy.History.KeepLast(10))
        topic = Topic(self.participant, "rt/steady", Word)
        self.writer = DataWriter(self.participant, topic, qos=qos) if role == "write" else None
        self.reader = DataReader(self.participant, topic, qos=qos) if role == "read" else None
        self.number, self.due = 0, float("inf")

    def act(self) -> None:
        """Write what is due, or say what has come."""
        if self.reader is not None:
            for word in self.reader.take(N=16):
                if isinstance(word, Word):
                    say(f"got {self.domain} {word.data.split()[0]}")
        elif self.writer is not None:
            if self.due == float("inf") and self.writer.get_matched_subscriptions():
                say(f"matched {self.domain}")
                self.due = time.monotonic()
            if time.monotonic() >= self.due:
                self.number += 1
                self.due += self.every_s
                self.writer.write(Word(f"{self.number} ".ljust(self.size - _HEADERS, "x")))


def say(what: str) -> None:
    """Print a line, at once."""
    sys.stdout.write(f"{time.monotonic():.3f} {what}\n")
    sys.stdout.flush()


def main(role: str, cases: list[str]) -> None:
    """Serve all topics in turn."""
    topics = [Steady(role, case) for case in cases]
    while True:
        for topic in topics:
            topic.act()
        time.sleep(0.01)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
