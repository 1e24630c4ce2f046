"""STAMP as scapy has it (`scapy.contrib.stamp`, unauthenticated mode): judge of packets, sender, reflector."""

from __future__ import annotations

import json
import logging
import socket
import sys
import time
from typing import Any

logging.getLogger("scapy").setLevel(logging.CRITICAL)

from scapy.contrib.stamp import (  # noqa: E402 - it warns of interfaces while it is imported
    ErrorEstimate,
    STAMPSessionReflectorTestUnauthenticated,
    STAMPSessionSenderTestUnauthenticated,
    STAMPTestTLV,
)

NTP_1970 = 2_208_988_800
LAST = 0xFFFFFFFF
UNRECOGNISED = 0x80
"""RFC 8972, 4.1: the first bit; the letters of scapy's field begin at the last one."""


def main() -> None:
    """Do the job and tell what came back."""
    job = json.loads(sys.argv[1])
    print(json.dumps(globals()[job["do"]](job)))


def _plain(packet: Any) -> dict[str, Any]:
    """The fields of a packet, with whole numbers and texts for what JSON has not."""
    fields: dict[str, Any] = {}
    for name, value in packet.fields.items():
        if name.startswith("err_estimate"):
            fields[name] = [int(value.S), int(value.Z), int(value.scale), int(value.multiplier)]
        elif name == "tlv_objects":
            fields[name] = [[int(tlv.flags), int(tlv.type), bytes(tlv.value).hex()] for tlv in value]
        else:
            fields[name] = float(getattr(packet, name)) if name.startswith("ts") else int(value)
    return {**fields, "whole": bytes(packet).hex()}


def read(job: dict[str, Any]) -> Any:
    """What it sees in our packets."""
    sender = [_plain(STAMPSessionSenderTestUnauthenticated(bytes.fromhex(text))) for text in job["requests"]]
    return [sender, [_plain(STAMPSessionReflectorTestUnauthenticated(bytes.fromhex(text))) for text in job["answers"]]]


def send(job: dict[str, Any]) -> Any:
    """Send its own packets to a reflector, one by one, and tell what came back and how long it took."""
    told = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as opened:
        opened.settimeout(20)
        opened.connect((job["host"], job["port"]))
        for number in range(job["count"]):
            tlvs = [STAMPTestTLV(flags=UNRECOGNISED, type=1, len=12, value=bytes(12))] if number % 2 else []
            packet = STAMPSessionSenderTestUnauthenticated(
                seq=number, ts=time.time() + NTP_1970, ssid=77, err_estimate=ErrorEstimate(S=1), tlv_objects=tlvs
            )
            whole = bytes(packet)
            opened.send(whole)
            reply = opened.recv(4000)
            told.append([len(whole), len(reply), _plain(STAMPSessionReflectorTestUnauthenticated(reply)), whole.hex()])
    return told


def reflect(job: dict[str, Any]) -> Any:
    """Answer packets; those of `lost_up` as if they had not come, those of `lost_down` as if the answer was lost."""
    answered = 0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as opened:
        opened.bind((job["host"], job["port"]))
        opened.settimeout(30)
        while True:
            data, source = opened.recvfrom(4000)
            received = time.time() + NTP_1970
            asked = STAMPSessionSenderTestUnauthenticated(data)
            if asked.seq == LAST:
                return answered
            if asked.seq in job["lost_up"]:
                continue
            reply = STAMPSessionReflectorTestUnauthenticated(
                seq=answered,
                ts_rx=received,
                ssid=asked.ssid,
                seq_sender=asked.seq,
                err_estimate_sender=asked.err_estimate,
                ttl_sender=64,
                tlv_objects=asked.tlv_objects,
                ts=time.time() + NTP_1970,
            )
            # As it stands on the wire: its own conversion to seconds and back loses the last bit.
            reply.fields["ts_sender"] = asked.fields["ts"]
            answered += 1
            if asked.seq not in job["lost_down"]:
                opened.sendto(bytes(reply), source)


if __name__ == "__main__":
    main()
