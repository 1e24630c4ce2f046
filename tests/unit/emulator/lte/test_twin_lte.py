import pytest
import trees
from lte_bench import Box

from atlantis_netcfg.emulator.routeros.device import Device
from atlantis_netcfg.emulator.routeros.modem import update_modem
from atlantis_netcfg.emulator.routeros.spec import RouterSpec
from atlantis_netcfg.links.lte import Registration


def test_connected_in_the_home_network() -> None:
    found = Box().read()
    assert found.state is Registration.REGISTERED_HOME
    assert (found.operator, found.band, found.rsrp_dbm, found.rsrq_db, found.sinr_db, found.rssi_dbm) == (
        "EXAMPLE", "B3", -97.0, -9.0, 6.0, -68.0,
    )  # fmt: skip
    assert (found.address, found.roaming, found.network_apn, found.apn) == ("100.72.9.14", False, True, None)


def test_monitor_uses_property_names_of_the_device() -> None:
    known = set(trees.offered()["/interface/lte/monitor proplist"])
    shown = {
        name
        for box in (Box(), Box(pin="73951846"), Box(sim=False), Box(bands=(20,)), Box(denies=True))
        for name in box.rows("/interface/lte/monitor", "numbers=lte1", "once=")[0]
    }
    assert shown <= known
    assert {"imei", "imsi", "iccid"} <= shown


def test_modem_adds_interface_address_and_route() -> None:
    box = Box()
    (row,) = box.rows("/interface/lte/print")
    assert {row[name] for name in ("name", "default-name")} == {"lte1"}
    assert (row["running"], row["allow-roaming"], row["apn-profiles"]) == ("true", "false", "default")
    (address,) = [one for one in box.rows("/ip/address/print") if one["interface"] == "lte1"]
    assert (address["address"], address["dynamic"]) == ("100.72.9.14/32", "true")
    (route,) = [one for one in box.rows("/ip/route/print") if one["gateway"] == "lte1"]
    assert (route["dst-address"], route["distance"], route["dynamic"]) == ("0.0.0.0/0", "2", "true")
    assert [one["type"] for one in box.rows("/interface/print") if one["name"] == "lte1"] == ["lte"]


def test_dynamic_row_cannot_be_removed() -> None:
    box = Box()
    number = next(one[".id"] for one in box.rows("/ip/address/print") if one["interface"] == "lte1")
    assert box.say("/ip/address/remove", f".id={number}")[0].startswith("!trap")


def test_default_route_can_be_disabled() -> None:
    box = Box()
    box.profile("add-default-route=no")
    assert [one for one in box.rows("/ip/route/print") if one["gateway"] == "lte1"] == []


def test_modem_abroad_without_roaming_gets_no_data() -> None:
    box = Box(plmn="20601")
    found = box.read()
    assert (found.state, found.roaming, found.address) == (Registration.REGISTERED_ROAMING, True, None)
    assert box.rows("/interface/lte/print")[0]["running"] == "false"
    box.set("allow-roaming=yes")
    assert box.read().address == "100.72.9.14"
    box.set("allow-roaming=no")
    assert box.read().address is None


def test_network_apn_overrides_the_configured_one() -> None:
    box = Box(apns=("umts",), own_apn="internet")
    assert box.read().address is None
    box.profile("apn=umts")
    assert box.read().address is None
    box.profile("use-network-apn=no")
    found = box.read()
    assert (found.address, found.apn, found.network_apn) == ("100.72.9.14", "umts", False)


def test_registration_needs_matching_band_and_operator() -> None:
    box = Box(bands=(20,))
    box.set("band=3,7")
    assert box.read().state is Registration.SEARCHING
    box.set("band=20")
    assert box.read().state is Registration.REGISTERED_HOME
    box.set("operator=00102")
    assert box.read().state is Registration.SEARCHING


def test_missing_sim_is_read_from_the_log() -> None:
    box = Box(sim=False)
    found = box.read()
    assert (found.state, found.last_error) == (Registration.SIM_MISSING, "+CME ERROR: 10")
    messages = [one["message"] for one in box.rows("/log/print")]
    assert [one for one in messages if one.startswith("lte1")] == ["lte1: sent AT+CPIN?", "lte1: rcvd +CME ERROR: 10"]


def test_denied_and_disabled() -> None:
    assert Box(denies=True).read().state is Registration.DENIED
    box = Box()
    box.set("disabled=yes")
    assert box.read().state is Registration.DISABLED


def test_correct_pin_is_entered_once_and_after_every_reboot() -> None:
    box = Box(pin="73951846")
    assert (box.read().state, box.tries) == (Registration.SIM_PIN_REQUIRED, (3, 0))
    box.set("pin=73951846")
    box.read()
    assert (box.read().state, box.tries) == (Registration.REGISTERED_HOME, (3, 1))
    box.reboot()
    assert (box.read().state, box.tries) == (Registration.REGISTERED_HOME, (3, 2))


def test_a_wrong_pin_costs_a_try_each_time_it_is_entered() -> None:
    box = Box(pin="73951846")
    box.set("pin=99887766")
    found = box.read()
    assert (found.state, found.pin_refused, box.tries) == (Registration.SIM_PIN_REQUIRED, True, (2, 1))
    box.set("comment=nothing")
    assert box.tries == (2, 1)
    box.reboot()
    assert box.read().pin_refused is True
    assert box.tries == (1, 2)
    box.set("pin=")
    assert (box.read().pin_refused, box.tries) == (None, (1, 2))
    box.set("pin=99887766")
    assert (box.read().state, box.tries) == (Registration.SIM_PUK_REQUIRED, (0, 3))
    box.set("pin=73951846")
    assert (box.read().state, box.tries) == (Registration.SIM_PUK_REQUIRED, (0, 3))


def test_sim_tries_survive_an_emulator_restart() -> None:
    box = Box(pin="73951846")
    box.set("pin=99887766")
    again = Device(box.device.spec, lambda: 0.0)
    again.restore({**box.device.snapshot(), "files": {}})
    assert again.core.sim.tries_left == 2


def test_pin_is_hidden_in_export_and_log() -> None:
    box = Box(pin="73951846")
    box.set("pin=73951846")
    box.profile("password=hidden-word")
    assert "73951846" not in box.device.export()
    assert "hidden-word" not in box.device.export()
    assert "73951846" not in " ".join(one["message"] for one in box.rows("/log/print"))
    assert "pin=73951846" in box.device.export(show_sensitive=True)


@pytest.mark.parametrize(
    ("command", "words", "told"),
    [
        ("/interface/lte/add", ("name=lte2",), "no such command"),
        ("/interface/lte/apn/remove", (".id=default",), "failure: cannot remove builtin"),
        ("/interface/lte/set", (".id=lte1", "apn-profiles=nobody"), "input does not match any value of apn-profiles"),
        ("/interface/lte/set", (".id=lte1", "band=B3"), "invalid value for argument band"),
        ("/interface/lte/set", (".id=lte1", "band=99"), "invalid value for argument band"),
        ("/interface/lte/set", (".id=lte1", "network-mode=6g"), "input does not match any value of network-mode"),
        ("/interface/lte/set", (".id=lte1", "sim-slot=a"), "unknown parameter sim-slot"),
        ("/interface/lte/settings/set", ("link-recovery-timer=60",), "unknown parameter link-recovery-timer"),
        ("/interface/lte/monitor", ("numbers=lte9", "once="), "no such item"),
        ("/interface/lte/monitor", ("once=",), "missing"),
        ("/interface/lte/monitor", ("numbers=lte1",), "not rehearsed by the twin: /interface/lte/monitor without once"),
        ("/interface/lte/info", ("number=lte1", "once="), "no such command"),
    ],
)  # fmt: skip
def test_invalid_commands_are_refused(command: str, words: tuple[str, ...], told: str) -> None:
    assert f"=message={told}" in Box().say(command, *words)[0]


def test_link_recovery_timer_exists_in_7_21_5() -> None:
    box = Box(version="7.21.5")
    assert box.say("/interface/lte/settings/set", "link-recovery-timer=60") == ["!done"]


def test_sim_and_network_can_change_while_modem_runs() -> None:
    box = Box()
    core = box.device.core
    assert update_modem(core, {"cell": {"plmn": "20601"}}) == {
        "phase": "registered",
        "tries_left": 3,
        "pins_entered": 0,
    }
    assert box.read().state is Registration.REGISTERED_ROAMING
    assert update_modem(core, {"cell": {"plmn": "00101", "rsrp_dbm": -111}})["phase"] == "connected"
    assert box.read().rsrp_dbm == -111.0
    assert update_modem(core, {"sim": {"pin": "73951846"}})["phase"] == "pin"
    box.set("pin=99887766")
    assert update_modem(core, {}) == {"phase": "pin", "tries_left": 2, "pins_entered": 1}
    assert update_modem(core, {"sim": {"pin": "73951846", "tries": 1}})["phase"] == "puk"
    assert update_modem(core, {"sim": None})["phase"] == "no_sim"
    assert update_modem(core, {"cell": None, "sim": {}})["phase"] == "searching"
    with pytest.raises(ValueError, match="cell"):
        update_modem(core, {"cell": {"colour": "blue"}})
    with pytest.raises(ValueError, match="colour"):
        update_modem(core, {"colour": {}})
    with pytest.raises(LookupError, match="router has no modem"):
        update_modem(Device(RouterSpec(name="router"), lambda: 0.0).core, {})


def test_console_output_matches_the_manual() -> None:
    box = Box()
    typed = [
        box.device.type(box.caller, f"/interface lte {line}") for line in ("monitor lte1 once", "monitor lte9 once")
    ]
    lines = [line.strip() for line in typed[0].text.splitlines()]
    assert {"current-operator: EXAMPLE", "primary-band: B3@20Mhz earfcn: 1300 phy-cellid: 480", "rsrp: -97dBm"} <= set(
        lines
    )
    assert (typed[1].has_failed, typed[1].text) == (True, "no such item")
    assert "roaming-barring: yes" in box.device.type(box.caller, "/interface lte show-capabilities lte1").text


def test_capabilities() -> None:
    assert Box().rows("/interface/lte/show-capabilities", "number=lte1")[0]["roaming-barring"] == "yes"


def test_board_without_modem_has_an_empty_lte_menu() -> None:
    device = Device(RouterSpec(name="router"), lambda: 0.0)
    caller = device.login("provision", "", via="api-ssl", address="10.64.101.10")
    assert [one.kind for one in device.run(caller, ["/interface/lte/print"])] == ["!empty", "!done"]
    assert "tries_left" not in device.snapshot()
