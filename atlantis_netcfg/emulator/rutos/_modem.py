"""What the twin's modem and card do, and how the unit tells it.

[inferred]: when the unit tries the saved PIN (here: at every reload while the card asks for one, the worst that a
caller can meet), and that a foreign network with roaming denied leaves the unit registered without a connection.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.rutos._spec import RutosSpec
    from atlantis_netcfg.emulator.rutos._web import Uci

ADDRESS = "100.64.12.34"
"""What the network gives: carrier NAT (RFC 6598)."""
_NEW = {"state": "data_conn_state", "netstate": "operator_state", "oper": "operator", "signal": "rssi"}
"""Field names of the record in devices.md to those of newer firmware."""


class Modem:
    """Card, network, and the settings that the unit has read last."""

    def __init__(self, spec: RutosSpec, uci: Uci) -> None:
        self._spec = spec
        self._uci = uci
        self._tries = spec.sim.tries if spec.sim is not None else 0
        self._locked = spec.sim is not None and spec.sim.pin is not None
        self.attempts = 0
        """PINs that the card was given."""
        self.settings: dict[str, str] = {}
        self.reload()

    def reload(self) -> None:
        """Read the committed settings, and try the saved PIN if the card asks for one."""
        interface = next((item for item in self._uci.saved("network", "interface") if item.get("sim") == "1"), {})
        slot = next((row for row in self._uci.saved("simcard", "sim") if row.get("position") == "1"), {})
        self.settings = interface | slot
        sim = self._spec.sim
        saved = slot.get("pincode")
        if sim is not None and self._locked and self._tries and saved:
            self.attempts += 1
            if saved == sim.pin:
                self._locked, self._tries = False, 3
            else:
                self._tries -= 1

    @property
    def registration(self) -> str:
        """In the unit's words."""
        spec = self._spec
        if spec.sim is None or self._locked or spec.network.silent:
            return "Searching"
        if spec.network.denies:
            return "Denied"
        return "Registered, home" if spec.network.plmn == spec.sim.home else "Roaming"

    @property
    def connected(self) -> bool:
        """Whether data flow."""
        sim = self._spec.sim
        if sim is None or self.registration not in ("Registered, home", "Roaming"):
            return False
        if self.registration == "Roaming" and self.settings.get("deny_roaming", "0") != "0":
            return False
        automatic = sim.listed and self.settings.get("auto_apn", "1") == "1"
        return sim.apn is None or automatic or self.settings.get("apn") == sim.apn

    @property
    def pin_words(self) -> str:
        """`pinstate`."""
        if self._spec.sim is None:
            return "SIM not inserted"
        if not self._locked:
            return "Inserted"
        return f"Required PIN, {self._tries} attempts left" if self._tries else "Required PUK, 10 attempts left"

    def status(self) -> dict[str, Any]:
        """A row of `/api/modems/status`."""
        spec = self._spec
        received = self.registration in ("Registered, home", "Roaming")
        row: dict[str, Any] = {
            "pinstate": self.pin_words,
            "provider": spec.network.operator if received else "N/A",
            "oper": spec.network.operator if received else "N/A",
            "sinr": 11 if received else "N/A",
            "conntype": "4G (LTE)" if received else "No service",
            "state": "Connected" if self.connected else "Disconnected",
            "imei": "000000000000000",
            "active_sim": 1,
            "imsi": "N/A",
            "sim_count": 2,
            "iccid": "N/A",
            "ntype": "LTE" if received else "No service",
            "id": "1-1",
            "primary": True,
            "netstate": self.registration,
            "rsrq": -9 if received else "N/A",
            "rsrp": -94 if received else "N/A",
            "signal": -66 if received else "N/A",
            "simstate": "Not inserted" if spec.sim is None else "Inserted",
        }
        if received:
            row |= {"band": "LTE B3", "cell_info": [{"mcc": spec.network.plmn[:3], "mnc": spec.network.plmn[3:]}]}
        if spec.sim is not None:
            row["pinleft"] = self._tries
        if spec.numbers_as_text:
            row = {name: str(value) if type(value) is int else value for name, value in row.items()}
        return row if spec.old_names else {_NEW.get(name, name): value for name, value in row.items()}

    def interfaces(self) -> list[dict[str, Any]]:
        """Rows of `/api/interfaces/basic/status`."""
        mobile = {"id": "mob1s1a1", "name": "mob1s1a1", "network_type": "mobile", "is_up": self.connected}
        lan = {"id": "lan", "name": "lan", "network_type": "wired", "is_up": True, "ipaddrs": ["192.168.1.1/24"]}
        return [lan, mobile | {"ipaddrs": [f"{ADDRESS}/32"] if self.connected else []}]

    def signal(self) -> dict[str, Any]:
        """`ubus call gsm.modem0 get_signal_query`."""
        row = self.status()
        return {name: row[name] for name in ("rsrp", "rsrq", "sinr")} | {"rssi": row.get("signal", row.get("rssi"))}

    def info(self) -> dict[str, Any]:
        """`ubus call gsm.modem0 info`."""
        row = self.status()
        cache = {
            "provider_name": row["provider"],
            "reg_stat_str": self.registration,
            "net_mode_str": row["ntype"],
            "band_str": row.get("band", "N/A").replace(" ", "_"),
            "pin_state_str": self.pin_words,
            "sim_state_str": row["simstate"],
        }
        return {"state": row.get("state", row.get("data_conn_state")), "cache": cache}
