"""What no program on every computer can be compared with: iw, timedatectl, chronyc, and what is not there."""

from pathlib import Path
from typing import Any

import pytest

from atlantis_netcfg.checklist.probes import CommandResult, wifi
from atlantis_netcfg.core.reading_programs import PROGRAMS, is_allowed
from atlantis_netcfg.emulator import linux
from atlantis_netcfg.inventory import load
from atlantis_netcfg.records.asbuilt import computer as record

NOW = 1795341600.0
BSSID = "02:00:5E:00:FD:01"
HEARD = linux.AssociationSpec(ssid="EXAMPLE-SPARUS", bssid=BSSID, frequency_mhz=5500, rate_mbps=144.4)


def spec(**changes: Any) -> linux.ComputerSpec:  # noqa: ANN401 - fields of ComputerSpec
    made = linux.lan_computer(
        "gateway",
        address="10.64.1.10/24",
        mac="02:00:5E:00:01:10",
        router=("10.64.1.1", "02:00:5E:00:FF:01"),
        others={"10.64.1.23": "02:00:5E:00:01:23"},
    )
    return made.model_copy(update=changes)


def radio(**changes: Any) -> linux.ComputerSpec:  # noqa: ANN401 - fields of InterfaceSpec
    own: dict[str, Any] = {"name": "wlan1", "mac": "02:00:5E:00:FE:01", "wireless": True, "association": HEARD}
    return spec(interfaces=(*spec().interfaces, linux.InterfaceSpec(**{**own, **changes})))


def out(made: linux.ComputerSpec, words: str) -> str:
    rc, told, errors = linux.Computer(made, lambda: NOW).answer(words.split())
    assert (rc, errors) == (0, "")
    return told


def test_an_association_is_read_from_what_iw_prints() -> None:
    link = wifi.read_link(out(radio(), "iw dev wlan1 link"))
    assert link == wifi.WifiLink(
        bssid=BSSID, ssid="EXAMPLE-SPARUS", frequency_mhz=5500, signal_dbm=-52.0, rx_mbps=144.4, tx_mbps=144.4
    )
    station = wifi.read_station(out(radio(), "iw dev wlan1 station dump"), BSSID)
    assert station == wifi.Station(signal_dbm=-52.0, chains_dbm=(-54.0, -55.0), rx_mbps=144.4, tx_mbps=144.4)
    told = out(radio(), "iw dev wlan1 info")
    assert (wifi.read_type(told), wifi.read_width(told)) == ("managed", 20)
    assert "channel 100 (5500 MHz)" in told
    assert wifi.read_rules(out(radio(), "iw reg get")).countries == ("PT",)


@pytest.mark.parametrize("changes", [{"association": None}, {"up": False}])
def test_radio_without_access_point_has_no_link(changes: dict[str, Any]) -> None:
    assert wifi.read_link(out(radio(**changes), "iw dev wlan1 link")) == wifi.WifiLink()
    assert out(radio(**changes), "iw dev wlan1 station dump") == ""


def test_radio_can_be_an_access_point_on_2_4_ghz() -> None:
    heard = HEARD.model_copy(update={"frequency_mhz": 2437})
    told = out(radio(type="AP", association=heard), "iw dev wlan1 info")
    assert wifi.read_type(told) == "AP"
    assert "channel 6 (2437 MHz)" in told


@pytest.mark.parametrize("name", ["eth0", "wlan7"])
def test_iw_rejects_an_interface_that_is_no_radio(name: str) -> None:
    assert linux.Computer(radio()).answer(["iw", "dev", name, "link"])[0] == 237


@pytest.mark.parametrize(
    ("time", "lines"),
    [
        (linux.TimeSpec(), ("Timezone=Europe/Lisbon", "NTPSynchronized=yes", "TimeUSec=Sun 2026-11-22 10:00:00 WET")),
        (linux.TimeSpec(is_synchronised=False, ntp=False), ("NTP=no", "NTPSynchronized=no")),
        (linux.TimeSpec(offset_s=-3600, zone="Etc/UTC"), ("Timezone=Etc/UTC", "TimeUSec=Sun 2026-11-22 09:00:00 UTC")),
    ],
    ids=("healthy", "not set", "behind"),
)
def test_timedatectl_output(time: linux.TimeSpec, lines: tuple[str, ...]) -> None:
    assert set(lines) <= set(out(spec(time=time), "timedatectl show").splitlines())


def test_chronyc_output() -> None:
    told = out(spec(), "chronyc -n -c tracking").strip().split(",")
    assert (len(told), told[1], told[2], told[-1]) == (14, "192.0.2.123", "3", "Normal")
    lost = out(spec(time=linux.TimeSpec(is_synchronised=False)), "chronyc -n -c tracking").strip().split(",")
    assert (len(lost), lost[2], lost[-1]) == (14, "0", "Not synchronised")
    assert out(spec(), "chronyc -n -c sources").startswith("^,*,192.0.2.123,")
    stopped = linux.Computer(spec(time=linux.TimeSpec(chrony=False))).answer(["chronyc", "-n", "-c", "tracking"])
    assert stopped == (1, "", "506 Cannot talk to daemon\n")


def test_clock_has_the_configured_offset() -> None:
    assert linux.Computer(spec(time=linux.TimeSpec(offset_s=-2.5)), lambda: NOW).now == NOW - 2.5


@pytest.mark.parametrize("words", ["openssl version", "ethtool eth0", "rm -rf /"])
def test_missing_program_is_not_found(words: str) -> None:
    computer = linux.Computer(spec(lacks=("openssl",)))
    program = words.split(maxsplit=1)[0]
    assert computer.answer(words.split()) == (127, "", f"sh: 1: {program}: not found\n")
    assert computer.inputs == [tuple(words.split())]


@pytest.mark.parametrize(
    "words",
    [
        *("ip", "ip -j tunnel show", "iw dev", "iw dev wlan1 scan", "timedatectl set-ntp no"),
        *("chronyc -n -c makestep", "openssl genrsa", "cat /etc/shadow", "ip -j route get"),
    ],
)
def test_unsupported_command_fails_with_an_error(words: str) -> None:
    rc, told, errors = linux.Computer(radio()).answer(words.split())
    assert rc != 0
    assert not told
    assert errors


def test_unreadable_files_are_refused() -> None:
    made = spec(unreadable_paths=("/etc/secret",))
    assert linux.Computer(made).answer(["cat", "/etc/secret"]) == (1, "", "cat: /etc/secret: Permission denied\n")
    assert linux.Computer(made).answer(["openssl", "storeutl", "/etc/secret"])[0] == 1


def test_dhcp_offers_by_interface_name_or_address() -> None:
    own = linux.OfferSpec(server="10.64.1.1", mac="02:00:5E:00:FF:01", address="10.64.1.100", router="10.64.1.1")
    assert linux.Computer(spec()).offers("eth0") == linux.Computer(spec()).offers("10.64.1.10") == (own,)
    assert linux.Computer(spec()).offers("wlan9") is None
    assert linux.Computer(spec()).offers("10.64.1.77") is None
    down = spec().interfaces[0].model_copy(update={"up": False})
    assert linux.Computer(spec(interfaces=(down,))).offers("eth0") == ()


def test_lost_pings_and_unreachable_destinations() -> None:
    lossy = {name: echo.model_copy(update={"loss_percent": 25}) for name, echo in spec().echoes.items()}
    told = out(spec(echoes=lossy), "ping -n -c 20 -i 0.2 -W 2 10.64.1.23")
    assert "20 packets transmitted, 15 received, 25% packet loss, time 3800ms" in told
    assert "time=1.50 ms" in told
    nobody = linux.Computer(spec()).answer(["ping", "-n", "-c", "20", "-i", "0.2", "-W", "2", "10.64.1.99"])
    assert nobody[0] == 1
    assert "20 packets transmitted, 0 received, +20 errors, 100% packet loss" in nobody[1]
    lost = linux.Computer(spec(routes=())).answer(["ping", "-n", "-c", "1", "-W", "1", "192.0.2.7"])
    assert lost == (2, "", "ping: connect: Network is unreachable\n")
    assert linux.Computer(spec()).answer(["ping", "-n", "-c", "1", "-W", "1", "192.0.2.7"])[0] == 1


def test_specification_survives_json_and_rejects_unknown_keys() -> None:
    assert linux.ComputerSpec.model_validate_json(radio().model_dump_json()) == radio()
    with pytest.raises(ValueError, match="extra"):
        linux.ComputerSpec.model_validate({"interfaces": (), "moods": "bad"})


KEY = "AAAAC3NzaC1lZDI1NTE5AAAAIFKQGZBNVvtFUBKh9M3hn32GLhs4YL2nAOVhTh+/LFUl"
"""Of a key that was made for this test; its fingerprint is what ssh-keygen printed."""
FINGERPRINT = "SHA256:XhBHTQ+nz92L4eFwdj6n8mzbg1usmFgKSFlwNPGDwUo"
HOST_KEY = "/etc/ssh/ssh_host_ed25519_key.pub"


def test_as_built_record_reads_facts_of_an_emulated_computer() -> None:
    """The questions of the as-built record, and its reading of what the twin prints."""
    host = load(Path(__file__).parents[4] / "inventory").hosts["coastal-gateway"]
    files = {
        "/etc/os-release": 'NAME="Debian"\nPRETTY_NAME="Debian GNU/Linux 12 (bookworm)"\n',
        "/proc/device-tree/model": "EXAMPLE board\0",
        HOST_KEY: f"ssh-ed25519 {KEY} root@gateway\n",
    }
    made = linux.Computer(spec(files=files, packages={"chrony": "4.3-2+deb12u1", "bash": "5.2.15-2+b8"}))
    packages = ("chrony", "gpsd")
    printed = {name: made.answer(question.argv) for name, question in record.questions(host, packages)}
    lines = "chrony=4.3-2+deb12u1=installed\n"
    assert printed["packages"] == (1, lines, "dpkg-query: no packages found matching gpsd\n")
    answers = {name: CommandResult(None, "", *answer) for name, answer in printed.items()}
    facts = record.read(host, answers, packages, {})
    assert facts.packages == {"chrony": "4.3-2+deb12u1", "gpsd": record.NOT_INSTALLED}
    assert {name: fact.value for name, fact in facts.facts.items()} == {
        "model": "EXAMPLE board",
        "serial": None,
        "os": "Debian GNU/Linux 12 (bookworm)",
        "kernel": "6.1.0-28-arm64 aarch64",
        "host_key": FINGERPRINT,
    }
    assert facts.missing == ()
    assert [port.name for port in facts.ports] == ["eth0"]


@pytest.mark.parametrize(
    ("words", "answer"),
    [
        ("uname", (0, "Linux\n", "")),
        ("uname -m -r", (0, "6.1.0-28-arm64 aarch64\n", "")),
        ("uname -rz", (1, "", "uname: invalid option -- 'z'\nTry 'uname --help' for more information.\n")),
        ("uname now", (1, "", "uname: extra operand 'now'\nTry 'uname --help' for more information.\n")),
        (f"ssh-keygen -l -f {HOST_KEY}", (255, "", f"ssh-keygen: {HOST_KEY}: No such file or directory\r\n")),
        ("ssh-keygen -l -f /etc/secret", (255, "", "ssh-keygen: /etc/secret: Permission denied\r\n")),
        ("ssh-keygen -l -f /etc/resolv.conf", (255, "", "/etc/resolv.conf is not a public key file.\r\n")),
        ("dpkg-query -W", (0, "bash\t5.2.15-2+b8\nchrony\t4.3-2\n", "")),
        ("dpkg-query -W -f=${Package}:${Version}\\n bash", (0, "bash:5.2.15-2+b8\n", "")),
        ("dpkg-query -W -f=${Package}\\n zzz", (1, "", "dpkg-query: no packages found matching zzz\n")),
        (
            "dpkg-query --foo",
            (2, "", "dpkg-query: error: unknown option --foo\n\nUse --help for help about querying packages.\n"),
        ),
    ],
)
def test_commands_answer_like_the_real_programs(words: str, answer: tuple[int, str, str]) -> None:
    made = spec(unreadable_paths=("/etc/secret",), packages={"chrony": "4.3-2", "bash": "5.2.15-2+b8"})
    assert linux.Computer(made).answer(words.split()) == answer


def test_every_allowed_program_is_emulated() -> None:
    programs = {words.split()[0] for words in PROGRAMS}
    made = linux.Computer(spec())
    assert {program for program in programs if made.answer((program,))[0] == 127} == set()
    assert not is_allowed(("sh", "-c", "true"))
