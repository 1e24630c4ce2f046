"""`/system`, `/user`, `/tool` and `/certificate`: the device itself, its users, and its messages."""

from __future__ import annotations

from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.routeros._types import Layer
from atlantis_netcfg.routeros.menus import _model

_NOBODY = "0.0.0.0"  # noqa: S104 - what the device prints where no address is set

_IDENTITY = _model.Menu(
    "/system/identity", _model.Shape.SINGLETON, Layer.FOUNDATION, fields=(_model.text("name", "MikroTik"),)
)

_CLOCK = _model.Menu(
    "/system/clock",
    _model.Shape.SINGLETON,
    Layer.FOUNDATION,
    # `date` and `time` go on by themselves and are nothing to declare.
    fields=(_model.boolean("time-zone-autodetect", "yes"), *_model.usual(_model.text("time-zone-name", "manual"))),
)

_NOTE = _model.Menu(
    "/system/note",
    _model.Shape.SINGLETON,
    Layer.FOUNDATION,
    fields=(
        _model.text("note"),
        *_model.since("7.14", _model.boolean("show-at-cli-login")),
        *_model.usual(_model.boolean("show-at-login", "yes")),
    ),
)

_LOGGING_ACTION = _model.Menu(
    "/system/logging/action",
    _model.Shape.LIST,
    Layer.FOUNDATION,
    keys=("name",),
    subject="{name}",
    flags=("default",),
    stock=(("memory",), ("disk",), ("echo",), ("remote",)),
    row_defaults={name: {"target": name} for name in ("memory", "disk", "echo", "remote")},
    inert=True,
    fields=(
        _model.text("name", None),
        _model.text("target", "memory"),
        _model.COMMENT,
        _model.number("memory-lines", "1000"),
        _model.boolean("memory-stop-on-full"),
        _model.number("disk-file-count", "2"),
        _model.text("disk-file-name", "log"),
        _model.number("disk-lines-per-file", "1000"),
        _model.boolean("disk-stop-on-full"),
        _model.number("remote-port", "514"),
        _model.text("syslog-facility", "daemon"),
        _model.text("syslog-severity", "auto"),
        _model.text("syslog-time-format", "bsd-syslog"),
        _model.text("email-to"),
        *_model.usual(
            _model.prefix("remote", _NOBODY), _model.prefix("src-address", _NOBODY), _model.boolean("remember", "yes")
        ),
        *_model.keep(_model.text("email-start-tls")),
        *_model.until("7.18", _model.boolean("bsd-syslog")),
        *_model.since("7.18", _model.text("remote-log-format", "default"), _model.text("remote-protocol", "udp")),
        *_model.since("7.18", *_model.keep(_model.text("cef-event-delimiter"))),
        *_model.since("7.19.6", _model.text("vrf", "main")),
    ),
)

_LOGGING = _model.Menu(
    "/system/logging",
    _model.Shape.LIST,
    Layer.ATTACHMENT,
    keys=("topics", "action", "prefix"),
    subject="{topics} to {action}",
    flags=("default", "invalid"),
    inert=True,
    stock=(("info", "memory", ""), ("error", "memory", ""), ("warning", "memory", ""), ("critical", "echo", "")),
    fields=(
        _model.words("topics", "info"),
        _model.text("action", "memory"),
        _model.text("prefix"),
        *_model.since("7.17", _model.text("regex")),
        _model.DISABLED,
    ),
)

_NTP_CLIENT = _model.Menu(
    "/system/ntp/client",
    _model.Shape.SINGLETON,
    Layer.ATTACHMENT,
    # `servers` shows the rows of the menu below.
    fields=(
        _model.boolean("enabled"),
        *_model.since(
            "7.0", _model.text("mode", "unicast"), *_model.keep(_model.sequence("servers")), _model.text("vrf", "main")
        ),
    ),
)

_NTP_SERVERS = _model.Menu(
    "/system/ntp/client/servers",
    _model.Shape.LIST,
    Layer.ATTACHMENT,
    since=Version(7, 0),
    keys=("address",),
    subject="{address}",
    flags=("dynamic",),
    fields=(
        _model.text("address", None),
        _model.COMMENT,
        _model.DISABLED,
        *_model.usual(_model.boolean("iburst", "yes"), _model.number("max-poll", "10"), _model.number("min-poll", "6")),
        *_model.keep(_model.text("auth-key")),
    ),
)

_GROUP = _model.Menu(
    "/user/group",
    _model.Shape.LIST,
    Layer.FOUNDATION,
    keys=("name",),
    subject="{name}",
    stock=(("read",), ("write",), ("full",)),
    inert=True,
    fields=(
        _model.text("name", None),
        _model.COMMENT,
        *_model.keep(_model.policy("policy")),
        _model.text("skin", "default"),
    ),
)

_USER = _model.Menu(
    "/user",
    _model.Shape.LIST,
    Layer.ATTACHMENT,
    keys=("name",),
    subject="{name}",
    is_exported=False,
    fields=(
        _model.text("name", None),
        _model.text("group", None),
        _model.secret(_model.unread(_model.text("password"))),
        _model.COMMENT,
        _model.DISABLED,
        _model.prefixes("address"),
        *_model.since("7.16", *_model.keep(_model.text("inactivity-policy"), _model.time("inactivity-timeout"))),
    ),
)

_CERTIFICATE = _model.Menu(
    "/certificate",
    _model.Shape.LIST,
    Layer.FOUNDATION,
    keys=("name",),
    subject="{name}",
    flags=("fingerprint", "private-key", "expired", "invalid-before", "invalid-after"),
    readonly=True,
    is_exported=False,
    fields=_model.texts("name common-name subject-alt-name"),
)

_TOOLS = (
    _model.Menu(
        "/tool/mac-server",
        _model.Shape.SINGLETON,
        Layer.CLEANUP,
        fields=(_model.text("allowed-interface-list", "all"),),
    ),
    _model.Menu(
        "/tool/mac-server/mac-winbox",
        _model.Shape.SINGLETON,
        Layer.CLEANUP,
        fields=(_model.text("allowed-interface-list", "all"),),
    ),
    _model.Menu(
        "/tool/mac-server/ping", _model.Shape.SINGLETON, Layer.CLEANUP, fields=(_model.boolean("enabled", "yes"),)
    ),
    _model.Menu(
        "/tool/bandwidth-server",
        _model.Shape.SINGLETON,
        Layer.CLEANUP,
        fields=(
            _model.boolean("enabled", "yes"),
            _model.boolean("authenticate", "yes"),
            _model.number("allocate-udp-ports-from", "2000"),
            _model.number("max-sessions", "100"),
            *_model.since("7.18", _model.prefixes("allowed-addresses4"), _model.prefixes("allowed-addresses6")),
        ),
    ),
)

_SCHEDULER = _model.Menu(
    "/system/scheduler",
    _model.Shape.LIST,
    # Before the routes that it puts back.
    Layer.ATTACHMENT,
    keys=("name",),
    subject="{name}",
    fields=(
        _model.text("name", None),
        _model.COMMENT,
        _model.DISABLED,
        _model.time("interval", "0s"),
        _model.text("on-event"),
        *_model.keep(_model.text("start-date"), _model.text("start-time"), _model.policy("policy")),
    ),
)

MENUS = (
    *(_IDENTITY, _CLOCK, _NOTE, _LOGGING_ACTION, _LOGGING, _NTP_CLIENT, _NTP_SERVERS),
    *(_GROUP, _USER, _CERTIFICATE, _SCHEDULER),
    *_TOOLS,
)
