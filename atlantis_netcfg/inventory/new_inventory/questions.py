"""Questions of `provision inventory init` on a terminal; invalid answers are refused and asked again."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel, ValidationError

from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory import _schema
from atlantis_netcfg.inventory._yaml import Node
from atlantis_netcfg.inventory.findings import Mark, why_no_name
from atlantis_netcfg.inventory.model import LinkRate
from atlantis_netcfg.inventory.new_inventory.answers import (
    MOST_SITES,
    PARTNERS,
    BridgeAnswers,
    CableAnswers,
    CentreAnswers,
    GatewayAnswers,
    LteAnswers,
    PilotAnswers,
    SatelliteAnswers,
    SiteAnswers,
    VpnAnswers,
)
from atlantis_netcfg.inventory.new_inventory.prompter import InvalidAnswer, Prompter

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

YES = frozenset({"yes", "y", "sim", "s"})
NO = frozenset({"no", "n", "não", "nao", ""})
_NUMBER = re.compile(r"-?[0-9]{1,15}(?:[.,][0-9]{1,15})?")
_THOUSANDS = re.compile(r"[1-9][0-9]{0,2}(?:([., '\u2019])[0-9]{3})(?:\1[0-9]{3})*(?:[.,][0-9]+)?")
"""A number with thousands separators, or with one that may be a decimal separator."""
_HERE = Mark("answer", 1, 1)
_EXAMPLE = "an EXAMPLE value"
_NOTHING = "excluded"


@dataclass(frozen=True, slots=True)
class Question:
    """A question for one key of a block."""

    key: str
    text: str
    without: str = _EXAMPLE
    """Default for an empty input; empty: an answer is required."""
    note: str = ""
    """A line above the question."""
    is_detail: bool = False
    """Whether only a person who wants all questions is asked."""


_PARTNERS_NOTE = msg(
    f"Of the report: {arg(join(', ', (f'{n} {name}' for n, name in enumerate(PARTNERS, 1))))}; any name."
)

_RATE = Question("rate", "Round trip in ms, kbit/s up and down (60 20000 20000)", is_detail=True)
_PROBE_TARGETS = Question(
    "canaries", "Two addresses beyond the link that may be pinged", "EXAMPLE, if needed", is_detail=True
)
_PLACE = (
    Question("title", "Name in everyday use", "its short name", is_detail=True),
    Question("lan", "Local network (like 10.20.1.0/24)"),
    Question("management", "Network of the management port (like 10.20.101.0/24)", is_detail=True),
    Question("domain", "DNS suffix of the local network", is_detail=True),
    Question("router_ports", "Ethernet ports of the router", is_detail=True),
)
_PILOT = (
    Question("name", "Name of the pilot", ""),
    Question("country", "Country of the radios (in the EU or EFTA; or later)", ""),
    Question("time_zone", "Time zone", "that of the country", is_detail=True),
    Question("time_servers", "Addresses of time servers", is_detail=True),
    Question("ros_distribution", "ROS 2 of the gateways (foxy, humble, jazzy)", "neither ROS nor DDS"),
    Question("partners", "Partners in the VPN (numbers or names, comma-separated)", "no partners", note=_PARTNERS_NOTE),
)
_VPN = (
    Question("endpoint", "Public address of the VPN server"),
    Question("endpoint_name", "DNS name of the VPN server"),
    Question("network", "Tunnel addresses, /20 or larger (like 10.80.0.0/16)", is_detail=True),
)
_CABLE = (
    Question("network", "Network between router and provider"),
    Question("address", "The router's address in it", "its second address", is_detail=True),
    Question("gateway", "The provider's box in it", "its first address", is_detail=True),
    _RATE,
)
_BRIDGE = (
    Question("network", "Network of the bridge, /29 or larger", is_detail=True),
    Question("ssid", "Name of the radio network (SSID)"),
    Question("protocol", "Protocol of the radios (nv2, 802.11)", "nv2", is_detail=True),
    Question("frequency_mhz", "Frequency in MHz (5 GHz band)"),
    Question("distance_m", "Distance in metres", is_detail=True),
    Question("antenna_gain_dbi", "Gain of the antennas in dBi", is_detail=True),
    Question("tx_power_dbm", "Power of the radios in dBm"),
    _PROBE_TARGETS,
    _RATE,
)
_LTE = (
    Question("network", "Network between router and 4G unit, /29 or larger", is_detail=True),
    Question("driver", "Unit (routeros, rutos, modemmanager, manual)", "manual: a person checks it"),
    Question("apn", "APN of the SIM's contract", "that of the network"),
    Question("price_per_mb", "Price of the contract in EUR for 1 MB", _NOTHING),
    _PROBE_TARGETS,
    _RATE,
)
_SATELLITE = (
    Question("network", "Network between router and terminal, /29 or larger", is_detail=True),
    Question("price_per_mb", "Price of the contract in EUR for 1 MB", _NOTHING),
)
_GATEWAY = (Question("ssh_key", "A technician's public SSH key (line of the .pub file)", "no card is made"),)
_PARTS: Sequence[tuple[str, str, type[BaseModel], Sequence[Question]]] = (
    ("wifi_bridge", "Is there a Wi-Fi bridge to the control centre?", BridgeAnswers, _BRIDGE),
    ("cable", "Is there a cable to a provider?", CableAnswers, (*_CABLE[:-1], _PROBE_TARGETS, _RATE)),
    ("lte", "Is there a 4G unit?", LteAnswers, _LTE),
    ("satellite", "Is there a satellite terminal?", SatelliteAnswers, _SATELLITE),
    ("gateway", "Is there a data gateway computer?", GatewayAnswers, _GATEWAY),
)
_CENTRE = "scc"
_LINKS = ("wifi_bridge", "cable", "lte", "satellite")


class Interview:
    """Asks a person, and returns the answers in the form of `InventoryAnswers`."""

    def __init__(
        self,
        ask: Callable[[str], str],
        tell: Callable[[str], None],
        keep: Callable[[Sequence[tuple[str, str]]], None] = lambda _: None,
        kept_answers: Sequence[tuple[str, str]] = (),
    ) -> None:
        self.prompter = Prompter(ask, tell, keep, kept_answers)
        self.block_name = ""
        """What is asked about: part of the key of each answer."""
        self.asks_all = True

    def answers(self) -> dict[str, Any]:
        """Ask all questions in order; `<` goes back one question."""
        return self.prompter.run(self._answers)

    def _answers(self) -> dict[str, Any]:
        self._start("The pilot")
        self.asks_all = self.yes("Ask for networks, ports, radio details and rates as well?")
        pilot = self.block(PilotAnswers, _PILOT)
        self._start("The VPN")
        vpn = self.block(VpnAnswers, _VPN)
        centre = self._centre() if self.asks_all else {"name": _CENTRE}
        sites = {}
        self._start("The test sites")
        for site in self.names("Short names of the test sites, comma-separated", "", other=centre["name"]):
            self._start(msg(f"The test site {arg(site)}"))
            sites[site] = self.site()
        return {"pilot": pilot, "vpn": vpn, "control_centre": centre, "sites": sites}

    def _centre(self) -> dict[str, Any]:
        self._start("The control centre, the far end of all links")
        (name,) = self.names("Its short name", _CENTRE)
        centre = {"name": name, **self.block(CentreAnswers, _PLACE)}
        self._start("Its link to the rest of the world")
        centre["uplink"] = self.block(CableAnswers, _CABLE)
        return {**centre, "computer": self.yes("Is there a computer for its services?")}

    def _start(self, heading: str) -> None:
        self.block_name = heading
        self.prompter.start_block(heading)

    def site(self) -> dict[str, Any]:
        """Ask about one test site with at least one link."""
        place = self.block(SiteAnswers, _PLACE)
        while True:
            for key, text, model, questions in _PARTS:
                if key not in place and self.yes(text):
                    place[key] = self.block(model, questions)
            if any(link in place for link in _LINKS):
                return place
            self.prompter.remark("A site needs a link: a bridge, a cable, 4G or a satellite.")

    def yes(self, text: str, default: str = "no") -> bool:
        """Ask a yes/no question."""

        def parse(answer: str) -> bool:
            word = (answer or default).lower()
            if word not in YES | NO:
                raise InvalidAnswer("Type yes or no.")
            return word in YES

        return self.prompter.answer(
            msg(f"{arg(self.block_name)}: {arg(text)}"), msg(f"{arg(text)} (yes/no)"), default, parse
        )

    def names(self, text: str, default: str, other: str = "") -> list[str]:
        """Ask for one or more distinct names."""

        def parse(answer: str) -> list[str]:
            names = [name.strip() for name in (answer or default).split(",") if name.strip()]
            problems = [f"{translate(why[0])}: {translate(why[1])}" for name in names if (why := why_no_name(name))]
            if default and len(names) > 1:
                problems.append("Type one name.")
            if len(names) > MOST_SITES:
                problems.append(msg(f"At most {arg(MOST_SITES)} sites are possible."))
            if not names or len(set(names)) < len(names) or other in names:
                problems.append("Type one name for each, all different.")
            if problems:
                raise InvalidAnswer(problems[0])
            return names

        return self.prompter.answer(msg(f"{arg(self.block_name)}: {arg(text)}"), text, default, parse)

    def block(self, model: type[BaseModel], questions: Sequence[Question]) -> dict[str, Any]:
        """Ask the questions about one block and return the answers by key; unanswered questions are left out."""
        asked_questions = [question for question in questions if self.asks_all or not question.is_detail]
        answers = {question.key: self.answer(model, question) for question in asked_questions}
        return {key: value for key, value in answers.items() if value is not None}

    def answer(self, model: type[BaseModel], question: Question) -> Any:  # noqa: ANN401 - as YAML has it
        """Ask a question until the answer is valid; return None if an optional question is left empty."""

        def parse(text: str) -> Any:  # noqa: ANN401 - as YAML has it
            if not text and question.without:
                return None
            value = parse_answer(model.model_fields[question.key].annotation, text)
            if (problem := validation_error(model, question.key, value)) is not None:
                raise InvalidAnswer(problem)
            return value

        key = msg(f"{arg(self.block_name)}: {arg(model.__name__)}.{arg(question.key)}")
        return self.prompter.answer(key, question.text, question.without, parse, question.note)


def parse_answer(annotation: Any, text: str) -> Any:  # noqa: ANN401 - a type, and what YAML holds
    """Convert a typed answer to the value that YAML would have read from a file.

    Raises InvalidAnswer for a number with a thousands separator.
    """
    if _schema.model_of(annotation) is LinkRate:
        numbers = [parse_number(part) for part in _numbers(text)]
        required_keys = [key for key, field in LinkRate.model_fields.items() if field.is_required()]
        return dict(zip(required_keys, numbers, strict=True)) if len(numbers) == len(required_keys) else text
    item = _schema.item_of(annotation)
    if annotation == PilotAnswers.model_fields["partners"].annotation:
        return _partner_names(text)
    if item is not None:
        return [parse_answer(item, part) for part in text.replace(",", " ").split()]
    kind = _schema.unwrap(annotation)
    return parse_number(text, has_fraction=kind is float) if kind in {int, float} else text


def _partner_names(text: str) -> list[str]:
    """Split a list of partners at commas; numbers and short names of the report's partners also at spaces.

    Raises InvalidAnswer for a number that no partner has.
    """
    short_names = list(PARTNERS)
    names: list[str] = []
    for part in filter(None, map(str.strip, text.split(","))):
        words = part.lower().split()
        is_known = all(word in short_names or word.isdecimal() for word in words)
        for word in words if is_known else [part]:
            if word.isdecimal() and word not in map(str, range(1, len(short_names) + 1)):
                raise InvalidAnswer(msg(f"Unknown partner {arg(word)}: type 1 to {arg(len(short_names))}, or a name."))
            names.append(short_names[int(word) - 1] if word.isdecimal() else word)
    return names


def _numbers(text: str) -> list[str]:
    """Split a list of numbers at spaces, in which a comma is a decimal comma; or at commas, without any space."""
    parts = text.split()
    return text.split(",") if len(parts) == 1 else [part.rstrip(",") for part in parts]


def parse_number(text: str, *, has_fraction: bool = True) -> int | float | str:
    """Parse a number with a decimal point or comma; return any other text as it is.

    Raises InvalidAnswer for a thousands separator, which may be a decimal one where it stands only once.
    """
    if _THOUSANDS.fullmatch(text):
        *groups, last = re.split(r"[^0-9]", text)
        separators = re.findall(r"[^0-9]", text)
        if has_fraction and separators in ([","], ["."]):
            whole, fraction = f"{groups[0]}{last}", f"{groups[0]}.{last}0"
            raise InvalidAnswer(
                msg(
                    f"`{arg(text)}` can mean {arg(whole)} or {arg(fraction[:-1])}: type {arg(whole)} or {arg(fraction)}"
                )
            )
        number = "".join([*groups, "." if len(set(separators)) > 1 else "", last])
        raise InvalidAnswer(msg(f"`{arg(text)}` has a thousands separator: type {arg(number)}"))
    if not _NUMBER.fullmatch(text):
        return text
    return int(text) if text.lstrip("-").isdigit() else float(text.replace(",", "."))


def validation_error(model: type[BaseModel], key: str, value: Any) -> str | None:  # noqa: ANN401 - as YAML has it
    """Return the validation error of an answer and what to type instead; None if the answer is valid."""
    try:
        model.model_validate({key: value})
    except ValidationError as error:
        errors = error.errors(include_url=False, include_input=False)
        first_error = next((item for item in errors if item["loc"][:1] == (key,)), None)
        if first_error is None:
            return None
        finding = _schema.explain(first_error, Node(_HERE, {key: _node(value)}), model, "answer")
        return f"{translate(finding.message)}: {translate(finding.hint)}"
    return None


def _node(value: Any) -> Node:  # noqa: ANN401 - as YAML has it
    if isinstance(value, list):
        return Node(_HERE, [_node(item) for item in value])
    if isinstance(value, dict):
        return Node(_HERE, {key: _node(item) for key, item in value.items()})
    return Node(_HERE, value, str(value), plain=True)
