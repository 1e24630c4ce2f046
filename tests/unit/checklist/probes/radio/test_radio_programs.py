"""The programs themselves, as they are on this computer: what they print is what is read."""

import subprocess

import pytest
from waiting import HANG_S

from atlantis_netcfg.checklist.probes import CommandResult, Place, RunProgram, ping
from atlantis_netcfg.checklist.probes import ping as _ping


def run(question: RunProgram) -> CommandResult:
    done = subprocess.run(question.argv, capture_output=True, text=True, timeout=HANG_S, check=False)
    return CommandResult(None, rc=done.returncode, out=done.stdout, err=done.stderr)


def short(address: str) -> RunProgram:
    """The same question with two packets, for time."""
    asked = _ping.ping_request(Place.LAPTOP, address)
    return type(asked)(asked.name, asked.place, tuple("2" if one == str(_ping.COUNT) else one for one in asked.argv))


def test_real_output_of_ip_is_read() -> None:
    assert ping.read_route(run(ping.route_request(Place.LAPTOP, "127.0.0.1")), "127.0.0.1") == ping.NeighbourRoute("lo")
    assert ping.read_card(run(ping.card_request(Place.LAPTOP, "lo"))) == ping.NetworkCard(up=True, carrier=True)
    missing = run(ping.card_request(Place.LAPTOP, "nosuchif0"))
    assert "does not exist" in missing.err
    assert ping.read_card(missing) is None
    assert ping.read_neighbour(run(ping.neighbour_request(Place.LAPTOP, "127.0.0.1")), "127.0.0.1") is None


def test_real_output_of_ping_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = _ping.NeighbourPing("loopback", "127.0.0.1", Place.LAPTOP, 0.0, 10.0)
    ran = run(short("127.0.0.1"))
    echoes = _ping.read_ping(ran.out, "127.0.0.1")
    assert echoes is not None
    assert (echoes.sent_count, echoes.received_count, echoes.loss_percent) == (2, 2, 0)
    assert echoes.mean_ms is not None
    assert [one.code for one in _ping.judge_ping(wanted, ran).findings] == ["ping-cut-short"]
    monkeypatch.setattr(_ping, "COUNT", 2)
    assert [one.code for one in _ping.judge_ping(wanted, ran).findings] == ["answers"]


def iw(*words: str) -> CommandResult:
    done = subprocess.run(("iw", *words), capture_output=True, text=True, timeout=HANG_S, check=False)
    return CommandResult(None, rc=done.returncode, out=done.stdout, err=done.stderr)


def test_iw_has_the_commands() -> None:
    offered = iw("help").out
    for command in ("dev <devname> link", "dev <devname> station dump", "dev <devname> info", "reg get"):
        assert f"\t{command}" in offered


@pytest.mark.parametrize("words", [("dev", "nosuchif0", "link"), ("dev", "nosuchif0", "station", "dump")])
def test_iw_without_a_radio_prints_the_expected_error(words: tuple[str, ...]) -> None:
    """Without a driver of radios in the kernel, as in most machines that test, it says so."""
    said = iw(*words)
    assert said.rc
    assert "nl80211 not found" in said.err or "No such device" in said.err
