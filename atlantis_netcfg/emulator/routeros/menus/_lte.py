"""`/interface/lte`: the modem, its APN profiles, the settings of all modems.

Names and words: RouterOS' command trees; defaults: Manual, LTE/5G, and public verbose exports of 7.19 and 7.20.
`allow-roaming`, `modem-init` and `network-mode` can be unset; the device writes the first one when it finds a modem.
"""

from __future__ import annotations

from atlantis_netcfg.emulator.routeros import values
from atlantis_netcfg.emulator.routeros.menus import _model

_NUMBERS = values.Pattern(r"|\d{1,3}(,\d{1,3})*")

_APN = _model.of_schema(
    "/interface/lte/apn",
    noun="apn profile",
    kinds={
        "name": values.Text(empty=False),
        "apn": values.Text(longest=100),
        "authentication": values.Choice(("chap", "none", "pap")),
        "default-route-distance": values.Int(0, 255),
        "ip-type": values.Choice(("auto", "ipv4", "ipv6")),
        "ipv6-interface": values.Ref(("interface",), ("none",)),
        "passthrough-interface": values.Ref(("interface",), ("none",)),
        "passthrough-subnet-size": values.Choice(("32", "auto")),
    },
    space="lte-apn",
    unique=(_model.Unique(("name",), "failure: item with such name already exists"),),
    factory=({"name": "default"},),
    builtin_flag="default",
    select=_model.Select.DEFAULT,
)

_LTE = _model.of_schema(
    "/interface/lte",
    noun="lte",
    kinds={
        "apn-profiles": values.Refs(values.Ref(("lte-apn",))),
        "band": _NUMBERS,
        "mtu": values.Int(68, 65535),
        "network-mode": values.Choices(("3g", "5g", "gsm", "lte"), is_ordered=False),
        "nr-band": _NUMBERS,
        "operator": values.Pattern(r"|\d{5,6}"),
    },
    local=(
        _model.Arg("name", values.Text(empty=False), ""),
        _model.Arg("allow-roaming", values.Bool()),
        _model.Arg("sms-protocol", values.Choice(("at", "auto", "mbim")), "auto"),
        _model.Arg("sms-read", values.Bool(), "yes"),
    ),
    without=("default-name",),
    space="interface",
    unique=(_model.Unique(("name",), "failure: already have interface with such name"),),
    flags=("running", "inactive"),
    select=_model.Select.DEFAULT_NAME,
)

_SETTINGS = _model.of_schema(
    "/interface/lte/settings",
    noun="lte settings",
    kinds={"esim-channel": values.Choice(("at", "auto")), "mode": values.Choice(("auto", "mbim", "serial", "user"))},
    local=(_model.Arg("info-polling-interval", values.Time(), "0s"),),
)

MENUS = (_APN, _LTE, _SETTINGS)
