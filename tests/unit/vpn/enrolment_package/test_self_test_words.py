"""What the self-test says of each fault, word for word: a program in openvpn's place says openvpn's words."""

import importlib.util
import json
import socket
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from handout_mint import NOT_AFTER, NOT_BEFORE, Wanted, identity

from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.routeros.render import template_folder
from atlantis_netcfg.vpn.enrolment_package import contents
from atlantis_netcfg.vpn.identity import KeyType, Wrap

SAID = Path(__file__).with_name("said")
NOW = 1795330800.0
"""2026-11-22 07:00 UTC"""
STAMP = "2026-11-22 07:00:00 "
SENT = f"TLS: Initial packet from [AF_INET]203.0.113.2:1194, sid=00000000 00000000\n{STAMP}"

UNKNOWN = "Options error: Unrecognized option or missing or extra parameter(s) in"
VERIFY = "VERIFY ERROR: depth=0, error="
LATE = "TLS Error: TLS key negotiation failed to occur within 20 seconds (check your network connectivity)"
PUSHED = "PUSH: Received control message: 'PUSH_REPLY,topology subnet"
READY = f"{STAMP}Initialization Sequence Completed"

WORDS = {
    "openvpn-knows-a-word-not": f"{UNKNOWN} [CMD-LINE]:1: tls-crypt-v2 (2.4.12)",
    "no-tunnel-device": "ERROR: Cannot open TUN/TAP dev /dev/net/tun: No such file or directory (errno=2)",
    "clock-behind-the-server": f"{SENT}{VERIFY}certificate is not yet valid: CN=scc-vpn, serial=1",
    "server-expired": f"{SENT}{VERIFY}certificate has expired: CN=scc-vpn, serial=1",
    "another-server": f"{SENT}VERIFY X509NAME ERROR: CN=other, must be scc-vpn",
    "another-ca": f"{SENT}{VERIFY}unable to get local issuer certificate: CN=scc-vpn, serial=1",
    "not-admitted": f"{SENT}AUTH: Received control message: AUTH_FAILED",
    "sent-away": f"{SENT}SIGTERM[soft,server-pushed-halt] received, process exiting",
    "server-down": "read UDPv4 [ECONNREFUSED]: Connection refused (fd=3,code=111)",
    "no-way": "write UDPv4: Network is unreachable (fd=3,code=101)",
    "own-firewall": "write UDPv4: Operation not permitted (fd=3,code=1)",
    "damaged-key": "OpenSSL: error:0909006C:PEM routines:get_name:no start line",
    "refused": f"{SENT}{LATE}",
    "silence": LATE,
    "another-address": f"{SENT}{PUSHED},ifconfig 10.80.16.9 255.255.0.0'\n{READY}",
    "no-address": f"{SENT}{PUSHED}'\n{READY}",
    "admitted-and-no-root": f"{SENT}{PUSHED},ifconfig 10.80.16.1 255.255.0.0'\n{READY}",
}
"""Lines of openvpn 2.4 and 2.6, as it says them."""


@pytest.fixture
def program(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The self-test, run by somebody who is not root, at a fixed time."""
    spec = importlib.util.spec_from_file_location("self_test", template_folder() / "handout" / "self_test.py")
    assert spec is not None
    assert spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    monkeypatch.setattr(made, "ROOT", False)
    monkeypatch.setattr(made, "SBIN", "")
    monkeypatch.setattr(made.time, "time", lambda: NOW)
    monkeypatch.setattr(made, "is_local", lambda _address: False)
    return made


@cache
def declared() -> Inventory:
    return load(Path(__file__).parents[4] / "inventory")


def unpacked(folder: Path, wanted: Wanted | None = None) -> Path:
    for name, text in contents(declared(), identity(wanted), contact="Example Person, +00 000").items():
        (folder / name).write_text(text)
        (folder / name).chmod(0o600)
    return folder / "self-test.json"


def in_openvpns_place(folder: Path, monkeypatch: pytest.MonkeyPatch, words: str, version: str = "2.6.14") -> None:
    """A program that says these words and ends."""
    place = folder / "bin"
    place.mkdir()
    lines = [f"OpenVPN {version} x86_64-pc-linux-gnu", f"{STAMP}{words}"]
    script = f"#!{sys.executable}\nimport sys\nprint({lines}[sys.argv[1:] != ['--version']])\n"
    (place / "openvpn").write_text(script)
    (place / "openvpn").chmod(0o700)
    monkeypatch.setenv("PATH", str(place))


def same(capsys: pytest.CaptureFixture[str], case: str) -> bool:
    return capsys.readouterr().out == (SAID / f"{case}.txt").read_text()


@pytest.mark.parametrize("case", WORDS)
def test_openvpn_messages_are_diagnosed(
    case: str, program: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    facts = unpacked(tmp_path)
    in_openvpns_place(tmp_path, monkeypatch, WORDS[case])
    assert program.main(["--facts", str(facts)]) == 6
    assert same(capsys, case)


@pytest.mark.parametrize("case", [case for case, words in WORDS.items() if "TLS: Initial packet" not in words])
def test_silent_server_leads_to_no_statement_about_the_far_end(
    case: str, program: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without a first packet of the server, of what is at the other end nothing is known: not even that it is there."""
    facts = unpacked(tmp_path)
    in_openvpns_place(tmp_path, monkeypatch, WORDS[case])
    program.main(["--facts", str(facts)])
    found = capsys.readouterr().out.partition("What to do:")[0]
    assert "  FAIL  tunnel  " in found
    assert "control centre" not in found
    assert "VPN server" not in found


def rewritten(facts: Path, **other: Any) -> None:  # noqa: ANN401 - JSON
    facts.write_text(json.dumps(json.loads(facts.read_text()) | other))


def at(when: float) -> Any:  # noqa: ANN401 - a change of the program
    return lambda _facts, program, patch: patch.setattr(program.time, "time", lambda: when)


BEFORE_THE_TUNNEL: dict[str, Any] = {
    "clock-of-2000": at(946728000.0),
    "clock-a-day-behind": at(NOT_BEFORE.timestamp() - 60),
    "expired": at(NOT_AFTER.timestamp() + 60),
    "profile-missing": lambda facts, _program, _patch: facts.with_name("inesc-laptop1.ovpn").unlink(),
    "profile-cut": lambda facts, _program, _patch: cut(facts.with_name("inesc-laptop1.ovpn")),
    "profile-for-everybody": lambda facts, _program, _patch: facts.with_name("inesc-laptop1.ovpn").chmod(0o644),
}


def cut(profile: Path) -> None:
    profile.write_text(profile.read_text()[:-100])


@pytest.mark.parametrize("case", BEFORE_THE_TUNNEL)
def test_diagnosis_before_the_tunnel_is_up(
    case: str, program: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    unpacked(tmp_path)
    in_openvpns_place(tmp_path, monkeypatch, WORDS["silence"])
    BEFORE_THE_TUNNEL[case](tmp_path / "self-test.json", program, monkeypatch)
    assert program.main(["--facts", "self-test.json"]) == 6
    assert same(capsys, case)


@pytest.mark.parametrize(
    ("version", "wrap", "case"),
    [
        ("2.4.12", Wrap.TLS_CRYPT_V2, "openvpn-2.4-and-tls-crypt-v2"),
        ("2.3.18", Wrap.TLS_CRYPT, "openvpn-2.3"),
        ("2.4.12", Wrap.TLS_CRYPT, "openvpn-2.4-and-tls-crypt"),
        ("core 3.8", Wrap.TLS_CRYPT_V2, "openvpn-of-another-kind"),
    ],
)
def test_diagnosis_of_openvpn_versions(  # noqa: PLR0913, PLR0917 - fixtures
    version: str,
    wrap: Wrap,
    case: str,
    program: ModuleType,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    facts = unpacked(tmp_path, Wanted(wrap=wrap, key=KeyType.RSA))
    in_openvpns_place(tmp_path, monkeypatch, WORDS["silence"], version)
    assert program.main(["--facts", str(facts)]) == 6
    assert same(capsys, case)


class TestWithoutOpenvpn:
    def test_missing_openvpn_fails_the_self_test(
        self, program: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        monkeypatch.setenv("PATH", str(tmp_path))
        monkeypatch.setattr(program, "refused", lambda _facts: False)
        assert program.main(["--facts", str(unpacked(tmp_path))]) == 6
        assert same(capsys, "no-openvpn")

    def test_closed_port_is_reported(
        self, program: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        """A real socket, to a port of this computer at which nobody listens."""
        monkeypatch.setenv("PATH", str(tmp_path))
        facts = unpacked(tmp_path)
        rewritten(facts, endpoint="127.0.0.1", port=9)
        assert program.main(["--facts", str(facts)]) == 6
        told = capsys.readouterr().out
        assert "127.0.0.1 port 9 refuses the connection: no server listens there" in told


THROUGH: dict[str, tuple[set[tuple[str, int]], bool]] = {
    "pass": ({("10.80.0.1", 56), ("10.80.0.1", 1200), ("10.80.0.2", 56)}, True),
    "pass-and-the-centre-silent": ({("10.80.0.1", 56), ("10.80.0.1", 1200)}, False),
    "server-silent": (set(), False),
    "large-packets-lost": ({("10.80.0.1", 56), ("10.80.0.2", 56)}, False),
}
"""Which pings are answered, of how many bytes; whether DDS says that nobody listens."""


@pytest.mark.parametrize("case", THROUGH)
def test_diagnosis_through_an_existing_tunnel(
    case: str, program: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    answered, closed = THROUGH[case]
    monkeypatch.setattr(program, "is_local", lambda address: address == "10.80.16.1")
    monkeypatch.setattr(program, "ping", lambda *asked: "responds in 71 ms" if (*asked, 56)[:2] in answered else None)
    dds = program.Result("dds", "ok" if closed else "?", "as the sockets have it", "")
    monkeypatch.setattr(program, "dds", lambda _address, _port: dds)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert program.main(["--facts", str(unpacked(tmp_path))]) == (0 if case.startswith("pass") else 6)
    assert same(capsys, case)


def test_edited_profile_may_still_pass(
    program: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    facts = unpacked(tmp_path)
    profile = tmp_path / "inesc-laptop1.ovpn"
    profile.write_bytes(profile.read_bytes().replace(b"\n", b"\r\n"))
    in_openvpns_place(tmp_path, monkeypatch, WORDS["silence"])
    program.main(["--facts", str(facts)])
    assert "  ok    profile whole\n" in capsys.readouterr().out
    profile.write_text(profile.read_text() + "# a note\n")
    program.main(["--facts", str(facts)])
    assert "profile whole, but not as it was handed out: somebody has changed it\n" in capsys.readouterr().out


@pytest.mark.parametrize("kind", [socket.SOCK_DGRAM, socket.SOCK_RAW])
def test_ping_detects_responses_of_this_computer(
    kind: int, program: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By either kind of socket, as far as this user may; the kernel answers, and our own question is no answer."""
    try:
        socket.socket(socket.AF_INET, kind, socket.IPPROTO_ICMP).close()
    except PermissionError:
        kind = socket.SOCK_DGRAM if kind == socket.SOCK_RAW else socket.SOCK_RAW
    try:
        socket.socket(socket.AF_INET, kind, socket.IPPROTO_ICMP).close()
    except PermissionError:
        pytest.skip("this user may not ping: net.ipv4.ping_group_range leaves it out")
    monkeypatch.setattr(program, "PING_S", 0.3)
    for address, answered in (("127.0.0.1", True), ("240.0.0.1", False)):
        with socket.socket(socket.AF_INET, kind, socket.IPPROTO_ICMP) as one:
            assert (program.echo(one, address, 57) is not None) is answered


@pytest.mark.parametrize("spoil", [lambda facts: facts.unlink(), lambda facts: facts.write_text("{")])
def test_missing_or_damaged_facts_file_is_reported(
    spoil: Callable[[Path], object],
    program: ModuleType,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    spoil(unpacked(tmp_path))
    assert program.main(["--facts", "self-test.json"]) == 6
    said = "NOT PASSED\nself-test.json cannot be read: unpack the enrolment package again, and run its test there\n"
    assert capsys.readouterr().out == said


def test_openvpn_is_located_outside_the_path_of_a_user(
    program: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    in_openvpns_place(tmp_path, monkeypatch, WORDS["silence"])
    monkeypatch.setenv("PATH", "/nonexistent")
    assert program.openvpn() is None
    monkeypatch.setattr(program, "SBIN", str(tmp_path / "bin"))
    assert program.openvpn() == str(tmp_path / "bin" / "openvpn")
