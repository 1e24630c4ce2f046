"""One end of the directional Wi-Fi bridge. `host_vars/<host>.yml`, key `device`."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Literal

from pydantic import Field, StrictBool, StrictInt

from atlantis_netcfg.declaration.model._base import HostName, Model, PortName, SecretText, Ssid
from atlantis_netcfg.declaration.model._box import Access, Box

__all__ = ["Cpe", "Ptp", "PtpMode", "PtpProtocol", "RadioMenus", "SignalBounds"]


class PtpMode(StrEnum):
    """Which end of the bridge."""

    ACCESS_POINT = "access_point"
    STATION = "station"


class PtpProtocol(StrEnum):
    """RouterOS' words for `wireless-protocol`."""

    IEEE_80211 = "802.11"
    NSTREME = "nstreme"
    NV2 = "nv2"


class RadioMenus(StrEnum):
    """Which of RouterOS' two families of radio menus the device has."""

    AUTO = "auto"
    """What the device has; asked when it is read."""
    WIRELESS = "wireless"
    """The package `wireless`: nv2, nstreme and 802.11."""
    WIFI = "wifi"
    """The packages `wifi-qcom` and `wifi-qcom-ac`: 802.11 only."""


class SignalBounds(Model):
    """Between which levels the other end is to be heard; a receiver is also spoilt by too much."""

    weakest_dbm: Annotated[StrictInt, Field(ge=-95, le=-30)] = -75
    strongest_dbm: Annotated[StrictInt, Field(ge=-60, le=-10)] = -35


class Ptp(Model):
    """Radio settings of one end; both ends must agree."""

    peer: HostName
    mode: PtpMode
    ssid: Ssid
    protocol: PtpProtocol
    standard: Literal["802.11a", "802.11g", "802.11n", "802.11ac", "802.11ax"]
    band: Literal["2ghz", "5ghz"]
    frequency_mhz: StrictInt
    width_mhz: Literal[20, 40, 80] = 20
    country: Literal["portugal", "belgium"]
    outdoor: StrictBool = True
    key: SecretText
    wpa: Literal["wpa2", "wpa3"] = "wpa2"
    """With protocol 802.11; wpa3 exists in the `wifi` menus only."""
    menus: RadioMenus = RadioMenus.AUTO
    tx_power_dbm: Annotated[StrictInt, Field(ge=0, le=40)] | None = None
    """At the antenna's socket; None leaves it to the country's limit, which is too much for a short link."""
    antenna_gain_dbi: Annotated[StrictInt, Field(ge=0, le=30)] | None = None
    """From the antenna's data sheet; with it the radiated power is held below the country's limit.

    RouterOS' `wifi` menus take 30 at most.
    """
    distance_m: Annotated[StrictInt, Field(ge=1, le=50_000)] | None = None
    """Between the ends."""
    signal: SignalBounds = SignalBounds()
    link_timeout_s: Annotated[StrictInt, Field(ge=60, le=1800)] = 300
    """When both ends change: if the link is not back after so long they return to what they were."""


class Cpe(Box):
    """One end of the directional Wi-Fi bridge."""

    kind: Literal["cpe"]
    access: Access
    port: PortName = "ether1"
    """The port of the cable to the router, by its factory name; power comes in by it, too."""
    ptp: Ptp
