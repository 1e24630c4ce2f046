"""`provision inventory init` at a real terminal, answered by a script: valid, rehearsed, without example."""

import os
import select
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from hints_said import advised
from schema_reader import files, problems, schema_of
from waiting import HANG_S

pytestmark = pytest.mark.slow

AT_A_TERMINAL = """
import fcntl, os, signal, sys, termios
signal.signal(signal.SIGINT, signal.SIG_DFL)
signal.signal(signal.SIGHUP, signal.SIG_DFL)
os.setsid()
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execv(sys.executable, [sys.executable, "-m", "atlantis_netcfg", *sys.argv[1:]])
"""
KEY = "ssh-ed25519 AAAAC3NzaC1lZDI1NTE5AAAAIOzMkrV3HHY+skvjB+3Dgsy6+gi2Qp9FkJyNvsHCouP1 technician"
PLACE = ("Name in everyday use", "Local network", "Network of the management port", "DNS suffix", "Ethernet ports")
PILOT = [
    ("Ask for networks, ports, radio details and rates as well?", "yes"),
    ("Name of the pilot", "Douro"),
    ("Country of the radios", "brazil"),  # refused: it is asked again
    ("Country of the radios", "portugal"),
    ("Time zone", ""),
    ("Addresses of time servers", "172.31.0.5"),
    ("ROS 2 of the gateways", "humble"),
    ("Partners in the VPN", "inesc, eca"),
    ("Public address of the VPN", "172.31.0.2"),
    ("DNS name of the VPN", "vpn.douro.internal"),
    ("Tunnel addresses", "10.90.0.0/16"),
    ("Its short name", "centre"),
    *zip(PLACE, ("", "10.20.0.0/24", "10.20.100.0/24", "centre.douro.internal", "5"), strict=True),
    ("Network between router and provider", "172.31.0.0/29"),
    ("The router's address", ""),
    ("The provider's box", ""),
    ("Round trip in ms", "9 90000 90000"),
    ("Is there a computer for its services?", "yes"),
    ("Short names of the test sites", "pier, boat"),
]
PIER = [
    *zip(PLACE, ("Pier", "10.20.1.0/24", "10.20.101.0/24", "pier.douro.internal", "8"), strict=True),
    ("Is there a Wi-Fi bridge", "no"),
    ("Is there a cable", "no"),
    ("Is there a 4G unit", "yes"),
    ("Network between router and 4G unit", "10.21.1.0/29"),
    ("Unit (routeros", "routeros"),
    ("APN of the SIM", "douro.net"),
    ("Price of the contract", "0.01"),
    ("Two addresses beyond the link", "172.31.9.3, 172.31.9.4"),
    ("Round trip in ms", "50 10000 20000"),
    ("Is there a satellite terminal", "yes"),
    ("Network between router and terminal", "10.21.2.0/29"),
    ("Price of the contract", ""),
    ("Is there a data gateway computer", "no"),
]
BOAT = [
    *zip(PLACE, ("", "10.20.2.0/24", "10.20.102.0/24", "boat.douro.internal", "8"), strict=True),
    ("Is there a Wi-Fi bridge", "yes"),
    ("Network of the bridge", "10.21.3.0/29"),
    ("Name of the radio network", "douro-ptp"),
    ("Protocol of the radios", ""),
    ("Frequency in MHz", "5560"),
    ("Distance in metres", "300"),
    ("Gain of the antennas", "16"),
    ("Power of the radios", "12"),
    ("Two addresses beyond the link", ""),
    ("Round trip in ms", "5 40000 40000"),
    ("Is there a cable", "no"),
    ("Is there a 4G unit", "no"),
    ("Is there a satellite terminal", "no"),
    ("Is there a data gateway computer", "yes"),
    ("A technician's public SSH key", KEY),
]

USUAL = [
    ("Ask for networks, ports, radio details and rates as well?", ""),
    ("Name of the pilot", "Douro"),
    ("Country of the radios", "portugal"),
    ("ROS 2 of the gateways", "humble"),
    ("Partners in the VPN", "1, 3, Blue Ocean"),
    ("Public address of the VPN", "172.31.0.2"),
    ("DNS name of the VPN", "vpn.douro.internal"),
    ("Short names of the test sites", "pier"),
    ("Local network", "10.20.1.0/24"),
    ("Is there a Wi-Fi bridge", "yes"),
    ("Name of the radio network", "douro-ptp"),
    ("Frequency in MHz", "5560"),
    ("Power of the radios", "12"),
    ("Is there a cable", "yes"),
    ("Network between router and provider", "172.31.0.0/29"),
    ("Is there a 4G unit", "yes"),
    ("Unit (routeros", "routeros"),
    ("APN of the SIM", "douro.net"),
    ("Price of the contract", "0,01"),
    ("Is there a satellite terminal", "yes"),
    ("Price of the contract", "2,5"),
    ("Is there a data gateway computer", "yes"),
    ("A technician's public SSH key", KEY),
    ("Choose a password for the inventory vault", "of a test"),
    ("The same again", "of a test"),
]
"""A site with everything, with the answers that only its people know."""


def typed(
    words: Sequence[str],
    answers: Sequence[tuple[str, str]],
    environment: dict[str, str],
    end: tuple[str, bytes] | None = None,
) -> tuple[int, str]:
    """Type a command at a terminal of its own, and an answer to each question when it is there.

    `end` is a last question and the key that is pressed at it; without a key the terminal is closed.
    """
    ours, theirs = os.openpty()
    command = [sys.executable, "-P", "-c", AT_A_TERMINAL, *words]
    process = subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs, env=environment)
    os.close(theirs)
    seen, unread = "", ""
    lines = [(question, f"{answer}\n".encode(errors="surrogateescape")) for question, answer in answers]
    for question, keys in [*lines, *([] if end is None else [end])]:
        while question not in unread:
            ready, _, _ = select.select([ours], [], [], HANG_S)
            assert ready, f"`{question}` was never asked: {unread}"
            unread += (more := os.read(ours, 4096).decode(errors="replace"))
            seen += more
        unread = unread.partition(question)[2]
        if not keys:
            os.close(ours)
            return process.wait(HANG_S), seen.replace("\r\n", "\n")
        os.write(ours, keys)
    while True:
        # A signal between the prompt and the read is noticed only at the next key, so a person presses it again.
        if end is not None and not select.select([ours], [], [], 1)[0]:
            os.write(ours, end[1])
            continue
        try:
            more = os.read(ours, 4096).decode(errors="replace")
        except OSError:  # Linux tells so that nobody has it open any more
            break
        if not more:
            break
        seen += more
    os.close(ours)
    return process.wait(HANG_S), seen.replace("\r\n", "\n")


def run(words: Sequence[str], environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-P", "-m", "atlantis_netcfg", *words]
    return subprocess.run(
        command, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False
    )


@pytest.fixture(name="environment")
def _environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    monkeypatch.chdir(tmp_path)
    password = tmp_path / "vault-password"
    password.write_text("of a test\n", encoding="utf-8")
    return {
        **os.environ,
        "ATLANTIS_STATE": str(tmp_path / "state"),
        "ANSIBLE_VAULT_PASSWORD_FILE": str(password),
        "LC_ALL": "C.UTF-8",
        "TERM": "dumb",
    }


@pytest.mark.smoke
def test_new_inventory_validates_is_rehearsed_and_is_not_overwritten(
    tmp_path: Path, environment: dict[str, str]
) -> None:
    code, seen = typed(["inventory", "init", "douro"], [*PILOT, *PIER, *BOAT], environment)
    assert code == 0, seen
    assert "`brazil` is not a valid value for `country`: available: later, portugal" in " ".join(seen.split())
    assert "EXAMPLE" not in seen.rpartition("technician")[2]
    last = seen.splitlines()[-4:]
    assert last[0] == "douro: written and validated, no errors, 10 hosts at 3 sites"
    assert max(map(len, last)) <= 80

    checked = run(["inventory", "validate", "inventory=douro", "--examples"], environment)
    assert (checked.returncode, checked.stderr) == (0, "")
    assert checked.stdout.splitlines()[0] == "douro: no errors"
    assert checked.stdout.splitlines()[-1] == "No example values are left."
    assert "EXAMPLE" not in "".join(path.read_text(encoding="utf-8") for path in files(tmp_path / "douro"))

    for path in files(tmp_path / "douro"):
        schema = schema_of(path)
        assert schema is not None
        assert schema.parent == tmp_path / "douro/.schema"
        assert problems(path, schema) == [], path

    before = {path: path.read_bytes() for path in files(tmp_path / "douro")}
    code, seen = typed(["inventory", "init", "douro"], [], environment)
    assert code == 3
    assert "douro is not empty, so nothing was written" in seen
    assert before == {path: path.read_bytes() for path in files(tmp_path / "douro")}

    (words,) = advised(last[-1])
    assert words == ["site=pier", "--rehearse", "inventory=douro"]
    rehearsed = run([*words, "--yes"], environment)
    assert rehearsed.returncode == 0, rehearsed.stdout + rehearsed.stderr
    assert "pier-router" in rehearsed.stdout
    assert "actions applied and verified" in rehearsed.stdout
    assert "example" not in rehearsed.stdout + rehearsed.stderr


def test_a_site_with_everything_takes_at_most_25_questions(tmp_path: Path, environment: dict[str, str]) -> None:
    assert len(USUAL) <= 25
    del environment["ANSIBLE_VAULT_PASSWORD_FILE"]
    code, seen = typed(["inventory", "init", "douro"], USUAL, environment)
    assert code == 0, seen
    assert "douro: written and validated, no errors, 9 hosts at 2 sites" in seen
    assert sum(line.endswith("]:") or "]: " in line for line in seen.splitlines()) <= 25
    pilot = (tmp_path / "douro/group_vars/pier.yml").read_text(encoding="utf-8")
    assert "price_per_mb: 0.01" in pilot
    assert "price_per_mb: 2.5" in pilot
    checked = run(["inventory", "validate", "inventory=douro"], environment)
    assert checked.returncode == 0
    assert "examples" in checked.stdout


@pytest.mark.parametrize("stop", ["Ctrl-C", "Ctrl-D", "hang up"])
def test_a_stopped_init_goes_on_where_it_stopped(tmp_path: Path, environment: dict[str, str], stop: str) -> None:
    end = {"Ctrl-C": b"\x03", "Ctrl-D": b"\x04", "hang up": b""}[stop]
    answers = [*PILOT, *PIER, *BOAT]
    code, seen = typed(["inventory", "init", "douro"], answers[:31], environment, (answers[31][0], end))
    assert code != 0
    assert "Traceback" not in seen
    assert not (tmp_path / "douro").exists()
    (kept,) = (tmp_path / "state/init").iterdir()
    assert kept.stat().st_mode & 0o777 == 0o600
    assert kept.parent.stat().st_mode & 0o777 == 0o700

    code, seen = typed(["inventory", "init", "douro"], [("Continue with them?", ""), *answers[31:]], environment)
    assert code == 0, seen
    assert "30 answers are saved from the last session." in seen
    assert "Name of the pilot" not in seen
    assert seen.splitlines()[-4] == "douro: written and validated, no errors, 10 hosts at 3 sites"
    assert not kept.exists()


def test_kept_answers_are_removed_when_the_person_starts_again(tmp_path: Path, environment: dict[str, str]) -> None:
    typed(["inventory", "init", "douro"], PILOT[:5], environment, (PILOT[5][0], b"\x03"))
    (kept,) = (tmp_path / "state/init").iterdir()
    again = [("Continue with them?", "no"), PILOT[0], ("Name of the pilot", "Tejo")]
    code, seen = typed(["inventory", "init", "./douro"], again, environment, ("Country", b"\x03"))
    assert code != 0
    assert "interrupted by Ctrl-C; nothing was changed" in seen
    assert "Tejo" in kept.read_text(encoding="utf-8")
    assert "Douro" not in kept.read_text(encoding="utf-8")
    (tmp_path / "douro").mkdir()
    (tmp_path / "douro/letter.txt").touch()
    code, seen = typed(["inventory", "init", "douro"], [], environment)
    assert code == 3
    assert "douro is not empty" in seen


def test_hostile_input_is_refused_and_asked_again(environment: dict[str, str]) -> None:
    name = "Name of the pilot"
    hostile = ["", "a" * 4000, "\x1b[31mred", "a\x07b", "\udcff\udcfe", "\u202egnp"]
    answers = [PILOT[0], *((name, text) for text in hostile), (name, "Douro")]
    code, seen = typed(["inventory", "init", "douro"], answers, environment, ("Country", b"\x04"))
    assert code == 3
    assert "Traceback" not in seen
    assert "An answer has at most 2000 characters." in seen
    assert seen.count("The answer contains unprintable characters: type it again.") == 4
    assert "run the command again: it offers to continue where it stopped" in seen


def test_a_state_directory_that_cannot_be_written_keeps_nothing(tmp_path: Path, environment: dict[str, str]) -> None:
    (tmp_path / "state").touch()
    code, seen = typed(["inventory", "init", "douro"], PILOT[:2], environment, ("Country", b"\x04"))
    assert code == 3
    assert "Your answers cannot be saved if you stop" in seen
    assert "Traceback" not in seen
    assert seen.rstrip().endswith("run the command again")
