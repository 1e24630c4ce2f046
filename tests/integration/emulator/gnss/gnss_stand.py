"""Real gpsd, its tools, and questions that are asked as on site: by the program that listens, in its own process."""

import asyncio
import os
import socket
import subprocess
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from ports import held_port

from atlantis_netcfg.checklist.probes import Answer, Listen, Place, ProbeResult
from atlantis_netcfg.checklist.probes.gps import GpsExpectation, StreamGps
from atlantis_netcfg.checklist.runner import ask_here
from atlantis_netcfg.inventory.model import Geofence, GpsDriver

_DEBIAN = Path(__file__).parents[4] / ".venv-setup" / "debian"
"""`make test` has unpacked the packages there."""
_LIBRARIES = ("libgps28", "libbluetooth3", "libusb-1.0-0", "python3-gps")
FENCE = Geofence(latitude=41.6864, longitude=-8.8388, radius_m=1000.0)


def program(name: str) -> str:
    """Where a program of gpsd is."""
    package, folder = ("gpsd", "sbin") if name == "gpsd" else ("gpsd-clients", "bin")
    return str(_DEBIAN / package / "usr" / folder / name)


def environment() -> dict[str, str]:
    """In which the unpacked programs find their libraries, and each other."""
    machine = next((_DEBIAN / "libgps28/usr/lib").glob("*/libgps.so.*")).parent.name
    return {
        **os.environ,
        "LD_LIBRARY_PATH": ":".join(str(_DEBIAN / name / "usr/lib" / machine) for name in _LIBRARIES),
        "PYTHONPATH": str(_DEBIAN / "python3-gps/usr/lib/python3/dist-packages"),
        "PATH": f"{_DEBIAN / 'gpsd/usr/sbin'}:{os.environ['PATH']}",
        "PYTHONWARNINGS": "ignore",
    }


def until_it_listens(port: int, running: subprocess.Popen[bytes]) -> None:
    """Wait for a server that was just started."""
    while running.poll() is None:
        with socket.socket() as asking:
            if not asking.connect_ex(("127.0.0.1", port)):
                return
        time.sleep(0.01)
    raise AssertionError(f"{running.args!r} has ended with {running.returncode}")


@contextmanager
def started(*words: str) -> Iterator[subprocess.Popen[bytes]]:
    """A program while the context lasts."""
    quiet = subprocess.DEVNULL
    with subprocess.Popen(words, env=environment(), stdin=quiet, stdout=quiet, stderr=quiet) as running:
        try:
            yield running
        finally:
            running.terminate()


@contextmanager
def gpsd(source: str, *, at_once: bool = True) -> Iterator[int]:
    """A gpsd that reads a source and writes nothing to it; gives its port. `at_once`: not only for a client."""
    # -b: gpsd asks receivers what they are, and ours count whatever they are sent.
    words = (program("gpsd"), "-N", "-b", *(("-n",) if at_once else ()), source, "-S")
    with held_port() as port, started(*words, str(port)) as running:
        until_it_listens(port, running)
        yield port


@dataclass(frozen=True)
class Asked:
    """One source to be listened to."""

    driver: GpsDriver
    port: int = 0
    path: str = ""
    listen_s: float | None = None
    max_age_s: float = 3.0

    @property
    def probe(self) -> StreamGps:
        end = self.path or f"127.0.0.1:{self.port}"
        source = f"{self.driver} at {end}"
        wanted = GpsExpectation("Sparus", self.driver, source, end, "this computer", FENCE, max_age_s=self.max_age_s)
        if self.path:
            return StreamGps(wanted, Place.LAPTOP, device=self.path, baud=9600)
        return StreamGps(wanted, Place.LAPTOP, address="127.0.0.1", port=self.port)

    @property
    def question(self) -> Listen:
        (question,) = self.probe.asks()
        assert isinstance(question, Listen)
        if self.listen_s is None:
            return question
        say = tuple(replace(one, within_s=self.listen_s) for one in question.say)
        return replace(question, listen_s=self.listen_s, say=say)


def judged(sources: Mapping[str, Asked]) -> dict[str, ProbeResult]:
    """Listen to all sources at the same time, and judge each."""
    questions = [(name, source.question) for name, source in sources.items()]
    answers = asyncio.run(ask_here(questions, lambda _key, _answer: None))
    return {name: _judge(source, answers[name]) for name, source in sources.items()}


def _judge(source: Asked, answer: Answer) -> ProbeResult:
    return source.probe.judge({source.question.name: answer})


def codes(found: ProbeResult) -> Sequence[str]:
    return [f"{one.verdict} {one.code}" for one in found.findings]
