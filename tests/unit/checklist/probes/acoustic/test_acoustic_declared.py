"""What the steps make of other declarations, and of every reason for which a modem tells nothing."""

import time
from dataclasses import replace
from ipaddress import IPv4Address
from pathlib import Path
from typing import Any

import pytest
from acoustic_talk import hear, talk, told, twin_of
from row_subtests import for_each_row

from atlantis_netcfg.checklist.probes import Cell, Listen, Place, Probe, Step, Transcript, Trouble, acoustic, usbl
from atlantis_netcfg.checklist.probes.acoustic import seatrac
from atlantis_netcfg.checklist.probes.acoustic.modem import WATER
from atlantis_netcfg.checklist.report import ItemKind
from atlantis_netcfg.emulator.acoustic import EvologicsSpec, SeatracSpec
from atlantis_netcfg.inventory import Inventory
from atlantis_netcfg.inventory.loader import load
from atlantis_netcfg.inventory.model import AcousticEndpoint, Geofence, SeenFrom, UsblEndpoint

SITE = "coastal"
SEATRAC_PORT = {"driver": "seatrac", "device": "/dev/ttyUSB0", "seen_from": "laptop"}


@pytest.fixture(scope="module")
def shipped() -> Inventory:
    return load(Path(__file__).parents[5] / "inventory")


def having(declaration: Inventory, row: str | None, **endpoints: Any) -> Inventory:  # noqa: ANN401 - fields of a model
    """The same with other endpoints of a row; None: of the site's own location."""
    if row is None:
        site = declaration.sites[SITE]
        location = site.location.model_copy(
            update={
                "endpoints": site.location.endpoints.model_copy(update=endpoints),
                "table3": frozenset({"acoustic"}),
            }
        )
        return replace(declaration, sites={**declaration.sites, SITE: site.model_copy(update={"location": location})})
    vehicle = declaration.vehicles[row]
    changed = vehicle.model_copy(update={"endpoints": vehicle.endpoints.model_copy(update=endpoints)})
    return replace(declaration, vehicles={**declaration.vehicles, row: changed})


def at(declaration: Inventory, row: str | None, column: str) -> list[Step]:
    steps = acoustic.steps if column == "acoustic" else usbl.steps
    return list(steps(Cell(declaration, SITE, row, column)))


def asked(step: Step) -> Listen:
    assert step.probe is not None
    (question,) = step.probe.asks()
    assert isinstance(question, Listen)
    return question


IN_USE = "INCONCLUSIVE in-use"
SAID_OF_NOTHING = {
    Trouble.REFUSED: (
        f"{IN_USE}: the modem of Sparus refuses the connection at 10.64.1.22:9200: the vehicle is probably using it"
    ),
    Trouble.CLOSED: (
        f"{IN_USE}: the modem of Sparus refuses the connection at 10.64.1.22:9200: the vehicle is probably using it"
    ),
    Trouble.BUSY: f"{IN_USE}: the modem of Sparus is in use: another program has 10.64.1.22:9200 open",
    Trouble.SILENT: "INCONCLUSIVE silent: the modem of Sparus does not respond at 10.64.1.22:9200",
    Trouble.UNREACHABLE: "INCONCLUSIVE unreachable: the modem of Sparus is not reachable at 10.64.1.22:9200",
    Trouble.MISSING: "FAIL no-port: the serial port 10.64.1.22:9200 for the modem of Sparus does not exist",
    Trouble.DENIED: "INCONCLUSIVE denied: no permission to open 10.64.1.22:9200 for the modem of Sparus",
    Trouble.NO_PLACE: "INCONCLUSIVE no-place: the modem of Sparus was not queried: no way to coastal-gateway",
    None: (
        f"{IN_USE}: the modem of Sparus accepts the connection at 10.64.1.22:9200 and sends nothing: the vehicle "
        "is probably using it"
    ),
}


@for_each_row("met", [*Trouble, None], ids=lambda met: str(met or "nothing said"))
@for_each_row(("column", "step"), [("acoustic", 0), ("acoustic", 1), ("usbl", 0)])
def test_silent_or_unreachable_modem_is_reported(
    shipped: Inventory, met: Trouble | None, column: str, step: int
) -> None:
    probe = at(shipped, "sparus", column)[step].probe
    assert probe is not None
    (question,) = probe.asks()
    ((verdict, code, message),) = told(probe.judge({question.name: Transcript(met, "no way to coastal-gateway")}))
    assert f"{verdict} {code}: {message}" == SAID_OF_NOTHING[met]


def test_hint_for_a_busy_modem_is_unobtrusive(shipped: Inventory) -> None:
    probe: Probe | None = at(shipped, "sparus", "acoustic")[0].probe
    assert probe is not None
    (question,) = probe.asks()
    (finding,) = probe.judge({question.name: Transcript(Trouble.REFUSED)}).findings
    assert finding.hint is not None
    assert "topic in the vehicle's own software" in finding.hint
    assert "only if the vehicle's crew agrees" in finding.hint


def test_serial_port_is_read_at_the_declared_place(shipped: Inventory) -> None:
    step, *_ = at(having(shipped, "mares", acoustic=AcousticEndpoint(**SEATRAC_PORT)), "mares", "acoustic")
    question = asked(step)
    assert (question.transport, question.device, question.baud) == ("serial", "/dev/ttyUSB0", 115200)
    assert (question.place, question.address, question.port) == (Place.LAPTOP, "", 0)
    assert question.name == "modem at /dev/ttyUSB0 on this laptop"


def test_baud_rate_is_declared_or_default(shipped: Inventory) -> None:
    endpoint = AcousticEndpoint(driver="evologics", device="/dev/ttyS1", baud=57600)
    assert asked(at(having(shipped, "mares", acoustic=endpoint), "mares", "acoustic")[0]).baud == 57600
    endpoint = AcousticEndpoint(driver="evologics", device="/dev/ttyS1")
    assert asked(at(having(shipped, "mares", acoustic=endpoint), "mares", "acoustic")[0]).baud == 19200


@pytest.mark.parametrize("column", ["acoustic", "usbl"])
def test_a_modem_without_an_address_is_for_a_person(shipped: Inventory, column: str) -> None:
    """The site's own modem has no reservation: without `address` nobody knows where it is."""
    endpoints = {"acoustic": AcousticEndpoint(driver="evologics"), "usbl": UsblEndpoint(driver="evologics")}
    (step,) = at(having(shipped, None, **endpoints), None, column)
    assert step.kind is ItemKind.PERSON
    assert "has no address at this site" in step.do
    (step,) = at(shipped, None, column)
    assert "is not in the inventory" in step.do


def test_unsupported_drivers_do_not_transmit(shipped: Inventory) -> None:
    changed = having(shipped, "zarco", acoustic=AcousticEndpoint(driver="seatrac", port=9300, partner=2))
    changed = having(changed, "sparus", usbl=UsblEndpoint(driver="evologics", ping=1))
    (message,) = [step for step in at(changed, "zarco", "acoustic") if step.name == "message"]
    (ping,) = [step for step in at(changed, "sparus", "usbl") if step.name == "ping"]
    assert (message.kind, ping.kind) == (ItemKind.PERSON, ItemKind.PERSON)


def test_nothing_transmits_without_a_partner(shipped: Inventory) -> None:
    changed = having(shipped, "sparus", acoustic=AcousticEndpoint(driver="evologics"))
    assert [step.kind for step in at(changed, "sparus", "acoustic")] == [ItemKind.AUTOMATIC]
    changed = having(shipped, "zarco", usbl=UsblEndpoint(driver="seatrac", port=9300))
    assert [step.kind for step in at(changed, "zarco", "usbl")] == [ItemKind.AUTOMATIC]


def test_transmitting_steps_take_turns(shipped: Inventory) -> None:
    active = [
        step for row in ("girona500", "sparus") for step in at(shipped, row, "acoustic") if step.kind is ItemKind.ACTIVE
    ]
    active += [step for step in at(shipped, "zarco", "usbl") if step.kind is ItemKind.ACTIVE]
    assert [asked(step).turn for step in active] == [WATER] * 3
    assert asked(at(shipped, "girona500", "acoustic")[0]).turn == ""


def test_nothing_to_listen_for_takes_no_time(shipped: Inventory) -> None:
    question = asked(at(having(shipped, "sparus", usbl=None), "sparus", "acoustic")[0])
    assert (question.listen_s, question.enough) == (0.0, b"")


def test_probe_does_not_wait_for_disabled_fixes(shipped: Inventory) -> None:
    step = at(shipped, "sparus", "usbl")[0]
    assert step.probe is not None
    ended = {}
    for tells in (False, True):
        twin = twin_of(EvologicsSpec(tells_fixes=tells, hears=(), fix_every_s=0.5))
        (answer,) = hear(step.probe, {"10.64.1.22": twin}).values()
        assert isinstance(answer, Transcript)
        ended[tells] = round(answer.ended_s)
    assert ended == {False: 0, True: 30}


def test_site_modem_is_heard_once_for_all_vehicles(shipped: Inventory) -> None:
    """Two vehicles are heard by one modem: one question, as long as the longer wish, judged for each."""
    of_site = IPv4Address("10.64.1.50")
    for row, hears, listen_s in (("girona500", (1,), 20.0), ("sparus", (2,), 40.0)):
        endpoint = UsblEndpoint(driver="evologics", address=of_site, hears=hears, listen_s=listen_s)
        shipped = having(shipped, row, usbl=endpoint)
    steps = [at(shipped, row, "usbl")[0] for row in ("girona500", "sparus")]
    questions = {asked(step) for step in steps}
    assert [(one.listen_s, one.address) for one in questions] == [(40.0, "10.64.1.50")]
    for spec, codes in (
        (EvologicsSpec(local_address=9, hears=(1, 2), fix_every_s=0.5), ["heard", "heard"]),
        (EvologicsSpec(local_address=9, hears=(2,), fix_every_s=2.0), ["no-fixes", "heard"]),
    ):
        twin = twin_of(spec)
        found = []
        for step in steps:
            assert step.probe is not None
            found += [one.code for one in step.probe.judge(hear(step.probe, {"10.64.1.50": twin})).findings]
        assert found == codes


def test_site_modem_belongs_to_the_fleet(shipped: Inventory) -> None:
    endpoint = AcousticEndpoint(driver="evologics", address=IPv4Address("10.64.1.50"), acoustic_address=2)
    changed = having(shipped, None, acoustic=endpoint)
    (fleet,) = [step for step in at(changed, "girona500", "acoustic") if step.name == "fleet"]
    assert fleet.probe is not None
    twins = {
        address: twin_of(EvologicsSpec(local_address=own, hears=()))
        for address, own in (("10.64.1.21", 1), ("10.64.1.22", 2), ("10.64.1.50", 2))
    }
    title = changed.sites[SITE].title
    assert told(fleet.probe.judge(hear(fleet.probe, twins))) == [
        ["FAIL", "duplicate-address", f"Sparus and {title} have the same acoustic address, 2"]
    ]
    assert [step.name for step in at(changed, None, "acoustic")] == [""]


def test_busy_third_modem_leaves_the_others_compared(shipped: Inventory) -> None:
    endpoint = AcousticEndpoint(driver="evologics", address=IPv4Address("10.64.1.50"))
    (fleet,) = [
        step for step in at(having(shipped, None, acoustic=endpoint), "girona500", "acoustic") if step.name == "fleet"
    ]
    assert fleet.probe is not None
    twins = {
        "10.64.1.21": twin_of(EvologicsSpec(hears=())),
        "10.64.1.22": twin_of(EvologicsSpec(local_address=2, packet_time_ms=500, hears=())),
        "10.64.1.50": twin_of(EvologicsSpec(is_occupied=True)),
    }
    assert [one.code for one in fleet.probe.judge(hear(fleet.probe, twins)).findings] == [
        *("not-compared", "packet-time-differs")
    ]


def test_any_fix_counts_if_no_target_is_declared(shipped: Inventory) -> None:
    changed = having(shipped, "sparus", usbl=UsblEndpoint(driver="evologics"))
    step = at(changed, "sparus", "usbl")[0]
    assert step.probe is not None
    heard = hear(step.probe, {"10.64.1.22": twin_of(EvologicsSpec(local_address=2, hears=(9, 5), fix_every_s=0.5))})
    assert told(step.probe.judge(heard)) == [
        ["PASS", "heard", "the USBL of Sparus reported 2 fixes of the address 5, 14.1 m away"],
        ["PASS", "heard", "the USBL of Sparus reported 2 fixes of the address 9, 14.1 m away"],
        [
            "WARN",
            "whose-unknown",
            "the inventory does not say which addresses the USBL of Sparus should receive: fixes of any address count",
        ],
    ]


def test_modem_can_be_probed_from_the_laptop(shipped: Inventory) -> None:
    endpoint = AcousticEndpoint(driver="evologics", seen_from=SeenFrom.LAPTOP)
    assert (
        asked(at(having(shipped, "sparus", acoustic=endpoint, usbl=None), "sparus", "acoustic")[0]).place
        is Place.LAPTOP
    )


@pytest.mark.parametrize(
    ("endpoint", "address", "spec"),
    [
        (AcousticEndpoint(driver="evologics"), "10.64.1.22:9200", EvologicsSpec(local_address=9, hears=())),
        (AcousticEndpoint(driver="seatrac"), "10.64.1.22:9200", SeatracSpec(beacon=9, hears=())),
    ],
)
def test_any_modem_counts_if_no_address_is_declared(
    shipped: Inventory, endpoint: AcousticEndpoint, address: str, spec: EvologicsSpec | SeatracSpec
) -> None:
    step = at(having(shipped, "sparus", acoustic=endpoint, usbl=None), "sparus", "acoustic")[0]
    assert step.probe is not None
    heard = hear(step.probe, {"10.64.1.22": twin_of(spec)})
    assert [one[:2] for one in told(step.probe.judge(heard))] == [["PASS", "listens"], ["WARN", "whose-unknown"]]
    message = f"cannot tell whether the device at {address} is the modem of Sparus"
    assert told(step.probe.judge(heard))[1][2] == message
    declared = endpoint.model_copy(update={"acoustic_address": 9})
    step = at(having(shipped, "sparus", acoustic=declared, usbl=None), "sparus", "acoustic")[0]
    assert step.probe is not None
    assert [one[:2] for one in told(step.probe.judge(heard))] == [["PASS", "listens"]]


def judged_fixes(shipped: Inventory, spec: EvologicsSpec, **changes: Any) -> list[str]:  # noqa: ANN401 - of a transcript
    """Codes of what Sparus tells, after a change of when it was heard."""
    probe = at(shipped, "sparus", "usbl")[0].probe
    assert probe is not None
    (question,) = probe.asks()
    assert isinstance(question, Listen)
    heard = talk(twin_of(spec), question)
    return [one.code for one in probe.judge({question.name: replace(heard, **changes)}).findings]


TIMED = EvologicsSpec(local_address=2, hears=(1,), fix_every_s=0.5, clock_ahead_s=0.0)


@pytest.mark.parametrize(
    ("ahead_s", "codes"),
    [(0.0, ["heard"]), (-4.0, ["heard"]), (-3600.0, ["clock-differs"]), (86_400.0, ["clock-differs"])],
)
def test_modem_clock_is_compared_with_ours(shipped: Inventory, ahead_s: float, codes: list[str]) -> None:
    spec = TIMED.model_copy(update={"clock_ahead_s": ahead_s})
    assert judged_fixes(shipped, spec, began=time.time()) == codes


def test_delayed_fixes_are_reported(shipped: Inventory) -> None:
    """The same lines, all of them at once: the modem's clock goes on by seconds while ours stands still."""
    probe = at(shipped, "sparus", "usbl")[0].probe
    assert probe is not None
    (question,) = probe.asks()
    assert isinstance(question, Listen)
    heard = talk(twin_of(TIMED.model_copy(update={"clock_ahead_s": None, "fix_every_s": 6.0})), question)
    at_once = replace(heard, chunks=((heard.ended_s, heard.data),))
    assert [one.code for one in probe.judge({question.name: heard}).findings] == ["heard"]
    assert [one.code for one in probe.judge({question.name: at_once}).findings] == ["heard", "out-of-step"]


def test_looped_log_is_reported_as_repeated(shipped: Inventory) -> None:
    probe = at(shipped, "zarco", "usbl")[0].probe
    assert probe is not None
    (question,) = probe.asks()
    assert isinstance(question, Listen)
    heard = talk(twin_of(SeatracSpec(in_water=True, fix_every_s=0.5, fixes=2)), replace(question, listen_s=2.0))
    (one, then) = (chunk for chunk in heard.chunks if chunk[1].startswith(b"$42"))
    looped = replace(heard, chunks=(*heard.chunks, (1.5, one[1]), (2.0, then[1])))
    assert [found.code for found in probe.judge({question.name: heard}).findings] == ["heard"]
    assert [found.code for found in probe.judge({question.name: looped}).findings] == ["repeated"]


def test_response_without_range_or_direction_is_no_fix(shipped: Inventory) -> None:
    """A response whose flags name neither range nor direction says only that somebody has answered."""
    probe = at(shipped, "zarco", "usbl")[0].probe
    assert probe is not None
    (question,) = probe.asks()
    assert isinstance(question, Listen)
    spec = SeatracSpec(in_water=True, hears=())
    heard = talk(twin_of(spec), question)
    empty = bytes([0x42]) + bytes([1, 2, 0]) + SeatracSpec().fix(2)[3:16]
    frame = b"$" + (empty + seatrac.crc16(empty).to_bytes(2, "little")).hex().upper().encode() + b"\r\n"
    several = replace(heard, chunks=(*heard.chunks, *((heard.ended_s, frame) for _ in range(3))))
    assert [found.code for found in probe.judge({question.name: several}).findings] == ["no-fixes"]


def test_distant_fix_is_accepted_within_the_declared_radius(shipped: Inventory) -> None:
    far = EvologicsSpec(local_address=2, hears=(1,), fix_every_s=0.5, range_m=5200.0)
    found = {}
    for radius_m in (None, 1000.0, 4000.0):
        site = shipped.sites[SITE]
        fence = None if radius_m is None else Geofence(latitude=41.6864, longitude=-8.8388, radius_m=radius_m)
        checklist = site.checklist.model_copy(update={"geofence": fence})
        sites = {**shipped.sites, SITE: site.model_copy(update={"checklist": checklist})}
        found[radius_m] = judged_fixes(replace(shipped, sites=sites), far)
    assert found == {None: ["far-away"], 1000.0: ["too-far"], 4000.0: ["heard"]}


def test_response_to_another_ping_does_not_count(shipped: Inventory) -> None:
    """The vehicle's own software pings as well: its answer came before ours was sent."""
    (ping,) = [step for step in at(shipped, "zarco", "usbl") if step.name == "ping"]
    assert ping.probe is not None
    (question,) = ping.probe.asks()
    assert isinstance(question, Listen)
    heard = talk(twin_of(SeatracSpec(in_water=True, hears=())), question)
    *before, taken, answer = heard.data.splitlines(keepends=True)
    assert (taken[:3], answer[:3]) == (b"$40", b"$42")
    earlier = replace(heard, chunks=((0.1, b"".join((*before, answer, taken))),))
    assert [one.code for one in ping.probe.judge({question.name: heard}).findings] == ["answered"]
    assert [one.code for one in ping.probe.judge({question.name: earlier}).findings] == ["no-report"]
