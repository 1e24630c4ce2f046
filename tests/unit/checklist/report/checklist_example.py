"""A checklist of coastal as the pages show it: every verdict, every kind, an override, open items, a photo."""

import hashlib
import io
from datetime import UTC, datetime, timedelta
from functools import cache
from typing import Any

from PIL import Image

from atlantis_netcfg.checklist.report import (
    Document,
    Drawing,
    DrawnLink,
    DrawnNode,
    Evidence,
    EvidenceType,
    Item,
    ItemChange,
    ItemFinding,
    ItemKind,
    LeftOut,
    Override,
    Phase,
    Row,
    Signature,
    SinceGreen,
)
from atlantis_netcfg.core.events import Verdict

AT = datetime(2026, 5, 4, 9, 30, tzinfo=UTC)
COLUMNS = ("wifi", "acoustic", "satellite", "usbl", "rc_rf", "4g", "gps")
NAMES = {
    "girona500": ("Girona 500", "auv", ("wifi", "acoustic", "usbl", "gps"), ("Girona",)),
    "sparus": ("Sparus", "auv", ("wifi", "acoustic", "usbl", "gps"), ("SPARUS2",)),
    "zarco": ("Zarco", "asv", ("wifi", "acoustic", "usbl", "gps"), ("SENSE",)),
    "stork": ("Stork", "uav", ("wifi", "rc_rf", "gps"), ("CROW", "RAVEN")),
    "mares": ("Mares", "auv", ("wifi", "acoustic", "usbl", "gps"), ()),
    "eca-rov": ("ECA ROV", "rov", ("usbl",), ("ROVINGBAT", "ROVING BAT")),
}
TITLES = {"wifi": "Wi-Fi", "rc_rf": "RC RF", "4g": "4G", "usbl": "USBL", "gps": "GPS"}
PERSON = "A. Technician"
PHOTO = "failsafe.png"


@cache
def photo() -> bytes:
    """A picture that nobody mistakes for another: a red triangle on sand."""
    image = Image.new("RGB", (320, 200), (214, 196, 150))
    for y in range(40, 160):
        image.paste((176, 32, 36), (160 - (y - 40) // 2, y, 161 + (y - 40) // 2, y + 1))
    kept = io.BytesIO()
    image.save(kept, "PNG")
    return kept.getvalue()


def files() -> dict[str, bytes]:
    return {PHOTO: photo(), "terminal-backup.cfg": b"allow 203.0.113.2\n"}


def sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def item(identity: str, verdict: Verdict = Verdict.PASS, message: str = "", **more: Any) -> Item:  # noqa: ANN401 - fields
    """One line; row and endpoint are read from its id."""
    row, endpoint, *_ = identity.split("/")
    is_vehicle = row in NAMES
    name = NAMES[row][0] if is_vehicle else "Coastal testbed"
    given: dict[str, Any] = {
        "title": f"{TITLES.get(endpoint, endpoint.capitalize())} of {name}",
        "vehicle": row if is_vehicle else None,
        "location": "coastal",
        "endpoint": endpoint,
        "table3": is_vehicle and endpoint in NAMES[row][2],
        "kind": ItemKind.AUTOMATIC,
        "phase": Phase.BENCH,
        "open": False,
        "message": message or f"{TITLES.get(endpoint, endpoint)} of {name} holds",
        "at": AT + timedelta(seconds=20),
        "seconds": 2.4,
    }
    return Item(id=identity, verdict=verdict, **(given | more))


def _healthy() -> dict[str, Item]:
    cells = [f"{key}/{column}" for key, (_, _, columns, _) in NAMES.items() for column in columns]
    cells += ["eca-rov/ethernet", "coastal/wifi", "coastal/satellite", "coastal/4g"]
    own = ("rogue-dhcp", "default-route", "clock", "vpn", "dds", "certificates", "poe", "allow-list")
    return {one: item(one) for one in (*cells, *(f"coastal/site/{name}" for name in own))}


def _wifi() -> Item:
    return item(
        "girona500/wifi",
        Verdict.PASS,
        "Girona 500 is associated, -52 dBm, no packet lost",
        title="Wi-Fi of Girona 500: association, signal, loss, rate",
        findings=(ItemFinding(verdict=Verdict.PASS, code="associated", message="-52 dBm, between -75 and -35 dBm"),),
        evidence=(
            Evidence(type=EvidenceType.READ, what="signal at coastal-gateway, wlan0", value="-52 dBm", at=AT),
            Evidence(type=EvidenceType.MEASURED, what="pings to 10.64.1.21", value="20 sent, 20 answered", at=AT),
        ),
    )


def _strong() -> Item:
    return item(
        "sparus/wifi",
        Verdict.FAIL,
        "the signal of Sparus overdrives the receiver: -22 dBm, above -35 dBm",
        hint="move the antennas apart, or lower `tx_power_dbm`",
        findings=(
            ItemFinding(
                verdict=Verdict.FAIL,
                code="signal-too-strong",
                message="the signal of Sparus overdrives the receiver: -22 dBm, above -35 dBm",
                hint="move the antennas apart, or lower `tx_power_dbm`",
            ),
            ItemFinding(verdict=Verdict.PASS, code="no-loss", message="20 of 20 pings were answered"),
        ),
        evidence=(Evidence(type=EvidenceType.READ, what="signal at coastal-gateway, wlan1", value="-22 dBm", at=AT),),
    )


def _by_a_person() -> Item:
    return item(
        "stork/rc_rf/failsafe",
        Verdict.PASS,
        "motors stopped after 2 s",
        title="Failsafe of Stork: the transmitter is switched off",
        kind=ItemKind.PERSON,
        evidence=(
            Evidence(type=EvidenceType.CONFIRMED, what="answer", value="motors stopped after 2 s", by=PERSON, at=AT),
            Evidence(type=EvidenceType.FILE, what="photo", value=PHOTO, file=PHOTO, sha256=sha256(photo()), by=PERSON),
        ),
    )


def _overridden() -> Item:
    return item(
        "zarco/wifi",
        Verdict.FAIL,
        "Zarco does not answer at 10.64.1.23",
        hint="is it switched on, and joined to the site's access point?",
        override=Override(reason="Zarco stays ashore today; its crew replaces the radio", by=PERSON, at=AT),
    )


def _odd() -> list[Item]:
    waits = {"open": True, "kind": ItemKind.PERSON, "at": None, "seconds": None}
    return [
        item(
            "sparus/usbl",
            Verdict.INCONCLUSIVE,
            "no fix was heard within 30 s; silence proves nothing on deck",
            hint="listen again when both modems are in the water",
            phase=Phase.WATER,
        ),
        item(
            "sparus/usbl/ping",
            Verdict.INCONCLUSIVE,
            "waits for a person's consent",
            **(waits | {"kind": ItemKind.ACTIVE}),
            phase=Phase.WATER,
        ),
        item("eca-rov/usbl", Verdict.INCONCLUSIVE, "waits for a person", **waits, phase=Phase.WATER),
        item("mares/gps", Verdict.ERROR, "the probe crashed: IndexError", hint="send us the log file of this run"),
        item("girona500/gps", Verdict.WARN, "the fix has 5 satellites, few", hint="wait for a clear sky"),
        item("coastal/satellite", Verdict.SKIP, "the terminal is not on board today"),
        item(
            "coastal/site/rogue-dhcp",
            Verdict.FAIL,
            "a second DHCP server answers at 10.64.1.77",
            hint="find 02:00:5E:00:01:99 by `/interface bridge host print` and unplug it",
        ),
    ]


def healthy_items() -> tuple[Item, ...]:
    """All that Table 3 and the site ask for, green."""
    return tuple(_healthy().values())


def items() -> tuple[Item, ...]:
    """The same with something of everything."""
    told = _healthy()
    for one in (_wifi(), _strong(), _by_a_person(), _overridden(), *_odd()):
        told[one.id] = one
    place = {key: number for number, key in enumerate([*NAMES, "coastal"])}
    return tuple(sorted(told.values(), key=lambda one: place[one.id.partition("/")[0]]))


def rows() -> tuple[Row, ...]:
    vehicles = [
        Row(
            key=key,
            name=name,
            kind=kind,
            aliases=aliases,
            table3=columns,
            beside=("ethernet",) if key == "eca-rov" else (),
        )
        for key, (name, kind, columns, aliases) in NAMES.items()
    ]
    beside = ("wifi", "satellite", "4g", "site")
    return (*vehicles, Row(key="coastal", name="Coastal testbed", kind="location", table3=(), beside=beside))


def drawing() -> Drawing:
    """As `checklist.drawing` makes it from the shipped inventory, by and large."""
    boxes = {
        "scc": ("Control centre", "site"),
        "scc-vpn": ("scc-vpn", "vpn_server"),
        "coastal-cpe": ("coastal-cpe", "cpe"),
        "coastal-4g": ("coastal-4g", "lte_router"),
        "coastal-sat": ("coastal-sat", "satellite_terminal"),
        "coastal-router": ("coastal-router", "router"),
        "coastal-gateway": ("coastal-gateway", "gateway"),
    }
    nodes = [DrawnNode(key=key, label=label, kind=kind) for key, (label, kind) in boxes.items()]
    nodes += [DrawnNode(key=key, label=value[0], kind="vehicle", detail=value[1]) for key, value in NAMES.items()]
    uplinks = {"wifi": "coastal-cpe", "4g": "coastal-4g", "satellite": "coastal-sat"}
    links = [
        DrawnLink(a=box, b="scc", label=kind, kind=kind, items=(f"coastal/{kind}",)) for kind, box in uplinks.items()
    ]
    links += [DrawnLink(a="coastal-router", b=box, label="PoE", kind="ethernet") for box in uplinks.values()]
    links += [
        DrawnLink(a="coastal-router", b="scc-vpn", label="VPN", kind="vpn", items=("coastal/site/vpn",)),
        DrawnLink(a="coastal-gateway", b="coastal-router", label="LAN", kind="ethernet"),
    ]
    links += [
        DrawnLink(a=key, b="coastal-gateway", label=TITLES.get(one, one), kind=one, items=(f"{key}/{one}",))
        for key, value in NAMES.items()
        for one in value[2]
    ]
    return Drawing(nodes=tuple(nodes), links=tuple(links))


def signature() -> Signature:
    return Signature(
        by=PERSON,
        at=AT + timedelta(minutes=42),
        digest=sha256(b"an example"),
        key="SHA256:EXAMPLEw0w0w0w0w0w0w0w0w0w0w0w0w0w0w0w0w0w0",
        signature="RVhBTVBMRQ==",
    )


def example(**changes: Any) -> Document:  # noqa: ANN401 - fields
    """A signed rehearsal that has not passed; `changes` are fields of the document."""
    given: dict[str, Any] = {
        "run": "20260504T093000Z-coastal-check",
        "site": "coastal",
        "title": "Coastal testbed",
        "rehearsed": True,
        "tool": "0.7.0",
        "inventory": sha256(b"the example inventory"),
        "started": AT,
        "time_zone": "Europe/Lisbon",
        "ended": AT + timedelta(minutes=41),
        "scope": {},
        "columns": COLUMNS,
        "rows": rows(),
        "items": items(),
        "left_out": (LeftOut(what="Mares: Acoustic", why="left out by `phase=bench`"),),
        "notes": ("neighbours in the LAN of coastal reach each other, whatever the policy says: Zarco, ECA ROV",),
        "not_rehearsed": ("radio waves: the signal is what the twin is told to say", "sound in water"),
        "broken": ("a second DHCP server at 10.64.1.77",),
        "drawing": drawing(),
        "since_green": SinceGreen(
            run="20260427T081500Z-coastal-check",
            at=AT - timedelta(days=7),
            changes=(
                ItemChange(id="sparus/wifi", before=Verdict.PASS, after=Verdict.FAIL, message="-22 dBm, was -50 dBm"),
                ItemChange(id="coastal/site/poe", before=None, after=Verdict.PASS, message="is new"),
                ItemChange(id="mares/usbl/old", before=Verdict.PASS, after=None, message="is gone"),
            ),
        ),
        "signed": signature(),
    }
    return Document(**(given | changes))


def green(**changes: Any) -> Document:  # noqa: ANN401 - fields
    """All is well, for real, and signed."""
    lists = dict.fromkeys(("left_out", "notes", "not_rehearsed", "broken"), ())
    plain: dict[str, Any] = {"rehearsed": False, **lists, "since_green": None}
    return example(**({"items": healthy_items(), **plain} | changes))


def empty() -> Document:
    """Nothing at all."""
    nothing: dict[str, Any] = {"items": (), "rows": (), "drawing": Drawing(nodes=(), links=()), "signed": None}
    return green(**nothing, ended=None)
