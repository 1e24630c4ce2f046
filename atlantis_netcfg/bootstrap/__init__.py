"""First contact: from a box that comes out of its carton to a router that the engine can talk to.

What the device says on its own console is read, compared with the adopted state, and only what is missing is typed:
first everything that stands beside the way in use (user, certificate, api-ssl, management address), then, over the
management port and under safe mode, the default configuration goes, and last the factory's user. Because every run
reads before it types, a run that was cut anywhere is simply repeated. Trust begins at the console: the SSH host key is
pinned before a password is sent, the certificate by the fingerprint that the console prints, never by what TLS shows.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.lazy_imports import homes

if TYPE_CHECKING:
    from atlantis_netcfg.bootstrap._adopted import Adopted, Status
    from atlantis_netcfg.bootstrap._errors import CutOff, NotFactoryFresh, PreflightRefused, StillToMove, Unfinished
    from atlantis_netcfg.bootstrap._preflight import Objection, features_of, objections
    from atlantis_netcfg.bootstrap._read import look
    from atlantis_netcfg.bootstrap._run import FirstContact
    from atlantis_netcfg.bootstrap._steps import Line, Step, clear, close_door, prepare
    from atlantis_netcfg.bootstrap._ways import Doorway, Way
    from atlantis_netcfg.bootstrap.classify import foreign, recognise
    from atlantis_netcfg.bootstrap.target import CERTIFICATE, FACTORY_ADDRESS, FACTORY_USER, Facts, Standing, Wish

__all__ = [
    "CERTIFICATE",
    "FACTORY_ADDRESS",
    "FACTORY_USER",
    "Adopted",
    "CutOff",
    "Doorway",
    "Facts",
    "FirstContact",
    "Line",
    "NotFactoryFresh",
    "Objection",
    "PreflightRefused",
    "Standing",
    "Status",
    "Step",
    "StillToMove",
    "Unfinished",
    "Way",
    "Wish",
    "clear",
    "close_door",
    "features_of",
    "foreign",
    "look",
    "objections",
    "prepare",
    "recognise",
]

__getattr__ = homes(
    __name__,
    {
        "_adopted": ("Adopted", "Status"),
        "_errors": ("CutOff", "NotFactoryFresh", "PreflightRefused", "StillToMove", "Unfinished"),
        "_preflight": ("Objection", "features_of", "objections"),
        "_read": ("look",),
        "classify": ("foreign", "recognise"),
        "_run": ("FirstContact",),
        "_steps": ("Line", "Step", "clear", "close_door", "prepare"),
        "_ways": ("Doorway", "Way"),
        "target": ("CERTIFICATE", "FACTORY_ADDRESS", "FACTORY_USER", "Facts", "Standing", "Wish"),
    },
)
