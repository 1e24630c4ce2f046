"""Recordings over a real rsync and sshd: cut, resumed, mended, within rate and cap, and nothing else admitted."""

import time
from pathlib import Path

import pytest
from gateway_stand import Key, Start, ground, machine, technician  # noqa: F401 - fixtures
from retrieval_stand import FOLDER, GATEWAY, KEPT, MB, Ends, ends

from atlantis_netcfg.emulator.lab import Lab
from atlantis_netcfg.operations.common.request import Request, Target
from atlantis_netcfg.operations.retrieve import RetrievalProgram, RetrievalSelection, program_by_ssh, source_at

pytestmark = [pytest.mark.slow, pytest.mark.namespace]
INCOMING = "/srv/recordings/.incoming/coastal-gateway"


@pytest.fixture
def pair(ground: Lab, machine: Start) -> Ends:  # noqa: F811 - fixtures
    return ends(ground, machine)


def asked_by_ssh(pair: Ends, key: Key, folder: Path) -> RetrievalProgram:
    """The gateway's program, as the command asks it."""
    known = folder / "known"
    known.write_text(f"{GATEWAY} {pair.gateway.host_key}\n")
    port, file = pair.gateway.port, str(key.file)
    target = Target(host="127.0.0.1", port=port, known_hosts=str(known), identity=file)
    request = Request(state=folder, rehearsed=True, targets={GATEWAY: target})
    return program_by_ssh(pair.declaration, source_at(pair.declaration, "coastal", pair.source)[0], request)


def test_transfer_is_complete_survives_a_cut_and_repairs_damage(
    pair: Ends,
    technician: Key,  # noqa: F811 - a fixture
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pair.record("bag-1/a.db3", 3 * MB)
    pair.record("bag-1/metadata.yaml", 400)
    pair.record("bag-2/writing.db3", 1000, age_s=1)
    before = pair.digests(pair.gateway, FOLDER)
    start = pair.sent()
    look = pair.start(rate_bps=8 * MB)
    assert (look["files"], look["bytes"], look["writing"]) == (2, 3 * MB + 400, 1)
    pair.until(lambda told: told["wire_bytes"] > 0.2 * MB)
    first, since = pair.sent(), time.monotonic()
    pair.until(lambda told: told["wire_bytes"] > 1.5 * MB)
    assert (pair.sent() - first) * 8 / (time.monotonic() - since) < 8 * MB, "the rate is kept"
    pair.cut()
    pair.until(lambda told: told["state"] == "waiting")
    pair.cut(up=True)
    told = pair.ended()
    assert (told["state"], told["arrived"]) == ("done", 2), told
    assert told["tries"] >= 1
    sent = pair.sent() - start
    assert 3 * MB < sent < 3 * MB * 1.3, "what had arrived was not sent again"
    assert sent <= told["wire_bytes"] * 1.05, "what is told is not less than what the interface has counted"
    there = pair.digests(pair.centre, KEPT)
    assert there == {name: digest for name, digest in before.items() if not name.startswith("bag-2")}
    assert pair.digests(pair.gateway, FOLDER) == before, "nothing is removed or changed at the source"
    monkeypatch.setenv("ANSIBLE_SSH_ARGS", "")
    program = asked_by_ssh(pair, technician, tmp_path)
    assert program.look(RetrievalSelection())["kept"] == 2
    assert program.status().whole

    spoil = f"printf X | dd of={KEPT}/bag-1/a.db3 bs=1 seek=1000000 conv=notrunc"
    pair.centre.run(f"touch -r {KEPT}/bag-1/a.db3 /root/time; {spoil}; touch -r /root/time {KEPT}/bag-1/a.db3")
    start = pair.sent()
    look = pair.start(again=True)
    assert (look["files"], look["bytes"], look["compared"]) == (2, 0, 2)
    told = pair.ended()
    assert (told["state"], told["lost"]) == ("done", ["bag-1/a.db3"]), "a file that was spoilt there is found"
    assert pair.digests(pair.centre, KEPT) == there
    assert pair.sent() - start < 0.3 * MB, "and mended by the blocks that differ"


def test_transfer_stops_on_request_or_limit_and_checks_the_host_key(pair: Ends) -> None:
    pair.record("a.db3", 2 * MB)
    start = pair.sent()
    pair.start(cap=600_000)
    told = pair.ended()
    assert told["state"] == "spent"
    assert pair.sent() - start < 600_000, "by the counter of the interface"
    pair.start(rate_bps=4 * MB)
    pair.until(lambda told: told["wire_bytes"] > 0.3 * MB)
    told = pair.ask("stop")
    assert (told["state"], told["running"], told["job"]) == ("stopped", False, False)
    arrived = int(pair.centre.run(f"stat -c %s {INCOMING}/a.db3").stdout)
    assert 0.4 * MB < arrived < 2 * MB
    assert pair.centre.run(f"ls {KEPT}").stdout == "", "half a file has no name there"

    pair.start(rtt_max_s=1e-6)
    told = pair.until(lambda told: told["state"] == "waiting")
    assert "the traffic does not go over lan now" in told["why"]
    pair.ask("stop")

    pair.centre.run(f"printf X | dd of={INCOMING}/a.db3 bs=1 seek=100 conv=notrunc")
    pair.start()
    assert pair.ended()["state"] == "done", "a part that was spoilt meanwhile is sent again"
    assert pair.digests(pair.centre, KEPT) == pair.digests(pair.gateway, FOLDER)

    user = "svc-retrieval@10.80.0.2"
    for words in (("id",), ("-t", "bash"), ("rsync --server --sender -te.LsfxCIvu . /etc",), ("-s", "sftp")):
        code, text = pair.log_in(user, *words)
        assert (code != 0, text) == (True, ""), words
    assert pair.log_in("-o BindAddress=10.64.1.10", user, "atlantis have")[0] == 255, (
        "from its address in the VPN alone"
    )
    pair.record("b.db3", 1000)
    pair.gateway.run("ssh-keygen -q -t ed25519 -N '' -f /root/other")
    pair.gateway.run("echo scc-control $(cut -d' ' -f1,2 /root/other.pub) > /etc/atlantis/retrieval.known_hosts")
    pair.start()
    told = pair.ended()
    assert told["state"] == "failed", "whoever has another host key gets nothing"
    assert "has not its declared SSH host key" in told["why"]


@pytest.mark.campaign
def test_transfer_survives_a_70_s_outage_and_a_power_cut(pair: Ends) -> None:
    pair.record("a.db3", 6 * MB)
    start = pair.sent()
    pair.start(rate_bps=2 * MB, silence_s=120)
    pair.until(lambda told: told["wire_bytes"] > 1 * MB)
    pair.cut()
    time.sleep(70)
    pair.cut(up=True)
    pair.until(lambda told: told["wire_bytes"] > 2.5 * MB)
    assert pair.sent() - start < 3.5 * MB
    pair.gateway.power_cut()
    pair.gateway.power_on()
    pair.gateway.run("ip address add 10.80.0.21/16 dev eth0")
    start = pair.sent()
    pair.until(lambda told: told["running"])
    told = pair.ended()
    assert (told["state"], told["arrived"]) == ("done", 1)
    assert pair.sent() - start < 5 * MB
    assert pair.digests(pair.centre, KEPT) == pair.digests(pair.gateway, FOLDER)
