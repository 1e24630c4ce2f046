"""The checklist in Jenkins: what is not green there, and nothing else, is not green here."""

import xml.etree.ElementTree as ET

import checklist_example as made

from atlantis_netcfg.checklist.report import Document
from atlantis_netcfg.checklist.report._junit import junit


def read(document: Document) -> ET.Element:
    return ET.fromstring(junit(document))  # noqa: S314 - ours


def names(root: ET.Element, tag: str) -> list[str]:
    return [case.get("name", "") for case in root.iter("testcase") if case.find(tag) is not None]


def test_each_row_is_a_suite_and_each_item_a_case() -> None:
    root = read(made.example())
    suites = {suite.get("name"): len(suite) for suite in root}
    assert suites == {
        "checklist": 1,
        "girona500": 4,
        "sparus": 5,
        "zarco": 4,
        "stork": 4,
        "mares": 4,
        "eca-rov": 2,
        "coastal": 11,
        "left out": 1,
    }
    assert root.get("name") == "checklist of coastal, rehearsal: nothing real was checked"


def test_items_that_are_not_green_fail() -> None:
    root = read(made.example())
    assert names(root, "failure") == [
        "sparus/wifi",
        "sparus/usbl",
        "sparus/usbl/ping",
        "eca-rov/usbl",
        "coastal/site/rogue-dhcp",
    ]
    assert names(root, "error") == ["mares/gps"]
    assert names(root, "skipped") == ["coastal/satellite", "Mares: Acoustic"]
    assert [root.get(name) for name in ("tests", "failures", "errors", "skipped")] == ["36", "5", "1", "2"]


def test_failure_states_its_kind_and_advice() -> None:
    failures = {case.get("name"): case.find("failure") for case in read(made.example()).iter("testcase")}
    strong, waits = failures["sparus/wifi"], failures["eca-rov/usbl"]
    assert strong is not None
    assert waits is not None
    assert (strong.get("type"), waits.get("type")) == ("FAIL", "OPEN")
    assert strong.get("message") == "the signal of Sparus overdrives the receiver: -22 dBm, above -35 dBm"
    assert (strong.text or "").endswith("move the antennas apart, or lower `tx_power_dbm`")


def test_nothing_checked_is_an_error() -> None:
    assert names(read(made.empty()), "error") == ["something was checked"]


def test_output_is_reproducible() -> None:
    assert junit(made.example()) == junit(made.example())
