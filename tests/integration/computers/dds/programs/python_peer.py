"""A participant on PyPI's Cyclone DDS: `python_peer.py NAME DOMAIN` says what it hears, until it is stopped.

Lines: `SECONDS peer + KEY`, `SECONDS peer - KEY`, `SECONDS got FROM NUMBER`; seconds of CLOCK_MONOTONIC.
"""

# No `from __future__ import annotations`: the type below is read at run time.
import itertools
import sys
import time
from dataclasses import dataclass

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsParticipant
from cyclonedds.core import InstanceState, Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic


@dataclass
class Word(IdlStruct, typename="std_msgs::msg::dds_::String_"):
    """std_msgs/msg/String."""

    data: str


def say(what: str) -> None:
    """Print a line, at once."""
    sys.stdout.write(f"{time.monotonic():.3f} {what}\n")
    sys.stdout.flush()


def main(own: str, domain: int) -> None:
    """Write a word twice a second, and tell of peers and of their words."""
    participant = DomainParticipant(domain)
    best_effort = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(16))  # its own words come back too
    topic = Topic(participant, "rt/proof", Word)
    writer, reader = DataWriter(participant, topic, qos=best_effort), DataReader(participant, topic, qos=best_effort)
    peers = BuiltinDataReader(participant, BuiltinTopicDcpsParticipant)
    for number in itertools.count(1):
        writer.write(Word(f"{own} {number}"))
        for peer in peers.take(N=16):
            alive = peer.sample_info.instance_state == InstanceState.Alive
            say(f"peer {'+' if alive else '-'} {getattr(peer, 'key', '')}")
        for word in reader.take(N=16):
            if isinstance(word, Word) and not word.data.startswith(own):
                say(f"got {word.data}")
        time.sleep(0.5)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
