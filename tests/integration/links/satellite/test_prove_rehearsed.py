"""`provision measure satellite … --rehearse`, as a technician types it."""

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import preforked
import pytest
from hints_said import advised, said

from atlantis_netcfg.runs import Store

STRANGER = "203.0.113.3"


def provision(
    state: Path, *typed: str, code: int, command: str = "measure satellite"
) -> subprocess.CompletedProcess[str]:
    done = preforked.run([*command.split(), *typed], env={**os.environ, "ATLANTIS_STATE": str(state)})
    assert done.returncode == code, f"exit {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done


@pytest.mark.smoke
@pytest.mark.slow
def test_emulated_router_refuses_undeclared_targets(tmp_path: Path) -> None:
    told: dict[str, Any] = json.loads(
        provision(tmp_path, "site=coastal", "link=satellite", "--rehearse", "--json", code=6).stdout
    )
    found = {row["target"]: (row["outcome"], row["verdict"]) for row in told["targets"]}
    assert (told["exit"], told["rehearsed"], told["active"]) == (6, True, False)
    assert found[STRANGER] == ("refused here", "PASS")
    assert found["203.0.113.2 udp 1194"] == ("not tried", "INCONCLUSIVE")
    assert told["kept_off_packets"] == 3
    assert told["bytes_counted"] < told["budget_bytes"] == 20_000
    assert [finding["code"] for finding in told["findings"]] == ["terminal-not-looked-at"]
    (prepared,) = Store(tmp_path, is_rehearsal=True).runs("coastal")
    assert prepared.start_record is not None
    assert prepared.start_record.prepares, "`rollback to=latest` passes it over"


@pytest.mark.slow
def test_the_filter_is_closed_again_after_it_was_opened(tmp_path: Path) -> None:
    done = provision(tmp_path, "site=coastal", "--open-filter", "--rehearse", code=6)
    assert f"({STRANGER}) is refused by the router, nothing was sent" in done.stdout
    assert f"({STRANGER}) did not answer, but nothing else was reached" in done.stdout
    assert "a real proof asks first: over satellite of coastal" in done.stdout


@pytest.mark.slow
def test_probes_that_the_emulator_cannot_send_are_not_tried(tmp_path: Path) -> None:
    """The router refuses arguments that it does not know, and names that are not there."""
    inventory = tmp_path / "inventory"
    shutil.copytree(Path(__file__).parents[4] / "inventory", inventory)
    coastal = inventory / "group_vars" / "coastal.yml"
    added = "      allow: [{name: ours, address: 192.0.2.50, port: 443, transport: tcp}]\n      refused_probes:"
    coastal.write_text(coastal.read_text("utf-8").replace("      refused_probes:", added), "utf-8")
    typed = ("site=coastal", "--try-all", "--rehearse", f"inventory={inventory}", "--json")
    told: dict[str, Any] = json.loads(provision(tmp_path, *typed, code=6).stdout)
    found = {row["target"]: (row["outcome"], row["probe"]) for row in told["targets"]}
    assert found["192.0.2.50 tcp 443"] == ("not tried", "tcp")  # an emulated router opens no TCP connection
    assert found["192.0.2.123 udp 123"][0] == "not tried"


@pytest.mark.slow
def test_site_without_refused_targets_is_not_reported_as_proved(tmp_path: Path) -> None:
    done = provision(tmp_path, "site=te4sea", "--rehearse", code=7)
    assert "0 of 3 targets proved, 3 could not be tried" in done.stdout


@pytest.mark.slow
def test_session_over_the_satellite_stays_in_budget_and_waits_long_enough(tmp_path: Path) -> None:
    """Each look at the counters costs airtime here, so that there are few of them, and time between them."""
    told = json.loads(provision(tmp_path, "site=te4sea", "--try-all", "--rehearse", "--json", code=6).stdout)
    assert {row["target"]: row["outcome"] for row in told["targets"]}["203.0.113.2 udp 1194"] == "answered"
    assert told["bytes_counted"] < told["budget_bytes"] == 20_000
    assert [row["window_s"] for row in told["targets"] if row["probe"].startswith("ntp")] == [90.0, 90.0]


@pytest.mark.slow
def test_announced_cost_covers_the_billed_bytes(tmp_path: Path) -> None:
    """The session to the vessel's router goes over the satellite as well, and its handshake is paid for."""
    told = json.loads(provision(tmp_path, "site=te4sea", "--rehearse", "--json", code=7).stdout)
    ((expected,), cost) = told["expected"], told["cost"]
    assert (expected["bearer"], expected["at_most"], set(told["costs"])) == ("satellite", True, {"satellite"})
    assert cost["payload_bytes"] > told["bytes_counted"] + 4_000
    assert cost["payload_bytes"] <= expected["payload_bytes"] <= 40_000


@pytest.mark.slow
def test_proved_satellite_can_be_used(tmp_path: Path) -> None:
    """What `use` advises where nobody asks over a link is typed, and then it takes the link. A real OpenVPN answers."""
    use = ("site=coastal", "link=satellite", "for=10m", "--rehearse")
    refused = provision(tmp_path, *use, code=4, command="links use").stderr
    assert "whether satellite works is not proved" in refused
    hint = (
        "`provision measure satellite site={} link={} --try-all` tries the VPN over it, which counts for an hour; or {}"
    )
    (words,) = advised(said(refused, hint))
    assert "VPN server (203.0.113.2 udp 1194) was reached" in provision(tmp_path, *words[2:], code=6).stdout
    assert "satellite carries the traffic" in provision(tmp_path, *use, code=0, command="links use").stdout


@pytest.mark.slow
def test_proof_applies_only_to_its_link_and_mode(tmp_path: Path) -> None:
    Store(tmp_path).keep_proof("coastal", "satellite")
    Store(tmp_path, is_rehearsal=True).keep_proof("coastal", "4g")
    use = ("site=coastal", "link=satellite", "for=10m", "--rehearse")
    assert "whether satellite works is not proved" in provision(tmp_path, *use, code=4, command="links use").stderr


@pytest.mark.slow
def test_hint_of_a_rehearsal_rehearses(tmp_path: Path) -> None:
    told = json.loads(provision(tmp_path, "site=coastal", "--rehearse", "--json", code=6).stdout)
    hints = {row["hint"] for row in told["targets"] if row["outcome"] == "not tried"}
    assert hints == {"`provision measure satellite site=coastal --try-all --rehearse` tries it"}


def test_impossible_proof_is_refused_before_contacting_a_device(tmp_path: Path) -> None:
    assert "`scc` has no satellite link" in provision(tmp_path, "site=scc", code=7).stderr
    assert "no satellite link `4g`" in provision(tmp_path, "site=coastal", "link=4g", code=7).stderr
    assert "example values" in provision(tmp_path, "site=coastal", code=3).stderr
    missing = provision(tmp_path, "site=coastal", "--rehearse", "backup=missing.bin", code=3)
    assert "the backup missing.bin cannot be read" in missing.stderr
