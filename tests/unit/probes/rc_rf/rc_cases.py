"""What arrives of a vehicle, and every sentence that a technician is told of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import cos, sin
from typing import TYPE_CHECKING, Any

from rc_said import ARMED, BEGAN, RC, STRANGER, UNUSED, Says, heard, moving, together

from atlantis_netcfg.checklist.probes import Trouble

if TYPE_CHECKING:
    from atlantis_netcfg.checklist.probes import Transcript


@dataclass(frozen=True)
class Case:
    name: str
    step: str
    """heard, or sticks."""
    transcript: Transcript
    findings: tuple[str, ...]
    wanted: dict[str, Any] = field(default_factory=dict)


CASES = (
    # Healthy.
    Case(
        "healthy",
        "heard",
        heard([Says().second()] * 6),
        ("PASS rc-heard: Stork is disarmed and hears its remote control: 8 channels, rssi 200",),
    ),
    Case(
        "healthy, MAVLink 1",
        "heard",
        heard([Says(version=1).second()] * 6),
        ("PASS rc-heard: Stork is disarmed and hears its remote control: 8 channels, rssi 200",),
    ),
    Case(
        "healthy, beside a ground station and a camera",
        "heard",
        heard([[*Says().second(), Says(255).heartbeat(0, 6, 8), Says(1).heartbeat(0, 30, 8)]] * 6),
        ("PASS rc-heard: Stork is disarmed and hears its remote control: 8 channels, rssi 200",),
    ),
    Case(
        "healthy, beside another disarmed vehicle",
        "heard",
        heard([[*Says().second(), Says(7).heartbeat()]] * 6),
        ("PASS rc-heard: Stork is disarmed and hears its remote control: 8 channels, rssi 200",),
    ),
    Case(
        "healthy, unused channels",
        "heard",
        heard([Says().second(1500, 1500, 1000, 1500, UNUSED, UNUSED, 2000, 900)] * 6),
        ("PASS rc-heard: Stork is disarmed and hears its remote control: 8 channels, rssi 200",),
    ),
    Case(
        "healthy, above its own baseline",
        "heard",
        heard([Says().second(rssi=120)] * 6),
        ("PASS rc-heard: Stork is disarmed and hears its remote control: 8 channels, rssi 120",),
        {"rssi_low": 100},
    ),
    Case(
        "healthy, another system id is expected",
        "heard",
        heard([Says(4).second()] * 6),
        ("PASS rc-heard: Stork is disarmed and hears its remote control: 8 channels, rssi 200",),
        {"system_id": 4},
    ),
    Case(
        "sticks moved", "sticks", heard(moving(Says())), ("PASS moved: Stork's channels follow the sticks: 1, 2, 3, 4",)
    ),
    Case(
        "sticks moved, MAVLink 1",
        "sticks",
        heard(moving(Says(version=1))),
        ("PASS moved: Stork's channels follow the sticks: 1, 2, 3, 4",),
    ),
    # Sick.
    Case(
        "armed",
        "heard",
        heard([Says().second(mode=0x51 | ARMED)] * 6),
        ("FAIL armed: STOP AT ONCE: Stork is armed, its propellers may start",),
    ),
    Case(
        "armed for a moment",
        "heard",
        heard([*[Says().second()] * 5, Says().second(mode=0x51 | ARMED), *[Says().second()] * 2]),
        ("FAIL armed: STOP AT ONCE: Stork is armed, its propellers may start",),
    ),
    Case(
        "another vehicle is armed",
        "heard",
        heard([[*Says().second(), Says(7).heartbeat(0x51 | ARMED)]] * 6),
        ("FAIL armed: STOP AT ONCE: system 7 is armed, its propellers may start",),
    ),
    Case(
        "another vehicle only, and armed",
        "heard",
        heard([Says(7).second(mode=ARMED)] * 6),
        (
            "FAIL armed: STOP AT ONCE: system 7 is armed, its propellers may start",
            "FAIL other-system: Stork should be system 1, and what is heard is system 7",
        ),
    ),
    Case(
        "another vehicle only",
        "heard",
        heard([Says(7).second()] * 6),
        ("FAIL other-system: Stork should be system 1, and what is heard is system 7",),
    ),
    Case(
        "no autopilot in the stream",
        "heard",
        heard([[Says(255).heartbeat(0, 6, 8), Says().radio()]] * 6),
        (
            (
                "FAIL no-heartbeat: MAVLink arrives at UDP port 14550 of coastal-gateway, and no "
                "autopilot's heartbeat in it within 6 s"
            ),
        ),
    ),
    Case(
        "heartbeats stopped",
        "heard",
        heard([*[Says().second()] * 2, *[[Says().channels(), Says().status()]] * 6]),
        ("FAIL heartbeat-lost: Stork's last heartbeat is 6 s old",),
    ),
    Case(
        "stream stopped",
        "heard",
        heard([Says().second()] * 2, 8.0),
        ("FAIL heartbeat-lost: Stork's last heartbeat is 6 s old",),
    ),
    Case(
        "no RC_CHANNELS",
        "heard",
        heard([[Says().heartbeat(), Says().status(), Says().radio()]] * 6),
        ("INCONCLUSIVE no-channels: Stork sends no RC_CHANNELS within 6 s",),
    ),
    Case(
        "channels stopped",
        "heard",
        heard([*[Says().second()] * 2, *[[Says().heartbeat(), Says().status()]] * 6]),
        ("FAIL channels-stale: Stork's channels have stopped 6 s ago, its heartbeats go on",),
    ),
    Case(
        "no channel",
        "heard",
        heard([[Says().heartbeat(), Says().status(), Says().channels(count=0, rssi=255)]] * 6),
        ("FAIL no-receiver: Stork's autopilot sees no channel of the remote control",),
    ),
    Case(
        "channels out of range",
        "heard",
        heard([Says().second(1500, 0, 2300, 1500)] * 6),
        ("FAIL channels-odd: Stork's channels are outside 900 to 2100 us: channel 2: 0, channel 3: 2300",),
    ),
    Case(
        "receiver absent",
        "heard",
        heard([[Says().heartbeat(), Says().status(0, 0, 0), Says().channels()]] * 6),
        ("FAIL receiver-absent: Stork's autopilot has no receiver of a remote control",),
    ),
    Case(
        "receiver disabled",
        "heard",
        heard([[Says().heartbeat(), Says().status(RC, 0, RC), Says().channels()]] * 6),
        ("FAIL receiver-disabled: Stork's autopilot has the remote control switched off",),
    ),
    Case(
        "receiver not healthy",
        "heard",
        heard([[Says().heartbeat(), Says().status(RC, RC, 0), Says().channels()]] * 6),
        (("FAIL receiver-unhealthy: Stork's autopilot says that the remote control's receiver is not healthy"),),
    ),
    Case(
        "no SYS_STATUS",
        "heard",
        heard([[Says().heartbeat(), Says().channels()]] * 6),
        (("WARN no-sys-status: Stork sends no SYS_STATUS: its autopilot's own opinion of the receiver is not known"),),
    ),
    Case(
        "rssi not known",
        "heard",
        heard([Says().second(rssi=255)] * 6),
        ("WARN rssi-unknown: Stork does not tell how strong the remote control is heard (rssi 255)",),
    ),
    Case(
        "rssi not known, with a baseline",
        "heard",
        heard([Says().second(rssi=255)] * 6),
        ("WARN rssi-unknown: Stork does not tell how strong the remote control is heard (rssi 255)",),
        {"rssi_low": 100},
    ),
    Case(
        "rssi below the vehicle's own baseline",
        "heard",
        heard([Says().second(rssi=80)] * 6),
        ("WARN rssi-low: the remote control of Stork is heard with rssi 80, below its own 100",),
        {"rssi_low": 100},
    ),
    Case(
        "rssi unsteady",
        "heard",
        heard([Says().second(rssi=rssi) for rssi in (200, 90, 210, 120, 200, 100)]),
        ("WARN rssi-unsteady: the remote control of Stork is heard unsteadily: rssi 90 to 210",),
    ),
    Case(
        "rssi zero",
        "heard",
        heard([Says().second(rssi=0)] * 6),
        ("WARN rssi-zero: Stork tells rssi 0: no signal, or nobody has set up how it is measured",),
    ),
    Case(
        "sticks at rest",
        "sticks",
        heard([Says().second()] * 12),
        ("FAIL no-movement: none of Stork's 8 channels moved while the pilot moved the sticks",),
    ),
    Case(
        "sticks of another transmitter",
        "sticks",
        heard([[*Says().second(), *Says(7).second(1100 + 100 * (second % 5))] for second in range(12)]),
        ("FAIL no-movement: none of Stork's 8 channels moved while the pilot moved the sticks",),
    ),
    Case(
        "noise and trims are no movement",
        "sticks",
        heard([Says().second(*[1500 + 20 * (second % 5)] * 8) for second in range(12)]),
        ("FAIL no-movement: none of Stork's 8 channels moved while the pilot moved the sticks",),
    ),
    Case(
        "one stick only",
        "sticks",
        heard(moving(Says(), axes=2)),
        ("WARN few-moved: channels that moved: 1, 2; two sticks have 4 axes",),
    ),
    Case(
        "armed while the sticks moved",
        "sticks",
        heard([*moving(Says())[:6], *[Says().second(mode=ARMED)] * 6]),
        ("FAIL armed: STOP AT ONCE: Stork is armed, its propellers may start",),
    ),
    Case(
        "armed, and sticks at rest",
        "sticks",
        heard([Says().second(mode=ARMED)] * 12),
        (
            "FAIL armed: STOP AT ONCE: Stork is armed, its propellers may start",
            "FAIL no-movement: none of Stork's 8 channels moved while the pilot moved the sticks",
        ),
    ),
    Case(
        "no RC_CHANNELS while the sticks moved",
        "sticks",
        heard([[Says().heartbeat()]] * 12),
        ("INCONCLUSIVE no-channels: Stork sends no RC_CHANNELS within 12 s",),
    ),
    Case(
        "channels came twice only",
        "sticks",
        heard([*moving(Says())[:2], *[[Says().heartbeat()]] * 10]),
        ("INCONCLUSIVE few-channels: Stork's channels came 2 times only while the sticks were moved",),
    ),
    # From somebody else, or of another time.
    Case(
        "another computer sends as this system",
        "heard",
        heard([Says().second()] * 6, sender=STRANGER),
        ("INCONCLUSIVE other-sender: system 1 is heard from 10.64.1.77, and Stork has 10.64.1.24",),
    ),
    Case(
        "another computer sends as this system, armed",
        "heard",
        heard([[*Says().second(), (STRANGER, Says().heartbeat(ARMED))]] * 6),
        ("FAIL armed: STOP AT ONCE: Stork is armed, its propellers may start",),
    ),
    Case(
        "healthy, and another computer sends as this system",
        "heard",
        heard([[*Says().second(), *((STRANGER, one) for one in Says().second(1100))]] * 6),
        ("PASS rc-heard: Stork is disarmed and hears its remote control: 8 channels, rssi 200",),
    ),
    Case(
        "nobody has declared where it comes from",
        "heard",
        heard([Says().second()] * 6),
        (
            (
                "INCONCLUSIVE sender-unknown: nobody has declared from which address the stream of Stork comes; "
                "it came from 10.64.1.24"
            ),
        ),
        {"address": None},
    ),
    Case(
        "a camera that calls itself an autopilot",
        "heard",
        heard([Says(component=100).second()] * 6),
        ("INCONCLUSIVE other-component: of system 1 component 100 is heard, and not its autopilot, which is 1",),
    ),
    Case(
        "channels of a component beside the autopilot",
        "heard",
        heard([[Says().heartbeat(), Says().status(), Says(component=100).channels()]] * 6),
        ("INCONCLUSIVE no-channels: Stork sends no RC_CHANNELS within 6 s",),
    ),
    Case(
        "one message again and again",
        "heard",
        heard([Says().second()] * 6, count=lambda _: 61.0),
        ("FAIL frozen: the same channels of Stork came 6 times: its autopilot's count stands still",),
    ),
    Case(
        "a flight that is played too fast",
        "heard",
        heard([Says().second()] * 6, count=lambda at: 10 * at),
        ("INCONCLUSIVE not-live: Stork's autopilot has counted 50 s in 5 s: what comes is not of now",),
    ),
    Case(
        "a flight that is played in a loop",
        "heard",
        heard([Says().second()] * 6, count=lambda at: at % 4),
        ("INCONCLUSIVE not-live: Stork's autopilot has counted 1 s in 5 s: what comes is not of now",),
    ),
    Case(
        "a flight of an hour ago",
        "heard",
        heard([[*Says().second(), Says().time(BEGAN - 3600)]] * 6),
        ("INCONCLUSIVE of-another-time: by its own clock the stream of Stork is 60 min old",),
    ),
    Case(
        "healthy, with the time",
        "heard",
        heard([[*Says().second(), Says().time(BEGAN + 3)]] * 6),
        ("PASS rc-heard: Stork is disarmed and hears its remote control: 8 channels, rssi 200",),
    ),
    Case(
        "healthy, and nobody has set its clock",
        "heard",
        heard([[*Says().second(), Says().time(40)]] * 6),
        ("PASS rc-heard: Stork is disarmed and hears its remote control: 8 channels, rssi 200",),
    ),
    Case(
        "channels came once",
        "heard",
        heard([[Says().heartbeat(), Says().status()]] * 5 + [Says().second()]),
        ("INCONCLUSIVE once: Stork's channels came once within 6 s: whether they are alive is not known",),
    ),
    Case(
        "no channel is used",
        "heard",
        heard([Says().second(*[UNUSED] * 8)] * 6),
        ("FAIL no-receiver: Stork's autopilot sees no channel of the remote control",),
    ),
    Case(
        "a ground station sends channels",
        "heard",
        heard([[*Says().second(), Says(255, component=190).override()]] * 6),
        ("INCONCLUSIVE overridden: a ground station sends channels to Stork in place of its remote control",),
    ),
    Case(
        "a ground station moves the sticks",
        "sticks",
        heard([[*second, Says(255, component=190).override()] for second in moving(Says())]),
        ("INCONCLUSIVE overridden: a ground station sends channels to Stork in place of its remote control",),
    ),
    Case(
        "four sticks in lockstep",
        "sticks",
        heard(together(Says(), 1, 1, 1, 1, 0, 0)),
        ("INCONCLUSIVE lockstep: channels 1, 2, 3, 4 of Stork move as one, which two sticks in circles do not",),
    ),
    Case(
        "four sticks in lockstep, two the other way",
        "sticks",
        heard(together(Says(), 1, -1, 1, -1)),
        ("INCONCLUSIVE lockstep: channels 1, 2, 3, 4 of Stork move as one, which two sticks in circles do not",),
    ),
    Case(
        "switches and knobs moved in place of sticks",
        "sticks",
        heard(
            [
                Says().second(*[1500] * 4, *[(1500, 1900, 1500, 1100)[(second + axis) % 4] for axis in range(4)])
                for second in range(12)
            ]
        ),
        ("WARN few-moved: channels that moved: 5, 6, 7, 8; two sticks have 4 axes",),
    ),
    Case(
        "sticks of another computer that sends as this system",
        "sticks",
        heard([[*Says().second(), *((STRANGER, one) for one in second)] for second in moving(Says())]),
        ("FAIL no-movement: none of Stork's 8 channels moved while the pilot moved the sticks",),
    ),
    Case(
        "sticks moved, each the mirror of the other",
        "sticks",
        heard(
            [Says().second(*[1500 + round(400 * turn) for turn in (sin(s), cos(s), cos(s), sin(s))]) for s in range(12)]
        ),
        ("PASS moved: Stork's channels follow the sticks: 1, 2, 3, 4",),
    ),
    # Absent.
    Case(
        "nothing arrives",
        "heard",
        heard([], 8.0),
        ("INCONCLUSIVE silent: nothing arrived at UDP port 14550 of coastal-gateway in 8 s",),
    ),
    Case(
        "gateway not reached",
        "heard",
        heard([], 0.0, trouble=Trouble.NO_PLACE, words="Connection timed out"),
        (
            (
                "INCONCLUSIVE place-not-reached: nobody has listened to Stork: coastal-gateway "
                "was not reached: Connection timed out"
            ),
        ),
    ),
    Case(
        "port not allowed",
        "heard",
        heard([], 0.0, trouble=Trouble.DENIED, words="UDP port 14550: Permission denied"),
        (
            (
                "INCONCLUSIVE not-allowed: UDP port 14550 of coastal-gateway may not be opened: "
                "UDP port 14550: Permission denied"
            ),
        ),
    ),
    Case(
        "other trouble",
        "heard",
        heard([], 0.0, trouble=Trouble.UNREACHABLE, words="UDP port 14550: Cannot assign requested address"),
        (
            (
                "INCONCLUSIVE not-heard: nobody could listen at UDP port 14550 of "
                "coastal-gateway: UDP port 14550: Cannot assign requested address"
            ),
        ),
    ),
    Case(
        "nothing arrives while the sticks moved",
        "sticks",
        heard([], 12.0),
        ("INCONCLUSIVE silent: nothing arrived at UDP port 14550 of coastal-gateway in 12 s",),
    ),
    # Garbage.
    Case(
        "another protocol",
        "heard",
        heard([[b"$GPGGA,1*00\r\n"]] * 6),
        (
            (
                "FAIL not-mavlink: what arrives at UDP port 14550 of coastal-gateway is not "
                "MAVLink: 78 bytes, no whole frame among them"
            ),
        ),
    ),
    Case(
        "every frame damaged",
        "heard",
        heard([[frame[:-1] + b"\x00" for frame in Says().second()]] * 6),
        (
            (
                "FAIL not-mavlink: what arrives at UDP port 14550 of coastal-gateway is not "
                "MAVLink: 834 bytes, no whole frame among them"
            ),
        ),
    ),
    Case(
        "some frames damaged",
        "heard",
        heard([*[Says().second()] * 5, [*Says().second(), b"\xfd\x09garbage", b"noise"]]),
        ("PASS rc-heard: Stork is disarmed and hears its remote control: 8 channels, rssi 200",),
    ),
    Case(
        "every fourth frame damaged",
        "heard",
        heard([[*Says().second()[:3], b"\x00noise", Says().channels()]] * 6),
        ("WARN damaged: 6 of 30 pieces of the stream at UDP port 14550 of coastal-gateway are damaged",),
    ),
    Case(
        "messages of another dialect",
        "heard",
        heard([[*Says().second(), b"\xfd\x02\x00\x00\x05\x01\x01\x10\xa4\x00\x01\x02\x03\x04"]] * 6),
        ("PASS rc-heard: Stork is disarmed and hears its remote control: 8 channels, rssi 200",),
    ),
    Case(
        "frames cut over datagrams",
        "heard",
        heard([Says().second()] * 6, cut=7),
        ("PASS rc-heard: Stork is disarmed and hears its remote control: 8 channels, rssi 200",),
    ),
    # Slow.
    Case(
        "a round every three seconds",
        "heard",
        heard([Says().second() if second % 3 == 0 else [] for second in range(8)], 8.0),
        ("PASS rc-heard: Stork is disarmed and hears its remote control: 8 channels, rssi 200",),
    ),
    # In use.
    Case(
        "a ground station has the port",
        "heard",
        heard([], 0.0, trouble=Trouble.BUSY, words="UDP port 14550: Address already in use"),
        (
            (
                "INCONCLUSIVE in-use: UDP port 14550 of coastal-gateway is in use by another "
                "program, which gets the stream: UDP port 14550: Address already in use"
            ),
        ),
    ),
)
