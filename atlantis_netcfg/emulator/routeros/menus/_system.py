"""The system's own settings, logging, scheduler, users.

Values and defaults: Manual, CLI reference of each menu; Manual, Log; Manual, NTP; Manual, User; Manual, Scheduler;
verbose exports of RouterOS 7.19.
"""

from __future__ import annotations

from atlantis_netcfg.emulator.routeros import values
from atlantis_netcfg.emulator.routeros.menus import _model
from atlantis_netcfg.emulator.routeros.schema import offered_values

POLICIES = (
    "local",
    "telnet",
    "ssh",
    "ftp",
    "reboot",
    "read",
    "write",
    "policy",
    "test",
    "winbox",
    "password",
    "web",
    "sniff",
    "sensitive",
    "api",
    "romon",
    "rest-api",
)
"""Policies of a user group, in the order in which RouterOS prints them."""

_VRF = _model.Arg("vrf", values.Ref(("table",)), "main")
_HOST = values.Address(dns=True)
_DISK = ("target", "disk")
_REMOTE = ("target", "remote")
_MEMORY = ("target", "memory")
_EMAIL = ("target", "email")
_UNIQUE_NAME = _model.Unique(("name",), "failure: item with such name already exists")

_LOGGING = _model.of_schema(
    "/system/logging",
    noun="logging rule",
    local=(
        _model.Arg("action", values.Ref(("action",)), "memory", always=True),
        _model.Arg("topics", values.Topics(offered_values("/system/logging", "topics")), "info", always=True),
    ),
    factory=(
        {"topics": "info", "action": "memory"},
        {"topics": "error", "action": "memory"},
        {"topics": "warning", "action": "memory"},
        {"topics": "critical", "action": "echo"},
    ),
    flags=("invalid",),
    builtin_flag="default",
)

_ACTION = _model.of_schema(
    "/system/logging/action",
    noun="logging action",
    local=(
        _model.Arg("bsd-syslog", values.Bool(), "no", shown_if=_REMOTE),
        _model.Arg("cef-event-delimiter", values.Text(), "\\r\\n", shown_if=("remote-log-format", "cef")),
        _model.Arg("disk-file-count", values.Int(1, 65535), "2", shown_if=_DISK),
        _model.Arg("disk-file-name", values.Text(), "log", shown_if=_DISK),
        _model.Arg("disk-lines-per-file", values.Int(1, 65535), "1000", shown_if=_DISK),
        _model.Arg("disk-stop-on-full", values.Bool(), "no", shown_if=_DISK),
        _model.Arg("email-start-tls", values.Bool(), "no", shown_if=_EMAIL),
        _model.Arg("email-to", values.Text(), "", shown_if=_EMAIL),
        _model.Arg("memory-lines", values.Int(1, 65535), "1000", shown_if=_MEMORY),
        _model.Arg("memory-stop-on-full", values.Bool(), "no", shown_if=_MEMORY),
        _model.Arg("name", values.Text(empty=False), is_required=True),
        _model.Arg("remember", values.Bool(), "yes", shown_if=("target", "echo")),
        _model.Arg("remote", _HOST, "0.0.0.0", shown_if=_REMOTE),  # noqa: S104 - RouterOS' default, not a bind address
        _model.Arg("remote-log-format", values.Choice(("cef", "default", "syslog")), "default", shown_if=_REMOTE),
        _model.Arg("remote-port", values.Int(1, 65535), "514", shown_if=_REMOTE),
        _model.Arg("remote-protocol", values.Choice(("tcp", "udp")), "udp", shown_if=_REMOTE),
        _model.Arg("src-address", values.Address(), "0.0.0.0", shown_if=_REMOTE),  # noqa: S104 - RouterOS' default
        _model.Arg(
            "syslog-facility",
            values.Choice(offered_values("/system/logging/action", "syslog-facility")),
            "daemon",
            shown_if=_REMOTE,
        ),
        _model.Arg(
            "syslog-severity",
            values.Choice(offered_values("/system/logging/action", "syslog-severity")),
            "auto",
            shown_if=_REMOTE,
        ),
        _model.Arg("syslog-time-format", values.Choice(("bsd-syslog", "iso8601")), "bsd-syslog", shown_if=_REMOTE),
        _model.Arg(
            "target", values.Choice(("disk", "echo", "email", "memory", "remote")), is_required=True, always=True
        ),
        _model.Arg("vrf", values.Ref(("table",)), "main", shown_if=_REMOTE),
    ),
    space="action",
    unique=(_UNIQUE_NAME,),
    factory=(
        {"name": "memory", "target": "memory"},
        {"name": "disk", "target": "disk"},
        {"name": "echo", "target": "echo"},
        {"name": "remote", "target": "remote"},
    ),
    builtin_flag="default",
    first_id=0,
)

_SCHEDULER = _model.EmulatedMenu(
    "/system/scheduler",
    _model.Shape.LIST,
    (
        _model.COMMENT,
        _model.DISABLED_ARG,
        _model.Arg("interval", values.Time(), "0s"),
        _model.Arg("name", values.Text(empty=False), ""),
        _model.Arg("on-event", values.Text(), ""),
        _model.Arg("policy", values.Choices(POLICIES), "", always=True),
        _model.Arg("start-date", values.Moment()),
        _model.Arg("start-time", values.Moment(words=("startup",)), always=True),
    ),
    noun="schedule",
    unique=(_UNIQUE_NAME,),
)

_USER = _model.of_schema(
    "/user",
    noun="user",
    kinds={"address": values.Prefixes(many=True)},
    local=(
        _model.Arg("group", values.Ref(("group",)), is_required=True),
        _model.Arg("inactivity-policy", values.Choice(("lockscreen", "logout", "none")), "none"),
        _model.Arg("inactivity-timeout", values.Time(60, 86400), "10m"),
        _model.Arg("name", values.Text(empty=False), is_required=True),
        _model.Arg("password", values.Text(), "", never=True),
    ),
    unique=(_model.Unique(("name",), "failure: user with the same name already exists"),),
    flags=("expired",),
    is_exported=False,
)

_READ = "local,telnet,ssh,reboot,read,test,winbox,password,web,sniff,sensitive,api,romon,rest-api"
_WRITE = "local,telnet,ssh,reboot,read,write,test,winbox,password,web,sniff,sensitive,api,romon,rest-api"
_NOTHING = ",".join(f"!{policy}" for policy in POLICIES)
_GROUP = _model.of_schema(
    "/user/group",
    noun="user group",
    local=(
        _model.Arg("name", values.Text(empty=False), ""),
        _model.Arg("policy", values.PolicySet(POLICIES), _NOTHING),
    ),
    space="group",
    unique=(_UNIQUE_NAME,),
    factory=(
        {"name": "read", "policy": _READ},
        {"name": "write", "policy": _WRITE},
        {"name": "full", "policy": ",".join(POLICIES)},
    ),
    select=_model.Select.NAME,
)

_CERTIFICATE = _model.of_schema(
    "/certificate",
    noun="certificate",
    local=(
        _model.Arg("common-name", values.Text(), ""),
        _model.Arg("country", values.Text(), ""),
        _model.Arg("days-valid", values.Int(), "365"),
        _model.Arg("digest-algorithm", values.Choice(("md5", "sha1", "sha256", "sha384", "sha512")), "sha256"),
        _model.Arg("key-size", values.Text(), "2048"),
        _model.Arg("key-usage", values.Text(), ""),
        _model.Arg("locality", values.Text(), ""),
        _model.Arg("name", values.Text(empty=False), ""),
        _model.Arg("organization", values.Text(), ""),
        _model.Arg("state", values.Text(), ""),
        _model.Arg("subject-alt-name", values.Text(), ""),
        _model.Arg("trust-store", values.Text(), "all"),
        _model.Arg("trusted", values.Bool(), "no"),
        _model.Arg("unit", values.Text(), ""),
    ),
    space="certificate",
    unique=(_UNIQUE_NAME,),
    flags=("authority", "crl", "expired", "private-key"),
    is_exported=False,
)

_SETTINGS = (
    _model.of_schema("/system/identity", noun="system identity", kinds={"name": values.Text(empty=False)}),
    _model.of_schema(
        "/system/clock",
        noun="clock settings",
        kinds={"time-zone-name": values.Choice(("manual", *offered_values("/system/clock", "time-zone-name")))},
        local=(
            _model.Arg("date", values.Moment(), never=True, is_exported=False),
            _model.Arg("time", values.Moment(), never=True, is_exported=False),
        ),
    ),
    _model.of_schema(
        "/system/ntp/client",
        noun="ntp client",
        kinds={"mode": values.Choice(("broadcast", "manycast", "multicast", "unicast"))},
        local=(_model.Arg("servers", values.AddressesValue(_HOST), "", is_exported=False), _VRF),
    ),
    _model.of_schema(
        "/system/ntp/client/servers",
        noun="ntp server",
        kinds={"max-poll": values.Int(3, 17), "min-poll": values.Int(3, 17)},
        local=(
            _model.Arg("address", _HOST, is_required=True, always=True),
            _model.Arg("auth-key", values.Text(), "none"),
        ),
        name_property="address",
        unique=(_model.Unique(("address",), "failure: already have such entry"),),
        flags=("dynamic",),
    ),
    _model.of_schema("/system/note", noun="system note", factory=({"show-at-login": "no"},)),
)

MENUS = (*_SETTINGS, _ACTION, _LOGGING, _SCHEDULER, _USER, _GROUP, _CERTIFICATE)
