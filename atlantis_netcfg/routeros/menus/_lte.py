"""`/interface/lte`: the board's modem, its APN profiles, and the settings common to all modems.

Defaults: Manual, LTE/5G, and public verbose exports of 7.19 and 7.20. Roaming is off unless a row enables it. `pin` is
a special field: the device stores it and enters it whenever the modem starts, and the SIM counts wrong PINs. So it is
sent only while the SIM asks for one (routeros/pin.py).
"""

from __future__ import annotations

from atlantis_netcfg.routeros._types import Layer
from atlantis_netcfg.routeros.menus import _model

_APN = _model.Menu(
    "/interface/lte/apn",
    _model.Shape.LIST,
    Layer.FOUNDATION,
    keys=("name",),
    subject="{name}",
    stock=(("default",),),
    inert=True,
    named_by=("apn-profiles",),
    fields=(
        _model.text("name"),
        _model.COMMENT,
        _model.boolean("add-default-route", "yes"),
        _model.text("apn", "internet"),
        _model.text("authentication", "none"),
        _model.number("default-route-distance", "2"),
        _model.text("ip-type", "auto"),
        _model.secret(_model.text("password")),
        _model.boolean("use-network-apn", "yes"),
        _model.boolean("use-peer-dns", "yes"),
        _model.text("user"),
        *_model.keep(
            _model.interface("ipv6-interface"),
            _model.interface("passthrough-interface"),
            _model.text("passthrough-mac"),
            _model.text("passthrough-subnet-size"),
        ),
    ),
)

_LTE = _model.Menu(
    "/interface/lte",
    _model.Shape.FIXED,
    Layer.FOUNDATION,
    keys=("default-name",),
    subject="{default-name}",
    flags=("running", "inactive"),
    fields=(
        _model.interface("default-name"),
        _model.like("default-name", _model.interface("name")),
        _model.COMMENT,
        _model.DISABLED,
        _model.boolean("allow-roaming"),
        _model.sequence("apn-profiles", "default"),
        _model.words("band"),
        _model.on_prompt(_model.secret(_model.text("pin"))),
        *_model.usual(_model.number("mtu", "1500"), _model.words("nr-band"), _model.text("operator")),
        *_model.keep(_model.text("modem-init"), _model.words("network-mode")),
        *_model.since("7.13", *_model.keep(_model.boolean("sms-read"))),
        *_model.since("7.16", *_model.keep(_model.text("sms-protocol"))),
    ),
)

_SETTINGS = _model.Menu(
    "/interface/lte/settings",
    _model.Shape.SINGLETON,
    Layer.FOUNDATION,
    fields=(
        *_model.usual(_model.text("firmware-path", "firmware"), _model.text("mode", "auto")),
        *_model.since("7.13", *_model.keep(_model.time("info-polling-interval"))),
        *_model.since("7.17", *_model.usual(_model.text("esim-channel", "auto"))),
        *_model.since("7.19", *_model.usual(_model.number("link-recovery-timer", "120"))),
    ),
)

MENUS = (_APN, _LTE, _SETTINGS)
