"""What a modem twin is made of: the card in it, and the cell that it hears."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

_Plmn = Annotated[str, Field(pattern=r"[0-9]{5,6}")]


class _Spec(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class SimSpec(_Spec):
    """A SIM; 001-01 is the test network of 3GPP TS 36.508."""

    home: _Plmn = "00101"
    """The network whose card it is; in any other it roams."""
    pin: Annotated[str, Field(pattern=r"|[0-9]{4,8}")] = ""
    """Empty: the card asks for none."""
    tries: int = Field(default=3, ge=0, le=3)
    """Wrong PINs that it takes from now on; with none left it asks for its PUK."""


class CellSpec(_Spec):
    """The network at the site."""

    plmn: _Plmn = "00101"
    operator: str = "EXAMPLE"
    bands: tuple[int, ...] = (3,)
    """LTE bands in which it can be heard."""
    apns: tuple[str, ...] = ()
    """Access points that it has; none: any name will do."""
    own_apn: str = "internet"
    """What it gives to a modem that asks for the network's own."""
    address: str = "100.72.9.14"
    """What it gives to the modem: carriers translate addresses (RFC 6598)."""
    denies: bool = False
    """It refuses this card."""
    rsrp_dbm: int = -97
    rsrq_db: int = -9
    sinr_db: int = 6


class ModemSpec(_Spec):
    """The modem of a board; `sim` None is an empty slot, `cell` None is no coverage."""

    name: str = "lte1"
    """Factory name."""
    mbim: bool = True
    """Driven by MBIM: only then `use-network-apn` means anything (Manual, LTE/5G)."""
    bands: tuple[int, ...] = (1, 3, 7, 8, 20, 28, 38, 40)
    """LTE bands that it has."""
    sim: SimSpec | None = SimSpec()
    cell: CellSpec | None = CellSpec()
