"""The real gpsd is judged by our probe; our twin of it is read by gpsd's own client, and answers word for word."""

import json
import re
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

from gnss_stand import Asked, codes, environment, gpsd, judged, program, started, until_it_listens
from ports import held_port

from atlantis_netcfg.emulator.gnss import GnssSpec, RunningGpsd, RunningNmea
from atlantis_netcfg.inventory.model import GpsDriver

VIANA = (
    "$GPGGA,101500.00,,,,,0,00,99.99,,,,,,*63",
    "$GPRMC,101500.00,V,,,,,,,201126,,,N*7E",
    "$GPGSA,A,1,,,,,,,,,,,,,99.99,99.99,99.99*30",
    "$GPGGA,101520.00,4141.18520,N,00850.32959,W,1,09,0.9,5.0,M,54.0,M,,*7A",
)
"""Without a fix, then one without a time; epochs of every second follow."""


def sentence(body: str) -> str:
    checksum = 0
    for character in body:
        checksum ^= ord(character)
    return f"${body}*{checksum:02X}"


def log(path: Path, seconds: int = 40) -> Path:
    """A made-up receiver in the port of Viana do Castelo finds its fix."""
    lines = list(VIANA)
    for second in range(21, 21 + seconds):
        at = f"10{15 + second // 60}{second % 60:02}.00"
        lines += [
            sentence(f"GPGGA,{at},4141.18520,N,00850.32959,W,4,09,0.9,5.0,M,54.0,M,,"),
            sentence(f"GPRMC,{at},A,4141.18520,N,00850.32959,W,0.05,10.0,201126,,,R"),
            sentence("GPGSA,A,3,01,02,03,04,05,06,07,08,09,,,,1.6,0.9,1.3"),
        ]
    path.write_text("\r\n".join([*lines, ""]), encoding="ascii", newline="")
    return path


def test_a_replayed_log_is_judged_through_gpsd(tmp_path: Path) -> None:
    """A log is of its own day: that is found, and nothing else."""
    words = ("python3", program("gpsfake"), "-t", "-q", "-c", "0.05", str(log(tmp_path / "viana.nmea")), "-P")
    with held_port() as port, started(*words, str(port)) as replaying:
        until_it_listens(port, replaying)
        found = judged({"replayed": Asked(GpsDriver.GPSD, port)})["replayed"]
        assert replaying.poll() is None
    assert codes(found) == ["FAIL clock-differs"]
    seen = {one.what: one.value for one in found.evidence}
    assert seen["position"] == "41.68642, -8.83883"
    assert seen["fix"].startswith("3D")
    assert re.match(r"gpsd 3\.\d+ at 127\.0\.0\.1", seen["source"].replace("gpsd at", "at", 1))


MOODS = {
    "healthy": GnssSpec(),
    "no fix": GnssSpec(mode=1),
    "two dimensions": GnssSpec(mode=2),
    "swapped": GnssSpec(has_swapped_axes=True),
    "jumping": GnssSpec(jumping_m=200.0),
    "simulated": GnssSpec(status=8),
    "dead reckoning": GnssSpec(status=5),
    "RTK fixed": GnssSpec(status=3),
    "clock": GnssSpec(time_offset_s=-3600.0),
    "no time": GnssSpec(has_time=False),
}
EXPECTED = {
    "healthy": ["PASS fix"],
    "no fix": ["FAIL no-fix"],
    "two dimensions": ["PASS fix"],
    "swapped": ["FAIL position-swapped"],
    "jumping": ["FAIL position-jumps"],
    "simulated": ["FAIL position-simulated"],
    "dead reckoning": ["WARN position-dead-reckoning"],
    "RTK fixed": ["PASS fix"],
    "clock": ["INCONCLUSIVE clock-differs"],
    "no time": ["INCONCLUSIVE no-time"],
}


def test_receivers_get_the_same_verdict_from_gpsd_and_emulator() -> None:
    """Each mood behind the real gpsd, and the same behind the twin, all listened to at once."""
    with ExitStack() as stack:
        real, twin = {}, {}
        for mood, spec in MOODS.items():
            receiver = stack.enter_context(RunningNmea(spec))
            port = stack.enter_context(gpsd(f"tcp://127.0.0.1:{receiver.port}"))
            real[mood] = Asked(GpsDriver.GPSD, port)
            twin[f"{mood}, twin"] = Asked(GpsDriver.GPSD, stack.enter_context(RunningGpsd(spec)).port)
        found = judged({**real, **twin})
    assert {mood: codes(found[mood]) for mood in MOODS} == EXPECTED
    assert {mood: codes(found[f"{mood}, twin"]) for mood in MOODS} == EXPECTED


def test_missing_receiver_is_reported() -> None:
    gone = "tcp://127.0.0.1:1"
    with gpsd(gone, at_once=False) as port, RunningGpsd(GnssSpec(device=False)) as twin:
        found = judged(
            {"real": Asked(GpsDriver.GPSD, port, listen_s=0.3), "twin": Asked(GpsDriver.GPSD, twin.port, listen_s=0.3)}
        )
    assert codes(found["real"]) == codes(found["twin"]) == ["FAIL device-missing"]


def test_gpspipe_reads_json_from_the_emulator() -> None:
    with RunningGpsd(GnssSpec(every_s=0.02, status=2)) as twin:
        words = [program("gpspipe"), "-w", "-n", "9", f"{twin.host}:{twin.port}"]
        ran = subprocess.run(words, env=environment(), capture_output=True, text=True, check=True)
        assert twin.forbidden == []
    objects = [json.loads(line) for line in ran.stdout.splitlines()]
    assert [one["class"] for one in objects] == ["VERSION", "DEVICES", "WATCH", *["TPV", "SKY"] * 3]
    assert [(one["mode"], one["status"]) for one in objects if one["class"] == "TPV"] == [(3, 2)] * 3


def test_gpspipe_reads_sentences_from_the_emulator() -> None:
    with RunningGpsd(GnssSpec(every_s=0.02)) as twin:
        words = [program("gpspipe"), "-r", "-n", "9", f"{twin.host}:{twin.port}"]
        ran = subprocess.run(words, env=environment(), capture_output=True, text=True, check=True)
    kinds = [line[1:6] for line in ran.stdout.splitlines() if line.startswith("$")]
    assert kinds == ["GPGGA", "GPRMC", "GPGSA"] * 2


SAYINGS = (
    [b"?WATCH;\n"],
    [b'?WATCH={"bla":1};\n'],
    [b'?WATCH={"enable":tru};\n'],
    [b'?WATCH={"enable":false};\n'],
    [b'?WATCH={"enable":true,"json":true};?VERSION;\n'],
    [b'?WATCH={"enable":true,"json":true};\n', b"?WATCH;\n"],
    [b"?VERSION;?DEVICES;"],
    [b"?FOO;\n", b"?FOO;", b"?foo;\n", b"FOO;\n", b"\n", b"?;\n"],
    [b"?VERSION\n"],
    [b"?VERSION;;;\n"],
    [b'?WATCH={"enable":true\n'],
    [b"?DEVICE;\n"],
    [b"?WAT", b'CH={"enable":true};\n'],
    [b"garbage?VERSION;\n"],
    [b"  ?DEVICES;\n"],
)
_OWN = re.compile(rb'"(path|activated|release|rev)":"[^"]*"')


def dialogue(port: int, sayings: list[bytes]) -> list[bytes]:
    """What is answered, without reports, and without what is of one run only."""
    answered = []
    with socket.create_connection(("127.0.0.1", port)) as wire, wire.makefile("rb") as lines:
        lines.readline()
        for saying in sayings:
            wire.sendall(saying)
            # Two pieces of data that come together are one text to gpsd.
            time.sleep(0.03)
            wire.sendall(b"?POLL;\n")
            answered += list(_until_polled(lines))
    return [_OWN.sub(rb'"\1":""', line) for line in answered]


def until_it_reports(port: int) -> None:
    """Wait until gpsd knows what kind of receiver it has."""
    with socket.create_connection(("127.0.0.1", port)) as wire, wire.makefile("rb") as lines:
        wire.sendall(b'?WATCH={"enable":true,"json":true};\n')
        while not lines.readline().startswith(b'{"class":"TPV"'):
            pass


def _until_polled(lines: Iterator[bytes]) -> Iterator[bytes]:
    for line in lines:
        if b'"class":"POLL"' in line:
            return
        if not line.startswith((b'{"class":"TPV"', b'{"class":"SKY"')):
            yield line


def test_emulator_responses_equal_those_of_gpsd() -> None:
    with (
        RunningNmea(GnssSpec()) as receiver,
        gpsd(f"tcp://127.0.0.1:{receiver.port}") as port,
        RunningGpsd(GnssSpec()) as twin,
    ):
        until_it_reports(port)
        for sayings in SAYINGS:
            assert dialogue(twin.port, sayings) == dialogue(port, sayings), sayings
        assert receiver.forbidden == []
