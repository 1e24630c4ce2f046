"""What arrives of a vehicle; what a technician is told of it stands in `rc_cases.yml`."""

from dataclasses import dataclass, field
from math import cos, sin
from typing import Any

from rc_said import ARMED, BEGAN, RC, STRANGER, UNUSED, Says, heard, moving, together

from atlantis_netcfg.checklist.probes import Transcript, Trouble


@dataclass(frozen=True)
class Case:
    step: str
    """heard, or sticks."""
    transcript: Transcript
    wanted: dict[str, Any] = field(default_factory=dict)


CASES = {
    # Healthy.
    "healthy": Case("heard", heard([Says().second()] * 6)),
    "healthy, MAVLink 1": Case("heard", heard([Says(version=1).second()] * 6)),
    "healthy, beside a ground station and a camera": Case(
        "heard", heard([[*Says().second(), Says(255).heartbeat(0, 6, 8), Says(1).heartbeat(0, 30, 8)]] * 6)
    ),
    "healthy, beside an armed gimbal": Case(
        "heard", heard([[*Says().second(), Says(1, component=154).heartbeat(0x51 | ARMED, 26, 8)]] * 6)
    ),
    "healthy, beside another disarmed vehicle": Case("heard", heard([[*Says().second(), Says(7).heartbeat()]] * 6)),
    "healthy, unused channels": Case(
        "heard", heard([Says().second(1500, 1500, 1000, 1500, UNUSED, UNUSED, 2000, 900)] * 6)
    ),
    "healthy, above its own baseline": Case("heard", heard([Says().second(rssi=120)] * 6), {"rssi_low": 100}),
    "healthy, another system id is expected": Case("heard", heard([Says(4).second()] * 6), {"system_id": 4}),
    "sticks moved": Case("sticks", heard(moving(Says()))),
    "sticks moved, MAVLink 1": Case("sticks", heard(moving(Says(version=1)))),
    # Sick.
    "armed": Case("heard", heard([Says().second(mode=0x51 | ARMED)] * 6)),
    "armed for a moment": Case(
        "heard", heard([*[Says().second()] * 5, Says().second(mode=0x51 | ARMED), *[Says().second()] * 2])
    ),
    "another vehicle is armed": Case("heard", heard([[*Says().second(), Says(7).heartbeat(0x51 | ARMED)]] * 6)),
    "another vehicle only, and armed": Case("heard", heard([Says(7).second(mode=ARMED)] * 6)),
    "another vehicle only": Case("heard", heard([Says(7).second()] * 6)),
    "no autopilot in the stream": Case("heard", heard([[Says(255).heartbeat(0, 6, 8), Says().radio()]] * 6)),
    "heartbeats stopped": Case("heard", heard([*[Says().second()] * 2, *[[Says().channels(), Says().status()]] * 6])),
    "stream stopped": Case("heard", heard([Says().second()] * 2, 8.0)),
    "no RC_CHANNELS": Case("heard", heard([[Says().heartbeat(), Says().status(), Says().radio()]] * 6)),
    "channels stopped": Case("heard", heard([*[Says().second()] * 2, *[[Says().heartbeat(), Says().status()]] * 6])),
    "no channel": Case("heard", heard([[Says().heartbeat(), Says().status(), Says().channels(count=0, rssi=255)]] * 6)),
    "channels out of range": Case("heard", heard([Says().second(1500, 0, 2300, 1500)] * 6)),
    "receiver absent": Case("heard", heard([[Says().heartbeat(), Says().status(0, 0, 0), Says().channels()]] * 6)),
    "receiver disabled": Case("heard", heard([[Says().heartbeat(), Says().status(RC, 0, RC), Says().channels()]] * 6)),
    "receiver not healthy": Case(
        "heard", heard([[Says().heartbeat(), Says().status(RC, RC, 0), Says().channels()]] * 6)
    ),
    "no SYS_STATUS": Case("heard", heard([[Says().heartbeat(), Says().channels()]] * 6)),
    "rssi not known": Case("heard", heard([Says().second(rssi=255)] * 6)),
    "rssi not known, with a baseline": Case("heard", heard([Says().second(rssi=255)] * 6), {"rssi_low": 100}),
    "rssi below the vehicle's own baseline": Case("heard", heard([Says().second(rssi=80)] * 6), {"rssi_low": 100}),
    "rssi unsteady": Case("heard", heard([Says().second(rssi=rssi) for rssi in (200, 90, 210, 120, 200, 100)])),
    "rssi zero": Case("heard", heard([Says().second(rssi=0)] * 6)),
    "sticks at rest": Case("sticks", heard([Says().second()] * 12)),
    "sticks of another transmitter": Case(
        "sticks", heard([[*Says().second(), *Says(7).second(1100 + 100 * (second % 5))] for second in range(12)])
    ),
    "noise and trims are no movement": Case(
        "sticks", heard([Says().second(*[1500 + 20 * (second % 5)] * 8) for second in range(12)])
    ),
    "one stick only": Case("sticks", heard(moving(Says(), axes=2))),
    "armed while the sticks moved": Case("sticks", heard([*moving(Says())[:6], *[Says().second(mode=ARMED)] * 6])),
    "armed, and sticks at rest": Case("sticks", heard([Says().second(mode=ARMED)] * 12)),
    "no RC_CHANNELS while the sticks moved": Case("sticks", heard([[Says().heartbeat()]] * 12)),
    "channels came twice only": Case("sticks", heard([*moving(Says())[:2], *[[Says().heartbeat()]] * 10])),
    # From somebody else, or of another time.
    "another computer sends as this system": Case("heard", heard([Says().second()] * 6, sender=STRANGER)),
    "another computer sends as this system, armed": Case(
        "heard", heard([[*Says().second(), (STRANGER, Says().heartbeat(ARMED))]] * 6)
    ),
    "healthy, and another computer sends as this system": Case(
        "heard", heard([[*Says().second(), *((STRANGER, one) for one in Says().second(1100))]] * 6)
    ),
    "nobody has declared where it comes from": Case("heard", heard([Says().second()] * 6), {"address": None}),
    "a camera that calls itself an autopilot": Case("heard", heard([Says(component=100).second()] * 6)),
    "channels of a component beside the autopilot": Case(
        "heard", heard([[Says().heartbeat(), Says().status(), Says(component=100).channels()]] * 6)
    ),
    "one message again and again": Case("heard", heard([Says().second()] * 6, count=lambda _: 61.0)),
    "a flight that is played too fast": Case("heard", heard([Says().second()] * 6, count=lambda at: 10 * at)),
    "a flight that is played in a loop": Case("heard", heard([Says().second()] * 6, count=lambda at: at % 4)),
    "a flight of an hour ago": Case("heard", heard([[*Says().second(), Says().time(BEGAN - 3600)]] * 6)),
    "healthy, with the time": Case("heard", heard([[*Says().second(), Says().time(BEGAN + 3)]] * 6)),
    "healthy, and nobody has set its clock": Case("heard", heard([[*Says().second(), Says().time(40)]] * 6)),
    "channels came once": Case("heard", heard([[Says().heartbeat(), Says().status()]] * 5 + [Says().second()])),
    "no channel is used": Case("heard", heard([Says().second(*[UNUSED] * 8)] * 6)),
    "a ground station sends channels": Case(
        "heard", heard([[*Says().second(), Says(255, component=190).override()]] * 6)
    ),
    "a ground station moves the sticks": Case(
        "sticks", heard([[*second, Says(255, component=190).override()] for second in moving(Says())])
    ),
    "four sticks in lockstep": Case("sticks", heard(together(Says(), 1, 1, 1, 1, 0, 0))),
    "four sticks in lockstep, two the other way": Case("sticks", heard(together(Says(), 1, -1, 1, -1))),
    "switches and knobs moved in place of sticks": Case(
        "sticks",
        heard(
            [
                Says().second(*[1500] * 4, *[(1500, 1900, 1500, 1100)[(second + axis) % 4] for axis in range(4)])
                for second in range(12)
            ]
        ),
    ),
    "sticks of another computer that sends as this system": Case(
        "sticks", heard([[*Says().second(), *((STRANGER, one) for one in second)] for second in moving(Says())])
    ),
    "sticks moved, each the mirror of the other": Case(
        "sticks",
        heard(
            [Says().second(*[1500 + round(400 * turn) for turn in (sin(s), cos(s), cos(s), sin(s))]) for s in range(12)]
        ),
    ),
    # Absent.
    "nothing arrives": Case("heard", heard([], 8.0)),
    "gateway not reached": Case("heard", heard([], 0.0, trouble=Trouble.NO_PLACE, words="Connection timed out")),
    "port not allowed": Case(
        "heard", heard([], 0.0, trouble=Trouble.DENIED, words="UDP port 14550: Permission denied")
    ),
    "other trouble": Case(
        "heard", heard([], 0.0, trouble=Trouble.UNREACHABLE, words="UDP port 14550: Cannot assign requested address")
    ),
    "nothing arrives while the sticks moved": Case("sticks", heard([], 12.0)),
    # Garbage.
    "another protocol": Case("heard", heard([[b"$GPGGA,1*00\r\n"]] * 6)),
    "every frame damaged": Case("heard", heard([[frame[:-1] + b"\x00" for frame in Says().second()]] * 6)),
    "some frames damaged": Case(
        "heard", heard([*[Says().second()] * 5, [*Says().second(), b"\xfd\x09garbage", b"noise"]])
    ),
    "every fourth frame damaged": Case("heard", heard([[*Says().second()[:3], b"\x00noise", Says().channels()]] * 6)),
    "messages of another dialect": Case(
        "heard", heard([[*Says().second(), b"\xfd\x02\x00\x00\x05\x01\x01\x10\xa4\x00\x01\x02\x03\x04"]] * 6)
    ),
    "frames cut over datagrams": Case("heard", heard([Says().second()] * 6, cut=7)),
    # Slow.
    "a round every three seconds": Case(
        "heard", heard([Says().second() if second % 3 == 0 else [] for second in range(8)], 8.0)
    ),
    # In use.
    "a ground station has the port": Case(
        "heard", heard([], 0.0, trouble=Trouble.BUSY, words="UDP port 14550: Address already in use")
    ),
}
