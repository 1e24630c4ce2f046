"""What lies in the hand-out of each system, its DDS files, and the note that is sent along with it."""

import json
import re
import shutil
import subprocess
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from handout_mint import identity
from test_handout_page import CONTACT, KINDS

from atlantis_netcfg.core import language
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.vpn.enrolment_package import OneTimePassphrase, Recipient, build_package, contents, page

NOTES = Path(__file__).with_name("cover_notes")
KEY = "age1ql3z7hjy54pw3hyww5ayyfg7zqgvc7w3j2elw8zmrj2kg5sfn9aqmcac8p"
"""A key that age's own documentation shows."""
_PAGE = {"README.txt", "README.html"}
_XML = {"cyclonedds.xml", "fastdds.xml"}
_LINUX = {"self-test.py", "self-test.json", "ros.env", "setup.bash", *_XML}
FILES = {
    "laptop": {"self-test.ps1", "setup.ps1", *_LINUX},
    "laptop-of-2.4-by-satellite": {"self-test.ps1", "setup.ps1", *_LINUX},
    "robot": {"install.sh", "restart.conf", *_LINUX},
    "robot-foxy": {"install.sh", "restart.conf", *_LINUX},
    "laptop-linux": _LINUX,
    "laptop-ubuntu-desktop": _LINUX,
    "laptop-windows": {"self-test.ps1", "self-test.json", "setup.ps1", *_XML},
    "laptop-macos": {"self-test.py", "self-test.json", "setup.bash", *_XML},
    "laptop-android": set(),
    "laptop-ios": set(),
    "router": {"vtt-router1.rsc"},
    "host": set(),
}


@pytest.fixture(scope="module")
def declaration() -> Inventory:
    return load(Path(__file__).parents[4] / "inventory")


@pytest.mark.parametrize("kind", KINDS)
def test_package_contains_the_files_of_each_system(kind: str, declaration: Inventory) -> None:
    told = contents(declaration, identity(KINDS[kind]), contact=CONTACT)
    key_file = f"{KINDS[kind].name}.{'identity' if kind == 'host' else 'ovpn'}"
    assert set(told) == {key_file, *_PAGE, *FILES[kind]}
    assert next(iter(told)) == key_file
    listed = re.findall(r"^- (\S+): ", told["README.txt"].rpartition("The files\n")[2], re.MULTILINE)
    assert listed == list(told)


@pytest.mark.parametrize("kind", KINDS)
def test_package_contains_no_pictures(kind: str, declaration: Inventory) -> None:
    """A code to scan would be a key that everybody may photograph."""
    told = contents(declaration, identity(KINDS[kind]), contact=CONTACT)
    assert not any(re.search(r"<img|<svg|data:image|\u2588", text) for text in told.values())


@pytest.mark.parametrize("kind", KINDS)
def test_cover_note_matches_the_golden_file_without_keys(kind: str, declaration: Inventory) -> None:
    given = identity(KINDS[kind])
    made = build_package(declaration, given, Recipient(KEY), contact=CONTACT)
    note = made.cover_note.replace(made.sha256, "SHA256")
    assert note == (NOTES / f"{kind}.txt").read_text()
    assert made.sha256 in made.cover_note
    keys = f"{given.key.reveal()}{given.wrap_key.reveal()}"
    secrets = [line for line in keys.splitlines() if line.strip("0123456789abcdef") and "-" not in line]
    assert not any(secret in note for secret in secrets)


def test_cover_note_does_not_contain_the_passphrase(declaration: Inventory) -> None:
    made = build_package(declaration, identity(), OneTimePassphrase(), contact=CONTACT)
    assert made.passphrase is not None
    assert "You need the passphrase of 25 digits." in made.cover_note
    assert "--identity" not in made.cover_note
    assert made.passphrase.reveal() not in made.cover_note
    assert re.search(r"[0-9]{5}-[0-9]{5}", made.cover_note) is None


SHELLS = ["bash", "sh", *filter(shutil.which, ["zsh"])]
DDS = [kind for kind, files in FILES.items() if "cyclonedds.xml" in files]


@pytest.mark.parametrize("kind", DDS)
def test_dds_profiles_list_the_peers_of_the_member(kind: str, declaration: Inventory) -> None:
    told = contents(declaration, identity(KINDS[kind]), contact=CONTACT)
    cyclone, fast = (ET.fromstring(told[name]) for name in ("cyclonedds.xml", "fastdds.xml"))  # noqa: S314 - our own
    peers = [peer.attrib["Address"] for peer in cyclone.iter("{https://cdds.io/config}Peer")]
    addresses = [item.text for item in fast.iter("{http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles}address")]
    page = told["README.txt"].partition("ROS 2 and DDS\n")[2].partition("Renewal")[0]
    listed = re.findall(r"^- \S+: ([\d.]+)$", page, re.MULTILINE)
    assert peers == [KINDS[kind].address, *listed]
    assert addresses == [KINDS[kind].address, *peers]
    assert "10.80.0.2" in listed
    assert "AllowMulticast>false<" in told["cyclonedds.xml"]


@pytest.mark.parametrize(
    ("kind", "version", "element"),
    [
        ("robot-foxy", "Cyclone DDS 0.7", "NetworkInterfaceAddress"),
        ("laptop-macos", "Cyclone DDS 0.10", "Interfaces"),
        ("laptop-ubuntu-desktop", "Cyclone DDS 0.10", "Interfaces"),
        ("laptop", "Cyclone DDS 0.7", "NetworkInterfaceAddress"),
    ],
)
def test_dds_profile_matches_the_release(kind: str, version: str, element: str, declaration: Inventory) -> None:
    told = contents(declaration, identity(KINDS[kind]), contact=CONTACT)
    assert f"<{element}>" in told["cyclonedds.xml"]
    assert version in told["cyclonedds.xml"]
    assert version in " ".join(told["README.txt"].split())


@pytest.mark.parametrize("shell", SHELLS)
def test_shell_can_source_the_dds_settings(shell: str, declaration: Inventory, tmp_path: Path) -> None:
    """Beside the profiles by their folder; a shell that does not know where it reads from takes the installed ones."""
    folder = tmp_path / "with a blank"
    folder.mkdir()
    told = contents(declaration, identity(KINDS["robot"]), contact=CONTACT)
    for name, text in told.items():
        (folder / name).write_text(text)
    script = 'set -eu; . "$1/setup.bash"; env'
    done = subprocess.run([shell, "-c", script, "-", str(folder)], capture_output=True, text=True, check=True)
    found = dict(line.partition("=")[::2] for line in done.stdout.splitlines())
    services = dict(line.split("=", 1) for line in told["ros.env"].splitlines() if not line.startswith("#"))
    assert {name: found[name] for name in services} == {
        name: value.replace("/etc/atlantis/dds", str(folder) if shell != "sh" else "/etc/atlantis/dds")
        for name, value in services.items()
    }
    assert "_atlantis_dds" not in found


@pytest.mark.parametrize("kind", ["robot", "robot-foxy"])
def test_install_sh_has_valid_shell_syntax(kind: str, declaration: Inventory) -> None:
    """Its grammar; tests/integration/vpn/clients run it."""
    text = contents(declaration, identity(KINDS[kind]), contact=CONTACT)["install.sh"]
    for shell in ("sh", "bash"):
        subprocess.run([shell, "-n"], input=text, text=True, check=True)
    assert ("2.4) stop" in text) == (kind == "robot")


def test_html_page_declares_its_language(declaration: Inventory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(language, "_current_language", language.Language.PORTUGUESE)
    told = contents(declaration, identity(), contact=CONTACT)
    assert '<html lang="pt-PT">' in told["README.html"]
    assert json.loads(told["self-test.json"])["name"] == "inesc-laptop1"


@pytest.mark.parametrize("kind", ["robot", "laptop-windows"])
def test_everything_except_commands_is_translated(
    kind: str, declaration: Inventory, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Block by block: a heading, a paragraph, an item of a list is one message, without line breaks."""
    messages: list[str] = []

    def translate(text: str) -> str:
        messages.append(text)
        return f"{text} ~"

    plain = contents(declaration, identity(KINDS[kind]), contact=CONTACT)
    monkeypatch.setattr(page, "translate", translate)
    told = contents(declaration, identity(KINDS[kind]), contact=CONTACT)
    assert not [message for message in messages if "\n" in message or message.startswith(("- ", " "))]
    typed = [line for line in plain["README.txt"].splitlines() if line.startswith("    ")]
    assert [line for line in told["README.txt"].splitlines() if line.startswith("    ")] == typed != []
    blocks = [block for block in told["README.txt"].strip().split("\n\n") if not block.startswith("    ")]
    assert [block for block in blocks if not block.rstrip("=-\n").endswith("~")] == []
    title, line = blocks[0].splitlines()
    assert len(title) == len(line)
    keyed = f"{KINDS[kind].name}.ovpn"
    others = [name for name in plain if name != keyed and "README" not in name]
    assert {name: told[name] for name in others if name != "self-test.json"} == {
        name: plain[name] for name in others if name != "self-test.json"
    }
