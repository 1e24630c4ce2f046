"""Link measurements: the far end at the control centre, and the requirements on a link."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

from pydantic import Field, StrictFloat, StrictInt

from atlantis_netcfg.inventory.model import _base

KEY_OCTETS = 16
"""A key that is shorter is refused by the far end, and here."""


class ThresholdsName(StrEnum):
    """The thresholds that are shipped: `qualify/profiles.yml` has them, and a test holds that both are the same."""

    SATELLITE = "satellite"
    LTE = "lte"
    WIFI = "wifi"


class Qualify(_base.Model):
    """The responder to test packets of `provision measure link`: our own program, on this host only."""

    reflector: _base.HostName
    """The control centre that is the far end of every link."""
    address: _base.Address | None = None
    """Public address at which every site reaches it; null: `vpn.endpoint`."""
    port: Annotated[StrictInt, Field(ge=1, le=65535)] = 862
    """UDP, the same outside and inside; 862 is that of STAMP (RFC 8762). The router of its site forwards it."""
    key: _base.SecretText
    """Who has it is answered. At least 16 octets, vaulted, or EXAMPLE-…."""


class LinkThresholds(_base.Model):
    """Limits that `provision measure link` applies to a link: thresholds by name, and deviations from them."""

    profile: ThresholdsName | None = None
    """`satellite`, `lte` or `wifi`; null: those of the kind of the link (of a plain cable those of `wifi`)."""
    ftd_s: Annotated[StrictFloat, Field(gt=0)] | None = None
    """95th percentile of the round trip without load, in seconds."""
    fdv_s: Annotated[StrictFloat, Field(gt=0)] | None = None
    """95th percentile of the delay above the least, each way, in seconds."""
    flr: Annotated[StrictFloat, Field(ge=0, lt=1)] | None = None
    """Share of packets that may be lost outside of gaps, each way."""
    gap_s: Annotated[StrictFloat, Field(gt=0)] | None = None
    """Longest time without an arrival, in seconds."""
    avail: Annotated[StrictFloat, Field(gt=0, le=1)] | None = None
    """Share of the time outside gaps of more than a second."""
    buffer_delay: Annotated[StrictFloat, Field(gt=0)] | None = None
    """How much longer the median round trip is under load, as a share of that without load (RFC 6349)."""
    min_samples: Annotated[StrictInt, Field(ge=1)] | None = None
    """Fewer packets prove nothing."""
