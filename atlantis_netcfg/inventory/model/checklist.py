"""Extra items of the pre-test checklist, missions, and persons who may answer.

They are in `checklist` of a site (`group_vars/<site>.yml`) and of a vehicle. The texts are shown unchanged, and are
never translated.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Self

from pydantic import BeforeValidator, Field, StrictFloat, StrictInt, model_validator

from atlantis_netcfg.core import reading_programs
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory.model import _base
from atlantis_netcfg.inventory.model.endpoints import SeenFrom


class Phase(StrEnum):
    """Phase of a test in which an item is checked, in this order."""

    BENCH = "bench"
    QUAY = "quay"
    WATER = "in water"
    RECOVERY = "recovery"
    """When the vehicles are back: a checklist of its own, with a signature of its own."""
    INTEGRATION = "integration"
    """When a robot joins the pilot: a record of its own for each robot, with a signature of its own."""

    @property
    def is_alone(self) -> bool:
        """Whether the items of this phase form a separate list."""
        return self in {Phase.RECOVERY, Phase.INTEGRATION}


class ItemSort(StrEnum):
    """Who checks an item."""

    PERSON = "person"
    """Somebody looks, and answers by name."""
    COMMAND = "command"
    """A program of the closed list is run, and what it prints is compared."""


class EvidenceKind(StrEnum):
    """What a person has to add to the answer that the item holds."""

    NONE = "none"
    TEXT = "text"
    NUMBER = "number"
    """Read from a display or a meter; outside its range it does not pass."""
    PHOTO = "photo"


def _reading(value: object) -> str:
    text = " ".join(_base.plain(value).split())
    if not reading_programs.is_allowed(tuple(text.split())):
        first = text.partition(" ")[0]
        if first in reading_programs.names():
            raise _base.wrong(
                msg(f"`{arg(text)}` is not a form of `{arg(first)}` that the checklist can run"),
                "docs/checklist.md lists the forms",
            )
        programs = join(", ", reading_programs.names())
        raise _base.wrong(
            msg(f"the checklist may not run `{arg(text)}`"),
            msg(f"it runs only programs that read: {arg(programs)} (docs/checklist.md)"),
        )
    return text


ReadingCommand = Annotated[
    str, BeforeValidator(_reading), _base.text_like(f"^({'|'.join(reading_programs.PROGRAMS)})$")
]
"""A command line of the closed list (`core/reading_programs.py`)."""
_OF_A_PERSON = ("look_for", "evidence", "unit", "min", "max", "by")
_OF_A_COMMAND = ("command", "expect", "seen_from")


class CheckItem(_base.Model):
    """An item that the pilot adds to the checklist. Items are asked in the order of the list."""

    id: _base.Name
    """Last part of the item's id in the list: `battery` of Sparus is `sparus/items/battery`."""
    text: _base.Text
    """What is asked, or checked, in the words that people read."""
    phase: Phase
    """When its turn is. `recovery`, when the vehicles are back, and `integration` are lists of their own."""
    kind: ItemSort = ItemSort.PERSON
    """Who finds out."""
    look_for: _base.Text | None = None
    """For a person, required: what tells that it is well."""
    evidence: EvidenceKind = EvidenceKind.NONE
    """For a person: what is given besides the answer, without which it does not pass."""
    unit: _base.Text | None = None
    """Of a number, required."""
    min: StrictFloat | None = None
    """Of a number: less does not pass."""
    max: StrictFloat | None = None
    """Of a number: more does not pass."""
    by: tuple[_base.Text, ...] = ()
    """For a person: names, or roles of the pilot, that alone may answer or override it; none: anybody."""
    command: ReadingCommand | None = None
    """For a command, required: what is run; programs that only read, from a closed list (docs/checklist.md)."""
    expect: _base.Text | None = None
    """For a command, required: a whole line that it has to print; `*` stands for any characters."""
    seen_from: SeenFrom = SeenFrom.GATEWAY
    """For a command: where it is run."""

    @model_validator(mode="after")
    def _check_kind_fields(self) -> Self:
        person = self.kind is ItemSort.PERSON
        fields, names = type(self).model_fields, _OF_A_COMMAND if person else _OF_A_PERSON
        others = [name for name in names if getattr(self, name) != fields[name].default]
        if others:
            raise _base.wrong(
                msg(f"`{arg(self.id)}` is of kind {arg(self.kind)}, but has `{arg(others[0])}`"),
                msg(f"remove `{arg(others[0])}:`, or correct `kind:`"),
            )
        required_names = ("look_for",) if person else ("command", "expect")
        for name in required_names:
            if getattr(self, name) is None:
                raise _base.wrong(
                    msg(f"`{arg(self.id)}` is of kind {arg(self.kind)}, but has no `{arg(name)}`"),
                    msg(f"add `{arg(name)}:`"),
                )
        return self

    @model_validator(mode="after")
    def _check_evidence_fields(self) -> Self:
        number = self.evidence is EvidenceKind.NUMBER
        number_fields = [name for name in ("unit", "min", "max") if getattr(self, name) is not None]
        if number_fields and not number:
            raise _base.wrong(
                msg(f"`{arg(self.id)}` has `{arg(number_fields[0])}`, but asks for no number"),
                "write `evidence: number`, or remove it",
            )
        if number and self.unit is None:
            raise _base.wrong(
                msg(f"`{arg(self.id)}` asks for a number, but has no `unit`"), "add `unit:`, for example V or bar"
            )
        if number and self.min is None and self.max is None:
            raise _base.wrong(
                msg(f"`{arg(self.id)}` asks for a number, but has no limits"), "add `min:` or `max:`, or both"
            )
        if self.min is not None and self.max is not None and self.min > self.max:
            raise _base.wrong(
                msg(f"`min: {arg(self.min):g}` of `{arg(self.id)}` is above `max: {arg(self.max):g}`"),
                "set `min` to the smaller number",
            )
        return self


class SiteCheckItem(CheckItem):
    """The same, declared at a site or for a mission: of the site itself, or of a vehicle that is tested there."""

    vehicle: _base.Name | None = None
    """Key of the vehicle that it is about; None: the site."""

    @model_validator(mode="after")
    def _require_vehicle(self) -> Self:
        if self.phase is Phase.INTEGRATION and self.vehicle is None:
            raise _base.wrong(
                msg(f"`{arg(self.id)}` has `phase: integration`, but no vehicle"),
                "add `vehicle:`: a record is for one robot",
            )
        return self


class VehicleChecklist(_base.Model):
    """What the checklist asks of a vehicle besides its endpoints, wherever it is tested."""

    items: tuple[CheckItem, ...] = ()
    """In the order in which they are asked."""


class Mission(_base.Model):
    """Items that are asked for one sort of test alone: `provision check site=SITE mission=NAME`."""

    name: _base.Name
    """What `mission=` says."""
    title: _base.Text
    """What people call it."""
    items: Annotated[tuple[SiteCheckItem, ...], Field(min_length=1)]
    """In the order in which they are asked."""


class Role(_base.Model):
    """Who may answer, or sign, for a role."""

    name: _base.Name
    """What `by` and `signed_by` say."""
    people: Annotated[tuple[_base.Text, ...], Field(min_length=1)]
    """Their names, as they stand in the report. A name is what somebody types: nothing proves it."""


class Geofence(_base.Model):
    """Where the robots of a site are when they are tested; decimal degrees, WGS 84."""

    latitude: Annotated[StrictFloat, Field(ge=-90, le=90)]
    """Of its centre, north is positive."""
    longitude: Annotated[StrictFloat, Field(ge=-180, le=180)]
    """Of its centre, east is positive."""
    radius_m: Annotated[StrictFloat, Field(gt=0, le=100_000)]
    """Positions may be so far from the centre, in metres."""


class ChecklistSettings(_base.Model):
    """What the pre-test checklist of a site needs to know besides the devices."""

    vehicles: tuple[_base.Name, ...] | None = None
    """Keys of the vehicles that are tested here; None: every vehicle of the pilot."""
    geofence: Geofence | None = None
    """Where they are then; None: positions are not compared with a place, and the report says so."""
    answer_within_s: Annotated[StrictFloat, Field(gt=0, le=60)] | None = None
    """What is sent to the control centre is answered in so many seconds, or the checklist fails; None: not judged."""
    qualified_within_days: Annotated[StrictInt, Field(ge=1, le=3650)] = 30
    """A measurement of a link (`provision measure link`) that is older proves nothing; 30 days are our proposal."""
    items: tuple[SiteCheckItem, ...] = ()
    """What is asked here besides all else, in this order."""
    missions: tuple[Mission, ...] = ()
    """Lists that are asked on top, one of them at a time."""
    signed_by: tuple[_base.Text, ...] = ()
    """Names, or roles of the pilot, that alone may sign the list; none: anybody."""
