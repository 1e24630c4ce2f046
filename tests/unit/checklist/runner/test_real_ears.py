"""The real site's ears: OpenSSH's place is taken by a script that writes down how it was called."""

import asyncio
import os
import shutil
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from waiting import wait_until

from atlantis_netcfg.checklist import plan, probes
from atlantis_netcfg.checklist.runner import GatewayUnreachable, RealTransport, _gateway_access, _real, ask_here, way_in
from atlantis_netcfg.checklist.runner import cost as _bill
from atlantis_netcfg.core.errors import TRUST
from atlantis_netcfg.core.events import Event, Verdict
from atlantis_netcfg.inventory import load
from atlantis_netcfg.links import LinkFinding
from atlantis_netcfg.operations.allow_list_test.prove import Proof
from atlantis_netcfg.operations.common.request import Request
from atlantis_netcfg.operations.common.session_link import site_link_of
from atlantis_netcfg.operations.links.collect import LinksStatus as LooksBack

INVENTORY = Path(__file__).parents[4] / "inventory"
SHIPPED = load(INVENTORY)
GATEWAY = SHIPPED.hosts["coastal-gateway"]
HERE = '#!/bin/sh\nfor last; do :; done\necho "$@" >>{log}\n{does}\n'
RUNS = 'exec sh -c "$last"'
AS_ROOT = '#!/bin/sh\nexec "$@"\n'


class Stand:
    """A gateway that is this computer, by scripts named ssh and sudo."""

    def __init__(self, folder: Path, **request: Any) -> None:  # noqa: ANN401 - fields of Request
        self.log = folder / "calls"
        self.log.touch()
        self.programs = folder / "programs"
        self.programs.mkdir()
        self.behaves(RUNS)
        self._script("sudo", AS_ROOT)
        self.told: list[tuple[str, probes.Answer]] = []
        self.events: list[Event] = []
        asked = Request(state=folder / "state", command="provision check", **request)
        self.ears = RealTransport(SHIPPED, "coastal", asked, self.events.append, ssh_config=str(folder / "ssh_config"))

    def behaves(self, does: str) -> None:
        """What ssh does."""
        self._script("ssh", HERE.format(log=self.log, does=does))

    def ask(
        self, *questions: probes.Question, place: probes.Place = probes.Place.GATEWAY, host: str | None = None
    ) -> Mapping[str, probes.Answer]:
        asked = [(question.name, question) for question in questions]
        return asyncio.run(self.ears.ask(place, host, asked, lambda key, answer: self.told.append((key, answer))))

    @property
    def calls(self) -> list[str]:
        return self.log.read_text().splitlines()

    def _script(self, name: str, text: str) -> None:
        (self.programs / name).write_text(text)
        (self.programs / name).chmod(0o755)


@pytest.fixture
def stand(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Stand:
    made = Stand(tmp_path)
    monkeypatch.setenv("PATH", f"{made.programs}:{os.environ['PATH']}")
    return made


def run(name: str, *argv: str, within_s: float = 30.0) -> probes.RunProgram:
    return probes.RunProgram(name, probes.Place.GATEWAY, argv, within_s)


def test_all_requests_go_in_one_command(stand: Stand) -> None:
    nobody = probes.Listen(
        "tcp", probes.Place.GATEWAY, "tcp", "127.0.0.1", 1, say=(probes.Say(b"\x00'\"%s$(x)\n", b"."),)
    )
    found = stand.ask(run("one", "echo", "it's", "100%", "$HOME"), run("two", "true"), nobody)
    (call,) = stand.calls
    assert "-o BatchMode=yes -o Compression=yes -o StrictHostKeyChecking=yes -o ServerAliveInterval=20" in call
    assert "-o HostKeyAlias=coastal-gateway" in call
    assert "ConnectTimeout=15" in call
    assert " coastal-gateway python3 -I -c '" in call
    assert len(call) < 1000, "the program and the questions are not on a command line"
    one = found["one"]
    assert isinstance(one, probes.CommandResult)
    assert (one.trouble, one.rc, one.out) == (None, 0, "it's 100% $HOME\n")
    assert one.request_time <= one.began <= one.response_time
    assert found["tcp"].trouble is probes.Trouble.REFUSED
    assert dict(stand.told) == found
    assert [(one.device, one.stage.value, one.message) for one in stand.events] == [
        ("coastal: gateway", "connecting", "3 read-only requests"),
        ("coastal: gateway", "done", "3 of 3 requests were sent"),
    ]


def test_user_that_is_not_root_uses_sudo(stand: Stand) -> None:
    way = replace(way_in(SHIPPED, GATEWAY, Request(), "config"), sudo=True)
    assert way.run("echo %s", "it's 100% $HOME").out == b"it's 100% $HOME\n"
    assert " coastal-gateway sudo /bin/sh -c 'echo " in stand.calls[0]


def test_missing_sudo_rights_are_reported(stand: Stand, monkeypatch: pytest.MonkeyPatch) -> None:
    way = replace(way_in(SHIPPED, GATEWAY, Request(), "config"), sudo=True)
    monkeypatch.setattr("atlantis_netcfg.checklist.runner._gateway_access.way_in", lambda *_: way)
    stand.behaves("cat >/dev/null; echo 'sudo: a password is required' >&2; exit 1")
    assert stand.ask(run("one", "true"))["one"].words.startswith(
        "the login user on coastal-gateway cannot become root without a password; there, as root: `echo"
    )


def test_login_banner_does_no_harm(stand: Stand) -> None:
    noise = 'echo "Welcome to Ubuntu"; echo \'{"key": "unknown", "trouble": null}\'; echo 7; echo; '
    stand.behaves(noise + RUNS)
    assert stand.ask(run("one", "true"))["one"].trouble is None


def test_program_fault_is_raised_after_the_results(stand: Stand) -> None:
    well = '{"key":"two","trouble":null,"words":"","rc":0,"out":"","err":"","began":1.0}'
    stand.behaves(f"""cat >/dev/null; echo '{{"key":"one","fault":"ZeroDivisionError: x"}}'; echo '{well}'""")
    with pytest.raises(RuntimeError, match="the program that listens failed: ZeroDivisionError: x"):
        stand.ask(run("one", "true"), run("two", "true"))
    assert [key for key, _ in stand.told] == ["two"]


AWAY = "coastal-gateway is unreachable: "
BRING = "install your key there: `ssh-copy-id coastal-gateway`"
LOOK = "check its power and its cable, then run the same command again"
NOBODY: Mapping[str, tuple[str, str]] = {
    "another host key": (
        "echo 'Host key verification failed.' >&2; exit 255",
        f"{AWAY}its SSH host key differs from the inventory, or is not known here, so nothing was sent to it; {TRUST}",
    ),
    "no way": (
        "echo 'ssh: connect to host 10.64.1.10 port 22: No route to host' >&2; exit 255",
        f"{AWAY}ssh: connect to host 10.64.1.10 port 22: No route to host; {LOOK}",
    ),
    "no key": (
        "echo 'root@10.64.1.10: Permission denied (publickey,password).' >&2; exit 255",
        f"{AWAY}root@10.64.1.10: Permission denied (publickey,password).; {BRING}",
    ),
    "not a word": ("exit 255", f"{AWAY}ssh said nothing; {LOOK}"),
    "no Python": ("exit 127", "coastal-gateway has no python3; there: `apt-get install python3`"),
    "a Python of long ago": (
        "cat >/dev/null; echo 'SyntaxError: future feature annotations is not defined' >&2; exit 1",
        "the listener program exited on coastal-gateway: SyntaxError: future feature annotations is not defined",
    ),
    "an end without a word": ("exit 3", "the listener program exited on coastal-gateway: exit 3"),
}


@pytest.mark.parametrize("case", NOBODY)
def test_unreachable_gateway_is_reported_for_every_request(stand: Stand, case: str) -> None:
    does, words = NOBODY[case]
    stand.behaves(does)
    found = stand.ask(run("one", "true"), probes.Listen("two", probes.Place.GATEWAY, "udp", port=14550))
    assert {name: (one.trouble, one.words) for name, one in found.items()} == {
        "one": (probes.Trouble.NO_PLACE, words),
        "two": (probes.Trouble.NO_PLACE, words),
    }
    assert stand.events[-1].message == "0 of 2 requests were sent"


def test_hanging_connection_times_out_with_partial_results(stand: Stand, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_gateway_access, "_CONNECT_S", 0)
    monkeypatch.setattr(_gateway_access, "_GRACE_S", 0.7)
    first = '{"key":"one","trouble":null,"words":"","rc":0,"out":"early","err":"","began":1.0}'
    stand.behaves(f"cat >/dev/null; echo '{first}'; exec sleep 600")
    found = stand.ask(run("one", "true", within_s=0), run("two", "true", within_s=0))
    assert isinstance(found["one"], probes.CommandResult)
    assert found["one"].out == "early"
    assert (found["two"].trouble, found["two"].words.partition(";")[0]) == (
        probes.Trouble.NO_PLACE,
        "coastal-gateway did not respond in time",
    )


def test_cancellation_ends_the_connection(stand: Stand, tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    stand.behaves(f"echo $$ >{pipe}; exec sleep 600")

    async def impatient() -> None:
        task = asyncio.create_task(stand.ears.ask(probes.Place.GATEWAY, None, [("one", run("one", "true"))], print))
        pid = await asyncio.to_thread(pipe.read_text)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        pids.append(pid.strip())

    pids: list[str] = []
    asyncio.run(impatient())
    wait_until(lambda: not Path("/proc", pids[0]).exists())


def test_slow_link_has_longer_timeouts() -> None:
    fast, slow = (
        way_in(SHIPPED, GATEWAY, Request(via={"coastal-gateway": name}), "config") for name in ("lan", "satellite")
    )
    assert (fast.connect_s, slow.connect_s) == (15, 120)
    assert slow.grace_s > 3 * 70 > fast.grace_s


def test_example_values_and_unemulated_gateway_are_unreachable(tmp_path: Path) -> None:
    with pytest.raises(GatewayUnreachable, match="the inventory still contains example values"):
        way_in(SHIPPED, GATEWAY, Request())
    with pytest.raises(GatewayUnreachable, match="coastal-gateway is not emulated in this rehearsal"):
        way_in(SHIPPED, GATEWAY, Request(rehearsed=True))
    with pytest.raises(GatewayUnreachable, match="coastal has no such link"):
        way_in(SHIPPED, GATEWAY, Request(via={"coastal-gateway": "rope"}), "config")
    ears = RealTransport(SHIPPED, "coastal", Request(state=tmp_path))
    for place, host in ((probes.Place.ROUTER, None), (probes.Place.ROUTER, "coastal-router")):
        found = asyncio.run(ears.ask(place, host, [("it", probes.LinkStatusRequest("it", "satellite"))], print))["it"]
        assert found.trouble is probes.Trouble.NO_PLACE
        assert found.words.startswith("the inventory still contains example values")


def test_nothing_is_sent_over_a_metered_link_without_consent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for number, (accepted, calls) in enumerate(((False, 0), (True, 1))):
        folder = tmp_path / str(number)
        folder.mkdir()
        stand = Stand(folder, via={"coastal-gateway": "satellite"}, accept_cost=accepted)
        monkeypatch.setenv("PATH", f"{stand.programs}:{os.environ['PATH']}")
        found = stand.ask(run("one", "true"))["one"]
        assert len(stand.calls) == calls
        if accepted:
            assert found.trouble is None
        else:
            assert found.trouble is probes.Trouble.NO_PLACE
            assert found.words.startswith(
                "the cost was not accepted, so nothing was sent: over metered link satellite of coastal: up to 20 "
                "kB, 0.16 EUR; run the same command with `--accept-cost`"
            )


def test_cost_above_the_cap_is_refused_even_with_consent(tmp_path: Path) -> None:
    stand = Stand(tmp_path, via={"coastal-gateway": "satellite"}, accept_cost=True)
    flood = probes.Listen("it", probes.Place.GATEWAY, "udp", port=14550, listen_s=3000, max_bytes=99_000_000)
    assert "the limit for one action is 5.0 MB" in stand.ask(flood)["it"].words
    assert stand.calls == []


def test_stream_is_cut_at_its_estimate() -> None:
    chatty = probes.Listen("it", probes.Place.GATEWAY, "udp", port=14550, listen_s=10)
    ((_, cut),) = _bill.within_budget([("it", chatty)])
    assert isinstance(cut, probes.Listen)
    assert cut.max_bytes == 34_096
    carrier = site_link_of(SHIPPED, GATEWAY, "satellite")
    assert _bill.estimate(SHIPPED, "coastal", carrier, [("it", cut)]).bill.payload_bytes == pytest.approx(65_400, 0.03)


def test_budget_of_a_script_has_room_for_what_a_vehicle_reports_while_it_waits() -> None:
    """Two beacons that report a fix each second, 115 bytes long."""
    ping = next(entry.step for entry in plan(SHIPPED, "coastal").entries if entry.item.id == "zarco/usbl/ping")
    assert ping.probe is not None
    ((_, script),) = _bill.within_budget([("it", question) for question in ping.probe.asks()])
    assert isinstance(script, probes.Listen)
    assert script.max_bytes >= 2 * 115 * sum(message.within_s for message in script.say)


def test_cost_of_a_whole_checklist_is_shown_beforehand() -> None:
    entries = plan(SHIPPED, "coastal").entries
    assert _bill.previews(SHIPPED, "coastal", entries, Request())[0].words.startswith("over metered link satellite"), (
        "the proof"
    )
    asked = Request(via={"coastal-gateway": "satellite", "coastal-router": "4g"})
    gateway, router, session, proof_ = _bill.previews(SHIPPED, "coastal", entries, asked)
    assert [one.link.name for one in (gateway, router, session, proof_)] == ["satellite", "4g", "4g", "satellite"]
    assert gateway.at_most
    assert 100_000 < gateway.bill.payload_bytes < 1_500_000
    assert router.bill.payload_bytes < 200_000
    assert proof_.bill.payload_bytes <= 20_000


def test_this_computer_is_probed_without_ssh(stand: Stand) -> None:
    found = stand.ask(probes.RunProgram("one", probes.Place.LAPTOP, ("echo", "here")), place=probes.Place.LAPTOP)["one"]
    assert isinstance(found, probes.CommandResult)
    assert (found.out, stand.calls) == ("here\n", [])
    assert stand.events[-1].device == "this computer"


def test_program_that_cannot_start_here_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    found = asyncio.run(ask_here([("one", probes.RunProgram("one", probes.Place.LAPTOP, ("true",)))], lambda *_: None))[
        "one"
    ]
    assert found.trouble is probes.Trouble.NO_PLACE
    assert found.words.startswith("the listener program did not start on this computer: ")


def test_links_are_inspected_once_for_all_requests(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    looks: list[Any] = []

    async def look(*asked: object) -> LooksBack:
        looks.append(asked)
        return Told()  # type: ignore[return-value]

    class Told:
        @staticmethod
        def as_dict() -> dict[str, dict[str, str]]:
            return {"satellite": {"state": "up"}, "4g": {"state": "down"}}

    monkeypatch.setattr(_real, "collect_links", look)
    ears = RealTransport(SHIPPED, "coastal", Request(state=tmp_path, rehearsed=True))
    questions = [(name, probes.LinkStatusRequest(name, name)) for name in ("satellite", "4g", "rope")]
    heard: list[str] = []
    found = asyncio.run(ears.ask(probes.Place.ROUTER, None, questions, lambda key, _: heard.append(key)))
    assert len(looks) == 1
    assert found["satellite"] == probes.LinkStatusResult(None, "", {"state": "up"})
    assert found["4g"] == probes.LinkStatusResult(None, "", {"state": "down"})
    assert (found["rope"].trouble, found["rope"].words) == (probes.Trouble.MISSING, "the site has no link `rope`")
    assert heard == ["satellite", "4g", "rope"]


def proof() -> Proof:
    seen = LinkFinding(Verdict.PASS, "reached", "the VPN is reached")
    return Proof(
        site="coastal",
        link="satellite",
        active=True,
        results=((None, seen),),  # type: ignore[arg-type]
        findings=(),
        bytes_counted=9000,
        budget_bytes=20_000,
        kept_off=0,
        turned_away=0,
        carrier="lan",
    )


@pytest.mark.parametrize("accepted", [False, True])
def test_allow_list_test_needs_consent_to_its_cost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, accepted: bool
) -> None:
    monkeypatch.setattr("atlantis_netcfg.checklist.runner._real.refuse_examples", lambda *_, **__: None)
    request = Request(state=tmp_path, accept_cost=accepted, command="provision check")
    ears = RealTransport(SHIPPED, "coastal", request, prove=lambda *_: proof())
    found = asyncio.run(
        ears.ask(probes.Place.ROUTER, None, [("it", probes.AllowListTestRequest("it", "satellite"))], lambda *_: None)
    )["it"]
    assert isinstance(found, probes.AllowListTestResult)
    if accepted:
        assert (found.trouble, [one.code for one in found.findings]) == (None, ["reached"])
        assert found.bill == "9.0 kB, 0.08 EUR"
    else:
        assert found.trouble is probes.Trouble.NO_PLACE
        assert found.words.startswith("the cost was not accepted, so nothing was sent: over metered link satellite")


def test_python3_is_in_the_path() -> None:
    assert shutil.which("python3")
