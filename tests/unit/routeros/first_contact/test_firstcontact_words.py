"""What a person is told, word for word: the golden files beside."""

from dataclasses import replace
from pathlib import Path

import pytest
from found import WISH, facts

from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.routeros.first_contact.run import Objection, features_of, objections
from atlantis_netcfg.routeros.rsc import parse

GOLDEN = Path(__file__).with_name("golden")
HOME = {"mode": "home", "flagged": "false", "scheduler": "false", "proxy": "false"}

CASES = {
    "device-mode-home": (
        facts(device_mode=HOME),
        replace(WISH, features={"scheduler": "/system/scheduler", "proxy": "/ip/proxy"}),
    ),
    "device-mode-flagged": (facts(device_mode={**HOME, "flagged": "true"}), WISH),
    "wrong-box": (facts(board="hEX S", architecture="mmips"), replace(WISH, model="RB5009UPr+S+IN")),
    "wrong-ports": (facts(ethernets=facts().ethernets[:5]), WISH),
    "radio-without-package": (
        facts(board="SXTsq 5 ac", architecture="arm", version=Version(7, 16, 2)),
        replace(WISH, radio=True),
    ),
    "too-old": (facts(version=Version(6, 48, 6)), WISH),
}


@pytest.mark.parametrize("case", CASES)
def test_objections_match_the_golden_text(case: str) -> None:
    said = "".join(f"{one.message}\n{one.hint}\n" for one in objections(*CASES[case]))
    assert said == (GOLDEN / f"{case}.txt").read_text()


def test_every_golden_file_is_of_a_case() -> None:
    assert {path.stem for path in GOLDEN.iterdir()} == CASES.keys()


def test_suitable_device_has_no_objections() -> None:
    assert objections(facts(), replace(WISH, model="RB5009UPr+S+IN", features={"scheduler": "/x"})) == ()
    assert objections(facts(packages=("routeros", "wireless")), replace(WISH, radio=True)) == ()
    assert objections(facts(version=Version(7, 12, 1)), replace(WISH, radio=True)) == ()
    assert objections(facts(device_mode=None), replace(WISH, features={"scheduler": "/x"})) == ()


def test_all_objections_are_reported_at_once() -> None:
    found = objections(facts(board="hEX", ethernets=(), version=Version(6, 40)), replace(WISH, model="RB5009"))
    assert all(isinstance(one, Objection) for one in found)
    assert len(found) == 3


@pytest.mark.parametrize(
    ("text", "needed"),
    [
        ("/system scheduler\nadd name=a\n", {"scheduler": "/system/scheduler"}),
        ("/system scheduler\nadd disabled=yes name=a\n", {}),
        ("/ip proxy\nset enabled=yes\n", {"proxy": "/ip/proxy"}),
        ("/ip proxy\nset enabled=no\n", {}),
        ("/interface ovpn-client\nadd name=a\n", {}),
    ],
)
def test_required_features_of_a_text(text: str, needed: dict[str, str]) -> None:
    assert features_of(parse(text)) == needed
