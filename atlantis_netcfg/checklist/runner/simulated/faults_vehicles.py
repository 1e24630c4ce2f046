"""Faults of vehicles: receivers, acoustic modems, an autopilot."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.checklist.runner.simulated._fault import Fault
from atlantis_netcfg.emulator.gnss import Access, Speech

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from atlantis_netcfg.checklist.runner.simulated._world import World


def _receiver(vehicle: str, **changes: Any) -> Callable[[World], None]:  # noqa: ANN401 - fields of its spec
    return lambda world: world.receiver(vehicle, **changes)


def _modem(vehicle: str, **changes: Any) -> Callable[[World], None]:  # noqa: ANN401 - fields of its spec
    return lambda world: world.modem(vehicle, **changes)


def _autopilot(vehicle: str, **changes: Any) -> Callable[[World], None]:  # noqa: ANN401 - fields of its spec
    return lambda world: world.autopilot(vehicle, **changes)


def _sent_from(vehicle: str, address: str) -> Callable[[World], None]:
    def spoil(world: World) -> None:
        world.autopilots[vehicle] = replace(world.autopilots[vehicle], address=address)

    return spoil


_GPS = {
    "gps-no-fix": Fault(
        "the receiver of Girona 500 has no fix under an open sky", ("girona500/gps",), _receiver("girona500", mode=1)
    ),
    "gps-stale": Fault(
        "the receiver of Sparus repeats an old position", ("sparus/gps",), _receiver("sparus", stale=True)
    ),
    "gps-lost": Fault(
        "the receiver of Zarco loses its fix while it is watched", ("zarco/gps",), _receiver("zarco", lost_after=2)
    ),
    "gps-swapped": Fault(
        "the receiver of Mares has longitude and latitude exchanged", ("mares/gps",), _receiver("mares", swapped=True)
    ),
    "gps-elsewhere": Fault(
        "the receiver of Sparus tells a position far from the site", ("sparus/gps",), _receiver("sparus", latitude=41.2)
    ),
    "gps-simulated": Fault(
        "the receiver of Zarco tells simulated positions", ("zarco/gps",), _receiver("zarco", status=8)
    ),
    "gps-clock": Fault(
        "the receiver of Stork is ten minutes behind", ("stork/gps",), _receiver("stork", time_offset_s=-600.0)
    ),
    "gps-no-satellites": Fault(
        "the receiver of Mares tells a position that no satellite gives",
        ("mares/gps",),
        _receiver("mares", satellites=0),
    ),
    "gps-silent": Fault(
        "the receiver of Mares says nothing", ("mares/gps",), _receiver("mares", speech=Speech.NOTHING)
    ),
    "gps-in-use": Fault(
        "the gpsd of Stork is held by its own software", ("stork/gps",), _receiver("stork", access=Access.IN_USE)
    ),
    "gps-gone": Fault("no gpsd runs on Zarco", ("zarco/gps",), _receiver("zarco", access=Access.REFUSED)),
}
_GIRONA_MODEM = ("girona500/acoustic", "girona500/acoustic/fleet", "girona500/acoustic/message", "girona500/usbl")
_SPARUS_MODEM = ("sparus/acoustic", "girona500/acoustic/fleet", "sparus/acoustic/message", "sparus/usbl")
_ZARCO_MODEM = ("zarco/acoustic", "zarco/acoustic/fleet", "zarco/usbl", "zarco/usbl/ping")
_ACOUSTIC = {
    "modem-silent": Fault("the modem of Girona 500 is silent", _GIRONA_MODEM, _modem("girona500", silent=True)),
    "modem-in-use": Fault(
        "the modem of Sparus is held by its own software", _SPARUS_MODEM, _modem("sparus", held=True)
    ),
    "modem-alarm": Fault(
        "the modem of Sparus tells an internal error",
        ("sparus/acoustic", "sparus/acoustic/message"),
        _modem("sparus", state="OFFLINE ALARM"),
    ),
    "modem-twice": Fault(
        "the modem of Sparus has the acoustic address of Girona 500",
        _SPARUS_MODEM,
        _modem("sparus", local_address=1),
    ),
    "modem-foreign": Fault(
        "another modem than that of Girona 500 answers at its end",
        _GIRONA_MODEM,
        _modem("girona500", local_address=9),
    ),
    "modem-packet-time": Fault(
        "the modem of Sparus has another packet time than the fleet",
        ("girona500/acoustic/fleet",),
        _modem("sparus", packet_time_ms=500),
    ),
    "modem-loud": Fault(
        "the modem of Girona 500 is set to a source level that is not for air",
        ("girona500/acoustic", "girona500/acoustic/message"),
        _modem("girona500", source_level=0),
    ),
    "beacon-damaged": Fault(
        "every answer of Zarco's beacon has a wrong sum", _ZARCO_MODEM, _modem("zarco", every_sum_wrong=True)
    ),
    "usbl-nobody": Fault("nobody answers the pings of Mares", ("mares/usbl",), _modem("mares", fixes=0)),
    "usbl-frozen": Fault("the modem of Mares repeats one fix", ("mares/usbl",), _modem("mares", frozen=True)),
    "usbl-foreign": Fault(
        "the modem of Mares hears a modem that is not the declared one", ("mares/usbl",), _modem("mares", hears=(9,))
    ),
    "usbl-off": Fault(
        "the modem of Girona 500 does not put its fixes out",
        ("girona500/usbl",),
        _modem("girona500", tells_fixes=False),
    ),
}
_REMOTE = {
    "rc-armed": Fault("Stork is armed", ("stork/rc_rf", "stork/rc_rf/sticks"), _autopilot("stork", armed=True)),
    "rc-sticks-dead": Fault(
        "the channels of Stork do not follow the sticks", ("stork/rc_rf/sticks",), _autopilot("stork", moving=0)
    ),
    "rc-silent": Fault(
        "no stream of Stork's autopilot arrives",
        ("stork/rc_rf", "stork/rc_rf/sticks"),
        _autopilot("stork", silent=True),
    ),
    "rc-foreign": Fault(
        "another computer sends as the autopilot of Stork",
        ("stork/rc_rf", "stork/rc_rf/sticks"),
        _sent_from("stork", "10.64.1.199"),
    ),
    "rc-receiver-sick": Fault(
        "the autopilot of Stork calls its RC receiver sick",
        ("stork/rc_rf",),
        _autopilot("stork", receiver_healthy=False),
    ),
}
FAULTS: Mapping[str, Fault] = {**_GPS, **_ACOUSTIC, **_REMOTE}
