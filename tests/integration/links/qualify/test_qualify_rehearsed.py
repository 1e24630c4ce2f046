"""`provision measure link … --rehearse`, as a technician types it: an emulated router, a relay, and our far end."""

import json
import os
import re
import subprocess
from decimal import Decimal
from pathlib import Path
from typing import Any

import preforked
import pytest

from atlantis_netcfg.links.qualify.figures import train_figures
from atlantis_netcfg.links.qualify.measured_run import SAMPLES_FILE, read_run
from atlantis_netcfg.links.qualify.samples import read


def provision(state: Path, *typed: str, code: int) -> subprocess.CompletedProcess[str]:
    done = preforked.run(["measure", "link", *typed], env={**os.environ, "ATLANTIS_STATE": str(state)})
    assert done.returncode == code, f"exit {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done


@pytest.mark.smoke
@pytest.mark.slow
def test_inactive_link_is_measured_and_counted_separately(tmp_path: Path) -> None:
    """The satellite is the last of three links, so only our routing rule can have led the packets there."""
    typed = ("site=coastal", "link=satellite", "profile=throughput", "--max-mb", "0.4", "--rehearse", "--json")
    told: dict[str, Any] = json.loads(provision(tmp_path, *typed, code=6).stdout)
    (link,) = told["links"]
    run = link["run"]
    assert (told["rehearsed"], run["emulated"], run["reason"]) == (True, True, "bytes")
    assert run["sent_bytes"] + run["received_bytes"] <= 400_000
    assert run["way"] == "PASS", run["way_reason"]
    counts = {each["link"]: each for each in run["counts"]}
    assert counts.keys() == {"wifi-ptp", "4g", "satellite"}
    assert counts["satellite"]["test_bytes_up"] == run["sent_bytes"]
    assert counts["satellite"]["test_bytes_down"] >= run["received_bytes"]
    assert [counts[name]["test_packets_up"] for name in ("wifi-ptp", "4g")] == [0, 0]
    assert [counts[name]["port_bytes_up"] for name in ("wifi-ptp", "4g")] == [0, 0]
    judged = {each["criterion"]: each for each in link["judged"]}
    assert judged["FTD, round trip, 95 %"]["verdict"] == "PASS"
    assert 0.7 <= judged["FTD, round trip, 95 %"]["measured"] < 0.9, "the link is declared with 700 ms"
    assert (run["path_mtu_up"], run["path_mtu_both"]) == (1500, 1500)
    folder = tmp_path / "rehearsal" / "coastal" / "qualify" / run["id"]
    assert folder.samefile(link["folder"])
    assert read_run(folder).model_dump(mode="json") == run
    with (folder / SAMPLES_FILE).open(encoding="utf-8") as lines:
        assert train_figures(read(lines), "idle").loss.received == 600


@pytest.mark.slow
def test_good_link_passes(tmp_path: Path) -> None:
    told: dict[str, Any] = json.loads(
        provision(tmp_path, "site=coastal", "link=satellite", "--rehearse", "--json", code=0).stdout
    )
    (link,) = told["links"]
    assert (link["run"]["reason"], link["run"]["emulated"]) == ("done", True)
    assert {each["criterion"]: each["verdict"] for each in link["judged"]} == {
        **dict.fromkeys(("FTD, round trip, 95 %", "FDV up, 95 %", "FDV down, 95 %"), "PASS"),
        **dict.fromkeys(("FLR up", "FLR down", "longest gap", "AVAIL"), "PASS"),
    }
    assert link["run"]["thresholds_name"] == "satellite, outages up to 5 s in a rehearsal"


@pytest.mark.slow
def test_price_limit_is_kept(tmp_path: Path) -> None:
    typed = ("site=coastal", "link=satellite", "--max-eur", "1", "--rehearse", "--json")
    told: dict[str, Any] = json.loads(provision(tmp_path, *typed, code=6).stdout)
    run = told["links"][0]["run"]
    assert (run["reason"], run["currency"], run["budget"]["max_price"]) == ("money", "EUR", "1")
    packet = Decimal(8) * (1500 + 28) / 1_000_000
    assert Decimal("0.6") < Decimal(run["price"]) <= 1 + packet


@pytest.mark.slow
def test_vpn_measurement_proves_the_route_and_records_device_facts(tmp_path: Path) -> None:
    typed = ("site=coastal", "link=4g", "over=vpn", "--max-mb", "0.1", "--rehearse", "--json")
    told: dict[str, Any] = json.loads(provision(tmp_path, *typed, code=6).stdout)
    (link,) = told["links"]
    run = link["run"]
    assert (run["reason"], run["way"], run["far_end"]["over_vpn"]) == ("bytes", "PASS", True), run["way_reason"]
    counts = {each["link"]: each for each in run["counts"]}
    assert counts["4g"]["test_bytes_up"] == run["sent_bytes"]
    assert counts["wifi-ptp"]["test_packets_up"] == 0, "it carries the traffic of the site"
    assert any("but no tunnel is created" in each for each in told["not_rehearsed"])
    assert re.fullmatch(r"RB5009UPr\+S\+, RouterOS 7\.\d+.*", run["facts"]["router"])
    assert run["facts"]["4G registration"] == "registered home"
    assert run["facts"]["RSRP"].endswith(" dBm")
    assert {"4G technology", "4G operator", "4G cell", "RSRQ", "SINR"} <= run["facts"].keys()


@pytest.mark.slow
def test_foreign_far_end_is_measured_and_not_reported_as_ours(tmp_path: Path) -> None:
    typed = ("site=coastal", "link=4g", "far=192.0.2.7:8620", "--max-mb", "0.2", "--rehearse", "--json")
    told: dict[str, Any] = json.loads(provision(tmp_path, *typed, code=6).stdout)
    (link,) = told["links"]
    run, end = link["run"], link["run"]["far_end"]
    assert (end["name"], end["address"], end["port"]) == ("192.0.2.7:8620", "192.0.2.7", 8620)
    assert (end["authenticated"], run["way"], run["path_mtu_both"]) == (False, "PASS", 1500), run["way_reason"]
    assert any("the far end is not ours" in each for each in run["remarks"])
    assert {each["criterion"]: each["verdict"] for each in link["judged"]}["FTD, round trip, 95 %"] == "PASS"


@pytest.mark.slow
def test_every_requested_link_has_a_result_after_the_limit_is_used_up(tmp_path: Path) -> None:
    typed = ("site=coastal", "link=all", "--max-mb", "0.1", "--rehearse", "--json")
    told: dict[str, Any] = json.loads(provision(tmp_path, *typed, code=6).stdout)
    assert [(each["run"]["link"], each["run"]["reason"]) for each in told["links"]] == [("wifi-ptp", "bytes")]
    assert [each["link"] for each in told["not_measured"]] == ["4g", "satellite"]
    assert (tmp_path / "rehearsal" / "coastal" / "qualify" / told["links"][0]["run"]["id"] / "page.html").is_file()


@pytest.mark.parametrize(
    ("typed", "code", "words"),
    [
        (("site=coastal", "--rehearse"), 7, "`coastal` has several links"),
        (("site=coastal", "link=5g", "--rehearse"), 7, "type one of: link=wifi-ptp, link=4g, link=satellite, link=all"),
        (
            ("site=coastal", "link=all", "--max-eur", "1", "--rehearse"),
            3,
            "set `billing` of link `4g` in group_vars/coastal.yml in the inventory",
        ),
        (("site=coastal", "link=4g", "--max-mb", "nothing"), 3, "not a number above 0"),
        (("site=coastal", "link=4g", "far=router.example.net", "--rehearse"), 3, "type it like `far=192.0.2.7:862`"),
        (("site=coastal", "link=4g", "far=192.0.2.7", "over=vpn", "--rehearse"), 3, "remove `over=vpn`"),
        (("site=coastal", "link=4g", "far=192.0.2.7", "profile=all", "--rehearse"), 3, "type `profile=telemetry`"),
        (
            ("site=coastal", "link=satellite", "far=192.0.2.7", "--rehearse"),
            7,
            "add it under `allow` of that link",
        ),
        (("site=coastal", "link=4g"), 3, "still contains example values"),
        (("site=coastal", "link=4g", "profile=videos"), 3, "telemetry, images, throughput, all"),
    ],
)
def test_impossible_measurement_is_refused_before_anything_is_sent(
    typed: tuple[str, ...], code: int, words: str, tmp_path: Path
) -> None:
    done = provision(tmp_path, *typed, code=code)
    assert words in done.stdout + done.stderr
    assert not [*tmp_path.rglob(SAMPLES_FILE)]
