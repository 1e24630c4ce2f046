"""Does this device get into the VPN, and if not, why? It needs Python 3.8 or later, and nothing besides.

    python3 self-test.py            what can be known without root; uses the tunnel if it is up
    sudo python3 self-test.py       also starts the tunnel for the time of the test, if it is not up

It reads self-test.json and the profile, which lie beside it, and sends packets to the control centre and through
the VPN alone. It ends in PASS, or says what is wrong and what to do. Exit code 0: PASS; 6: something failed, or could
not be tested.
"""

# ruff: noqa: INP001, S603 - partners read this program before they run it; it starts their openvpn and ping

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterator

    Facts = dict[str, Any]

OK, FAIL, UNKNOWN = "ok", "FAIL", "?"
PASSED, FAILED = 0, 6
DAY_S = 24 * 3600
PING_S = 4.0
READY = "Initialization Sequence Completed"
REACHED = "TLS: Initial packet from"
BLOCKS = ("ca", "cert", "key")
SBIN = "/usr/sbin:/usr/local/sbin:/opt/homebrew/sbin"
ROOT = os.name != "posix" or os.geteuid() == 0


class Result(NamedTuple):
    """What one step found; `do` is said where it is not ok."""

    step: str
    verdict: str
    found: str
    do: str = ""


class Tunnel:
    """A run of openvpn by the profile; with `dry`, one that makes no interface and needs no root."""

    def __init__(self, facts: Facts, profile: Path, log: Path, *, dry: bool) -> None:
        wait_s = facts["wait_s"]
        words = ["--connect-retry-max", "1", "--hand-window", str(max(1, int(wait_s))), "--tls-exit", "--verb", "3"]
        words += ["--dev", "null", "--dev-type", "null", "--ifconfig-noexec", "--route-noexec"] if dry else []
        self.facts, self.log, self.wait_s, self.began = facts, log, wait_s, time.monotonic()
        with log.open("wb") as out:
            command = [openvpn() or "openvpn", "--cd", str(profile.parent), "--config", profile.name, *words]
            self.process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=out, stderr=subprocess.STDOUT)

    def said(self) -> str:
        """All that openvpn has said."""
        return self.log.read_bytes().decode("utf-8", "replace")

    def settled(self) -> str:
        """Wait until it is up, has ended, has found a fault, or is too late; give what it said."""
        while time.monotonic() < self.began + self.wait_s + 2:
            ended = self.process.poll() is not None
            said = self.said()
            if ended or READY in said or fault(self.facts, said):
                break
            time.sleep(0.1)
        return self.said()

    def end(self) -> None:
        """Take the tunnel down."""
        self.process.terminate()
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()


def fault(facts: Facts, said: str) -> tuple[str, str, str] | None:
    """The first fault that openvpn's words tell: what is wrong, what to do, and the line that tells it."""
    for pattern, what, do in facts["faults"]:
        for line in said.splitlines():
            if re.search(pattern, line):
                return what, do, line
    return None


def diagnosis(facts: Facts, said: str) -> Result:
    """Why openvpn did not connect."""
    silent = facts["refused" if REACHED in said else "silence"]
    what, do, line = fault(facts, said) or (*silent, "")
    words = {"endpoint": endpoint(facts), "proto": facts["proto"].upper(), "now": utc(time.time()), "line": clean(line)}
    return Result("tunnel", FAIL, what.format(**words), do.format(**words))


def endpoint(facts: Facts) -> str:
    """Where the server is reached."""
    return "{endpoint} port {port}".format(**facts)


def clean(line: str) -> str:
    """A line of openvpn without its time, printable."""
    text = re.sub(r"^(\d{4}-\d\d-\d\d \d\d:\d\d:\d\d|[A-Z][a-z]{2} [A-Z][a-z]{2} .{16}) ", "", line)
    return "".join(letter for letter in text if letter.isprintable())[:200]


def utc(seconds: float) -> str:
    """A time for people."""
    return time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime(seconds))


def clock(facts: Facts) -> Result:
    """Whether the certificate is good by this computer's clock."""
    now, first, last = time.time(), facts["not_before"], facts["not_after"]
    if now < first:
        found = f"this computer's clock says {utc(now)}, which is before the certificate begins ({utc(first)})"
        return Result("clock", FAIL, found, "Set the clock; a computer without a battery for it does so at each start.")
    if now > last:
        found = f"by this computer's clock ({utc(now)}) the certificate has expired on {utc(last)}"
        return Result("clock", FAIL, found, "If the clock is right, ask the control centre to renew this device.")
    left = int((last - now) / DAY_S)
    return Result("clock", OK, f"{utc(now)}; the certificate is good for {left} more days")


def profile_whole(facts: Facts, profile: Path) -> Result:
    """Whether the profile is all there, as it was handed out, and its owner's alone."""
    again = "Unpack the enrolment package again, and change nothing in the profile."
    try:
        text = profile.read_bytes()
    except OSError as error:
        return Result("profile", FAIL, f"{profile.name} cannot be read: {error.strerror}", again)
    for block in (*BLOCKS, facts["wrap"]):
        if f"<{block}>".encode() not in text or f"</{block}>".encode() not in text:
            return Result("profile", FAIL, f"{profile.name} is not whole: its part <{block}> is missing", again)
    if os.name == "posix" and profile.stat().st_mode & 0o077:
        found = f"{profile.name} holds a private key, and others on this computer may read it"
        return Result("profile", FAIL, found, f"Type: chmod 600 {profile}")
    same = hashlib.sha256(text.replace(b"\r\n", b"\n")).hexdigest() == facts["profile_sha256"]
    return Result("profile", OK, "whole" if same else "whole, but not as it was handed out: somebody has changed it")


def openvpn() -> str | None:
    """Where the program is: on many systems not where an ordinary user's programs are looked for."""
    return shutil.which("openvpn") or shutil.which("openvpn", path=SBIN)


def version(facts: Facts) -> Result:
    """Whether there is an OpenVPN that can use this profile."""
    program = openvpn()
    if program is None:
        do = "Install openvpn, or start the tunnel with the program that you use, then run the test again."
        return Result("openvpn", UNKNOWN, "the program `openvpn` is not on this computer", do)
    run = subprocess.run([program, "--version"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
    found = re.match(r"OpenVPN (\d+)\.(\d+)(\S*)", run.stdout.decode("utf-8", "replace"))
    if found is None:
        return Result("openvpn", UNKNOWN, "`openvpn --version` does not say what it is", "Look what program that is.")
    number, least = (int(found[1]), int(found[2])), (2, 5) if facts["wrap"] == "tls-crypt-v2" else (2, 4)
    if number < least:
        do = "Install a newer one. If that is impossible, ask for an enrolment package for OpenVPN 2.4."
        return Result("openvpn", FAIL, f"{found[0]} is too old for this profile: it needs {least[0]}.{least[1]}", do)
    note = " (out of maintenance: take 2.6 where you can)" if number < (2, 6) else ""
    return Result("openvpn", OK, found[0] + note)


def is_local(address: str) -> bool:
    """Whether an interface of this computer has the address: only then a socket can."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        try:
            one.bind((address, 0))
        except OSError:
            return False
    return True


def refused(facts: Facts) -> bool:
    """Whether it is told at once that nobody listens there: by whom, a socket does not say. Silence says nothing."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.settimeout(3)
        try:
            one.connect((facts["endpoint"], facts["port"]))
            one.send(b"\0")
            one.recv(1)
        except ConnectionRefusedError:
            return True
        except OSError:
            pass
    return False


def ping(address: str, size: int = 56) -> str | None:
    """How a ping is answered, None if not at all; by a socket of ICMP, or by the program where that is not allowed."""
    for kind in (socket.SOCK_DGRAM, socket.SOCK_RAW):
        try:
            with socket.socket(socket.AF_INET, kind, socket.IPPROTO_ICMP) as one:
                return echo(one, address, size)
        except OSError:  # noqa: PERF203 - each kind may be forbidden
            continue
    command = ["ping", "-c", "2", "-s", str(size), address]
    try:
        run = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=15, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return "responds" if run.returncode == 0 else None


def echo(one: socket.socket, address: str, size: int) -> str | None:
    """Ask twice at most (RFC 792); what comes back is known by its contents."""
    token = os.urandom(16)
    packet = b"\x08\0\0\0\0\0\0\x01" + token + bytes(size - len(token))
    words = sum(int.from_bytes(packet[at : at + 2], "big") for at in range(0, len(packet), 2))
    words = (words & 0xFFFF) + (words >> 16)
    packet = packet[:2] + ((~(words + (words >> 16))) & 0xFFFF).to_bytes(2, "big") + packet[4:]
    for _ in range(2):
        began = time.monotonic()
        try:
            one.sendto(packet, (address, 0))
            while time.monotonic() < began + PING_S:
                one.settimeout(max(0.01, began + PING_S - time.monotonic()))
                answer = one.recv(65535)
                if token in answer and b"\x08\0" + packet[2:8] + token not in answer:
                    return f"responds in {(time.monotonic() - began) * 1000:.0f} ms"
        except OSError:
            pass
    return None


def dds(address: str, port: int) -> Result:
    """What a packet to a port of DDS shows: most of the time nothing, since DDS does not answer strangers."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.settimeout(2)
        try:
            one.connect((address, port))
            one.send(b"\0")
            one.recv(1)
        except ConnectionRefusedError:
            found = (
                f"UDP {port} of {address} is refused at once: no DDS program listens there, or a firewall refuses it"
            )
            return Result("dds", UNKNOWN, found)
        except OSError:
            pass
    return Result("dds", UNKNOWN, f"UDP {port} of {address} is silent, as a DDS program is to a stranger")


def through(facts: Facts) -> Iterator[Result]:
    """What passes the tunnel that is up."""
    server = facts["server"]
    answer = ping(server)
    if answer is None:
        do = (
            "Wait a minute and run the test again: a second device with the same profile throws this one out. Then ask."
        )
        yield Result(
            "server", FAIL, f"this device has its address in the VPN, and the server ({server}) does not respond", do
        )
        return
    yield Result("server", OK, f"{server} {answer}")
    if ping(server, 1200) is None:
        do = "Ask the network's administrator to let large and fragmented UDP packets pass, or use another network."
        found = "small packets are answered, and packets of 1200 bytes, as DDS sends them, are not"
        yield Result("size", FAIL, found, do)
    for name, address in facts["ping"]:
        answer = ping(address)
        do = "It may be off: ask the control centre."
        yield Result("reach", OK if answer else UNKNOWN, f"{name} ({address}) {answer or 'does not respond'}", do)
        if facts["dds_port"] is not None:
            yield dds(address, facts["dds_port"])


def connected(facts: Facts, profile: Path) -> Iterator[Result]:
    """The tunnel, and what passes through it."""
    if is_local(facts["address"]):
        yield Result("tunnel", OK, f"an interface of this computer has this device's address {facts['address']}")
        yield from through(facts)
        return
    if openvpn() is None:
        yield without_openvpn(facts)
        return
    with tempfile.TemporaryDirectory(prefix="self-test-") as folder:
        tunnel = Tunnel(facts, profile, Path(folder, "log"), dry=not ROOT)
        try:
            yield from started(facts, tunnel)
        finally:
            tunnel.end()


def started(facts: Facts, tunnel: Tunnel) -> Iterator[Result]:
    """How the start went, and what passes then."""
    said = tunnel.settled()
    if READY not in said:
        yield diagnosis(facts, said)
        return
    given = re.search(r"PUSH_REPLY,.*\bifconfig ([\d.]+)", said)
    if given is None or given[1] != facts["address"]:
        other = f"gives the address {given[1]}" if given else "gives no address"
        found = f"the control centre {other}; this device's is {facts['address']}"
        yield Result("tunnel", FAIL, found, "Ask the control centre, and do not use the tunnel.")
    elif not ROOT:
        yield Result("tunnel", OK, f"the control centre admits this device, with the address {given[1]}")
        do = "Run the test as root, or start the tunnel as your page of instructions says and run it again."
        yield Result("server", UNKNOWN, "without root the test makes no tunnel, so nothing was sent through it", do)
    else:
        yield Result("tunnel", OK, f"came up in {time.monotonic() - tunnel.began:.0f} s, with the address {given[1]}")
        yield from through(facts)


def without_openvpn(facts: Facts) -> Result:
    """What is known of the way to the server without a client."""
    if facts["proto"] == "udp" and refused(facts):
        return diagnosis(facts, "ECONNREFUSED")
    do = "Start the tunnel with the program that you use, then run the test again."
    return Result("tunnel", UNKNOWN, f"is not up; {endpoint(facts)} is silent, as it is to a stranger", do)


def steps(facts: Facts, profile: Path) -> Iterator[Result]:
    """All results in order; what fails before the tunnel makes it no use to go on."""
    for result in (clock(facts), profile_whole(facts, profile), version(facts)):
        yield result
        if result.verdict == FAIL:
            return
    yield from connected(facts, profile)


def verdict(facts: Facts, results: list[Result]) -> tuple[str, int]:
    """The last words, and the exit code. What may be off, or is silent by nature, does not spoil a PASS."""
    decisive = [one for one in results if one.verdict == FAIL]
    decisive += [one for one in results if one.verdict == UNKNOWN and one.step in {"openvpn", "tunnel", "server"}]
    proved = any(one.step == "server" and one.verdict == OK for one in results)
    if proved and not any(one.verdict == FAIL for one in results):
        return "PASS: {name} is in the VPN.".format(**facts), PASSED
    worst = decisive[0]
    head = (
        "NOT PASSED\nWhat is wrong"
        if worst.verdict == FAIL
        else "NOT PASSED: nothing is wrong so far\nWhat is not known"
    )
    end = "Control centre: {contact}".format(**facts)
    return f"{head}: {worst.step}: {worst.found}.\nWhat to do: {worst.do}\n{end}", FAILED


def main(words: list[str] | None = None) -> int:
    """Run the test and say what it finds."""
    here = Path(__file__).resolve().parent
    parser = argparse.ArgumentParser(description="Tests the VPN of this device; see the page of instructions.")
    parser.add_argument("--facts", type=Path, default=here / "self-test.json", help="the file that came with the test")
    parser.add_argument("--wait", type=float, help="seconds that the tunnel may take to come up")
    asked = parser.parse_args(words)
    try:
        facts = json.loads(asked.facts.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        sys.stdout.write(
            f"NOT PASSED\n{asked.facts} cannot be read: unpack the enrolment package again, and run its test there\n"
        )
        return FAILED
    facts["wait_s"] = asked.wait or facts["wait_s"]
    sys.stdout.write("Self-test of {name}, VPN of {pilot}\n".format(**facts))
    results = []
    for result in steps(facts, asked.facts.parent / facts["profile"]):
        results.append(result)
        sys.stdout.write(f"  {result.verdict:4}  {result.step:8}{result.found}\n")
        sys.stdout.flush()
    said, code = verdict(facts, results)
    sys.stdout.write(said + "\n")
    return code


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(FAILED)
