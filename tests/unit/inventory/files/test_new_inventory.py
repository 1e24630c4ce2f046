"""`provision inventory init`: what is written from answers, what is refused, and that it is all or nothing."""

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
import yaml
from hints_said import advised
from pydantic import BaseModel
from schema_reader import EditorLoader, files, problems, schema_of

from atlantis_netcfg.cli import main
from atlantis_netcfg.cli.inventory import _encrypt
from atlantis_netcfg.core import language
from atlantis_netcfg.core.errors import ExitCode, UsageError
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.inventory import load
from atlantis_netcfg.inventory.new_inventory.answers import (
    BridgeAnswers,
    InventoryAnswers,
    LteAnswers,
    PilotAnswers,
    SiteAnswers,
)
from atlantis_netcfg.inventory.new_inventory.questions import _PILOT, Interview, Question, validation_error
from atlantis_netcfg.inventory.new_inventory.yaml_text import Tree, Value, VaultSecret, document
from atlantis_netcfg.operations.common.vault import Vault

if TYPE_CHECKING:
    from collections.abc import Iterator

SHIPPED = Path(__file__).parents[4] / "inventory"
LEAST = """\
pilot: {name: Douro, country: belgium}
sites:
  pier: {lte: {}, wifi_bridge: {}}
  boat: {wifi_bridge: {}, satellite: {}, gateway: {}, cable: {}}
"""


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("ANSIBLE_VAULT_PASSWORD_FILE", raising=False)
    monkeypatch.delenv("ANSIBLE_VAULT_IDENTITY_LIST", raising=False)
    Path("answers.yml").write_text(LEAST, encoding="utf-8")


@pytest.mark.parametrize(("country", "zone"), [("spain", "Europe/Madrid"), ("cyprus", "Asia/Nicosia")])
def test_inventory_of_another_european_country_is_valid(country: str, zone: str) -> None:
    Path("answers.yml").write_text(LEAST.replace("belgium", country), encoding="utf-8")
    assert main(["inventory", "init", "douro", "--answers", "answers.yml"]) == ExitCode.DONE
    pilot = load(Path("douro")).pilot
    assert (pilot.country, pilot.time_zone) == (country, zone)


def test_country_is_asked_for_later_and_until_then_real_radios_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    Path("answers.yml").write_text(LEAST.replace("belgium", "later"), encoding="utf-8")
    assert main(["inventory", "init", "douro", "--answers", "answers.yml"]) == ExitCode.DONE
    inventory = load(Path("douro"))
    pilot = inventory.pilot
    assert (pilot.country, pilot.time_zone, pilot.example_values) == ("later", "UTC", True)
    assert {"country", "time_zone"} <= {example.key for example in inventory.examples}
    rules = "the radio rules of the country are unknown: rehearsals use the European ones, real runs are refused"
    assert [finding.message for finding in inventory.warnings if finding.file.endswith("pilot.yml")] == [rules]
    _declare_real(Path("douro"))
    capsys.readouterr()
    assert main(["inventory", "validate", "inventory=douro"]) == ExitCode.USAGE
    assert capsys.readouterr().err.splitlines()[0] == f"douro/group_vars/all/pilot.yml:8:12: {rules}"


def test_inventory_without_radios_needs_no_country(capsys: pytest.CaptureFixture[str]) -> None:
    answers = "pilot: {name: Douro, country: later}\nsites:\n  pier: {lte: {}}\n"
    Path("answers.yml").write_text(answers, encoding="utf-8")
    assert main(["inventory", "init", "douro", "--answers", "answers.yml"]) == ExitCode.DONE
    assert [finding for finding in load(Path("douro")).warnings if finding.file.endswith("pilot.yml")] == []
    _declare_real(Path("douro"))
    assert main(["inventory", "validate", "inventory=douro"]) == ExitCode.USAGE
    assert "radio rules" not in capsys.readouterr().err


def _declare_real(folder: Path) -> None:
    """Remove the marks of example values, and declare that there are none."""
    for path in folder.rglob("*.yml"):
        text = path.read_text(encoding="utf-8").replace(" # EXAMPLE", "")
        path.write_text(text.replace("example_values: true", "example_values: false"), encoding="utf-8")


def test_unanswered_values_are_omitted_or_marked_as_examples(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inventory", "init", "douro", "--answers", "answers.yml"]) == ExitCode.DONE
    said = capsys.readouterr().out.splitlines()
    assert advised(said[2]) == [["inventory", "validate", "inventory=douro", "--examples"]]
    assert main(advised(said[2])[0]) == ExitCode.DONE
    assert "  group_vars/pier.yml:" in capsys.readouterr().out
    assert said[0] == "douro: written and validated, no errors, 12 hosts at 3 sites"
    declaration = load(Path("douro"))
    assert said[1] == f"{len(declaration.examples)} values are examples: this inventory is for rehearsals only."
    assert declaration.pilot.example_values
    assert declaration.pilot.time_zone == "Europe/Brussels"
    assert declaration.pilot.dds is None
    assert all(bearer.billing is None for site in declaration.sites.values() for bearer in site.bearers)
    assert all(vehicle.endpoints.wifi is None for vehicle in declaration.vehicles.values())
    keys = {example.key for example in declaration.examples}
    assert keys >= {"frequency_mhz", "rtt_ms", "network", "canaries", "password", "endpoint"}


def test_generated_files_match_the_schema(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inventory", "init", "folder=douro", "--answers", "answers.yml", "--json"]) == ExitCode.DONE
    assert len(json.loads(capsys.readouterr().out)["hosts"]) == 12
    for path in files(Path("douro").absolute()):
        schema = schema_of(path)
        assert schema is not None
        assert problems(path, schema) == [], path


def test_any_organisation_can_be_a_partner_with_a_pool_of_its_own() -> None:
    names = ", ".join(["inesc", "Blue Ocean", *(f"partner {n}" for n in range(13))])
    pilot = f"{{name: Douro, country: belgium, partners: [{names}]}}"
    Path("answers.yml").write_text(f"pilot: {pilot}\nvpn: {{network: 10.80.0.0/20}}\nsites:\n  pier: {{lte: {{}}}}\n")
    assert main(["inventory", "init", "douro", "--answers", "answers.yml"]) == ExitCode.DONE
    partners = load(Path("douro")).partners
    assert partners["inesc"].full_name == "INESC TEC"
    assert partners["blue-ocean"].full_name == "Blue Ocean"
    assert str(partners["blue-ocean"].vpn_pool) == "10.80.2.0/24"
    assert len({partner.vpn_pool for partner in partners.values()}) == len(partners) == 15


def test_the_example_is_copied_whole(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inventory", "init", "mine", "--from", "example"]) == ExitCode.DONE
    assert "13 hosts at 3 sites" in capsys.readouterr().out
    copied = {path.relative_to("mine"): path.read_bytes() for path in Path("mine").rglob("*") if path.is_file()}
    shipped = {path.relative_to(SHIPPED): path.read_bytes() for path in SHIPPED.rglob("*") if path.is_file()}
    assert {name: data for name, data in copied.items() if name != Path("README.md")} == shipped


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["douro", "--from", "nothing"], "`--from nothing`: unknown value"),
        (
            ["douro", "--from", "example", "--answers", "answers.yml"],
            "`--from` and `--answers` cannot be used together",
        ),
        (["douro", "boat", "--answers", "answers.yml"], "unexpected argument"),
        (["no/such/folder", "--answers", "answers.yml"], "the folder above no/such/folder does not exist"),
        (["answers.yml", "--from", "example"], "answers.yml is not a folder"),
        (["douro", "--answers", "nowhere.yml"], "the answers cannot be read: nowhere.yml"),
        (["douro"], "no terminal to ask questions; nothing was written"),
    ],
)
def test_invalid_arguments_are_refused(words: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inventory", "init", *words]) == ExitCode.USAGE
    assert message in capsys.readouterr().err
    assert [path.name for path in Path().iterdir()] == ["answers.yml"]


def test_non_empty_folder_is_left_alone(capsys: pytest.CaptureFixture[str]) -> None:
    Path("douro").mkdir()
    Path("douro/letter.txt").write_text("mine", encoding="utf-8")
    assert main(["inventory", "init", "douro", "--from", "example"]) == ExitCode.USAGE
    assert "douro is not empty, so nothing was written" in capsys.readouterr().err
    assert [path.name for path in Path("douro").iterdir()] == ["letter.txt"]


def test_empty_folder_is_accepted() -> None:
    Path("douro").mkdir()
    assert main(["inventory", "init", "douro", "--from", "example"]) == ExitCode.DONE


def test_invalid_answers_are_reported_with_their_lines(capsys: pytest.CaptureFixture[str]) -> None:
    Path("answers.yml").write_text(
        "pilot: {name: Douro, country: brazil}\nsites:\n  pier:\n    lan: 10.0.0.0/30\n    lte: {}\n", encoding="utf-8"
    )
    assert main(["inventory", "init", "douro", "--answers", "answers.yml"]) == ExitCode.USAGE
    said = capsys.readouterr().err.splitlines()
    assert said[0].startswith("answers.yml:1:31: `brazil` is not a valid value for `country`")
    assert said[2:4] == ["answers.yml:4:10: 10.0.0.0/30 is too small here", "  -> use a network of /26 or larger"]
    assert said[-1] == "2 errors in the answers; nothing was written"
    assert not Path("douro").exists()


def test_site_cannot_have_the_name_of_the_control_centre(capsys: pytest.CaptureFixture[str]) -> None:
    Path("answers.yml").write_text(LEAST.replace("pier:", "scc:"), encoding="utf-8")
    assert main(["inventory", "init", "douro", "--answers", "answers.yml"]) == ExitCode.USAGE
    assert "`scc` is the name of both the control centre and a site" in capsys.readouterr().err


def test_contradictory_answers_write_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    Path("answers.yml").write_text(
        "pilot: {name: Douro, country: portugal}\nsites:\n  pier: {lan: 10.80.0.0/24, lte: {}}\n", encoding="utf-8"
    )
    assert main(["inventory", "init", "douro", "--answers", "answers.yml"]) == ExitCode.USAGE
    said = capsys.readouterr().err
    assert "overlaps 10.80.0.0/24 of the LAN of `pier` (douro/group_vars/pier.yml:" in said
    assert "nothing was written" in said
    assert [path.name for path in Path().iterdir()] == ["answers.yml"]


def test_passwords_are_generated_and_encrypted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    password = tmp_path / "password"
    password.write_text("of a test\n", encoding="utf-8")
    monkeypatch.setenv("ANSIBLE_VAULT_PASSWORD_FILE", str(password))
    monkeypatch.setattr("atlantis_netcfg.operations.common.vault.is_configured", lambda: True)
    sealed: list[str] = []

    def encrypt(_: object, text: str) -> str:
        sealed.append(text)
        return f"$ANSIBLE_VAULT;1.1;AES256\n{len(sealed):04}"

    monkeypatch.setattr("atlantis_netcfg.operations.common.vault.Vault.encrypt", encrypt)
    assert main(["inventory", "init", "douro", "--answers", "answers.yml"]) == ExitCode.DONE
    assert len(set(sealed)) == len(sealed) >= 8
    assert min(map(len, sealed)) >= 20
    written = "".join(path.read_text(encoding="utf-8") for path in files(Path("douro")))
    assert not [secret for secret in sealed if secret in written]
    assert "EXAMPLE-password" not in written
    ends = [load(Path("douro")).hosts[host].device for host in ("boat-cpe", "scc-cpe-boat")]
    assert ends[0].ptp.key == ends[1].ptp.key  # type: ignore[union-attr]  # both are CPEs


def test_a_password_for_the_vault_is_typed_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("atlantis_netcfg.operations.common.vault.is_configured", lambda: False)
    typed = iter(["of a test", "of a test", "of a test", "of a toast", ""])
    monkeypatch.setattr("getpass.getpass", lambda _: next(typed))
    encrypt = _encrypt(ask=True)
    assert encrypt is not None
    sealed = encrypt("the secret")
    assert sealed.startswith("$ANSIBLE_VAULT;1.1;AES256\n")
    assert Vault(lambda _: Secret("of a test")).decrypt(sealed) == "the secret"
    with pytest.raises(UsageError, match="the two entries differ"):
        _encrypt(ask=True)
    assert _encrypt(ask=True) is None
    assert _encrypt(ask=False) is None


class TestInterview:
    def interview(self, answers: list[str]) -> tuple[Interview, list[str], list[str]]:
        waiting: Iterator[str] = iter(answers)
        asked: list[str] = []
        told: list[str] = []

        def ask(prompt: str) -> str:
            asked.append(prompt)
            return next(waiting)

        return Interview(ask, told.append), asked, told

    def test_back_returns_to_the_question_before_with_its_answer_as_default(self) -> None:
        typed = ["yes", "Douro", "belgium", "<", "<", "", "portugal", *[""] * 4, "203.0.113.9", "<", "<", "eca", ""]
        interview, asked, told = self.interview(typed)
        with pytest.raises(StopIteration):
            interview.answers()
        assert [prompt.rpartition(" [")[2].strip(" :]") for prompt in asked[3:6]] == [
            "that of the country",
            "belgium",
            "Douro",
        ]
        assert [prompt.split(" (")[0] for prompt in asked[13:]] == [
            "Public address of the VPN server [203.0.113.9]: ",
            "Partners in the VPN",
            "Public address of the VPN server [203.0.113.9]: ",
            "DNS name of the VPN server [an EXAMPLE value]: ",
        ]
        note = "Of the report: 1 inesc, 2 iqua, 3 eca, 4 udg, 5 vtt, 6 spaceapps; any name."
        assert told == ["The pilot", note, "The VPN", "The pilot", note, "The VPN"]

    def test_back_at_the_first_question_asks_it_again(self) -> None:
        interview, asked, told = self.interview(["<", "no"])
        with pytest.raises(StopIteration):
            interview.answers()
        assert asked[:2] == ["Ask for networks, ports, radio details and rates as well? (yes/no) [no]: "] * 2
        assert told == ["The pilot", "This is the first question."]

    def test_every_answer_can_be_taken_back(self) -> None:
        """Back after each answer, and Enter: the result is as without."""
        needed = {"Name of the pilot": "Douro", "Country": "portugal", "Short names": "pier, boat", "Price": "0,5"}
        seen: list[str] = []
        told: list[str] = []

        def plain(prompt: str) -> str:
            return "yes" if "yes/no" in prompt else next((needed[key] for key in needed if prompt.startswith(key)), "")

        def hesitant(prompt: str) -> str:
            seen.append(prompt)
            if len(seen) % 3 == 2 and len(seen) > 2:
                return "<"
            return "" if len(seen) % 3 == 0 and len(seen) > 2 else plain(prompt)

        expected = Interview(plain, told.append).answers()
        told.clear()
        assert Interview(hesitant, told.append).answers() == expected
        assert "Price of the contract in EUR for 1 MB [0,5]: " in seen
        assert "Is there a 4G unit? (yes/no) [yes]: " in seen
        assert not [words for words in told if "Type" in words]

    def test_a_dash_clears_an_earlier_answer(self) -> None:
        interview, asked, _ = self.interview(["10.0.0.0/24", "<", "-", "10.1.0.0/24"])
        questions = (Question("lan", "Local network"), Question("management", "Management network"))
        answers = interview.prompter.run(lambda: interview.block(SiteAnswers, questions))
        assert answers == {"management": "10.1.0.0/24"}
        assert asked == [
            "Local network [an EXAMPLE value]: ",
            "Management network [an EXAMPLE value]: ",
            "Local network [10.0.0.0/24]: ",
            "Management network [an EXAMPLE value]: ",
        ]

    @pytest.mark.parametrize(
        ("text", "names"),
        [
            ("inesc, eca", ["inesc", "eca"]),
            ("1 6", ["inesc", "spaceapps"]),
            ("1,3", ["inesc", "eca"]),
            ("2, Blue Ocean, VTT", ["iqua", "Blue Ocean", "vtt"]),
            ("INESC TEC", ["INESC TEC"]),
        ],
    )
    def test_partners_are_numbers_or_names(self, text: str, names: list[str]) -> None:
        interview, _, told = self.interview([text])
        assert interview.answer(PilotAnswers, Question("partners", "Partners", "no partners")) == names
        assert told == []

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("7", "Unknown partner 7: type 1 to 6, or a name."),
            ("1, inesc", "two partners have the name `inesc`: name each partner once"),
            ("INESC TEC, 1", "two partners have the name `inesc`: name each partner once"),
            ("!!", "no partner can be named `!!`: a name has letters or digits"),
        ],
    )
    def test_unknown_partners_are_refused(self, text: str, message: str) -> None:
        interview, _, told = self.interview([text, ""])
        assert interview.answer(PilotAnswers, Question("partners", "Partners", "no partners")) is None
        assert told == [message]

    def test_a_wrong_answer_is_asked_again(self) -> None:
        interview, asked, told = self.interview(["10.0.0.0/30", "10.0.0.0", "10.0.0.0/24"])
        assert interview.answer(SiteAnswers, Question("lan", "Local network")) == "10.0.0.0/24"
        assert told == [
            "10.0.0.0/30 is too small here: use a network of /26 or larger",
            "`10.0.0.0` has no prefix length: a network is expected here: 10.0.0.0/24",
        ]
        assert asked == ["Local network [an EXAMPLE value]: "] * 3

    def test_country_may_be_answered_later_and_an_unknown_one_is_refused_with_that_choice(self) -> None:
        question = next(question for question in _PILOT if question.key == "country")
        interview, asked, told = self.interview(["brazil", "later"])
        assert interview.answer(PilotAnswers, question) == "later"
        assert asked == ["Country of the radios (in the EU or EFTA; or later): "] * 2
        assert [words.split(", belgium")[0] for words in told] == [
            "`brazil` is not a valid value for `country`: available: later, portugal"
        ]

    def test_enter_skips_an_optional_answer(self) -> None:
        interview, _, _ = self.interview(["", "", "Douro"])
        assert interview.answer(LteAnswers, Question("apn", "APN", "none")) is None
        assert interview.answer(PilotAnswers, Question("name", "Name", "")) == "Douro"

    def test_every_prompt_fits_a_line(self) -> None:
        asked: list[str] = []
        needed = {"Name of the pilot": "Douro", "Country": "portugal", "Short names": "pier"}

        def ask(prompt: str) -> str:
            asked.append(prompt)
            if "(yes/no)" in prompt:
                return "yes"
            return next((answer for question, answer in needed.items() if prompt.startswith(question)), "")

        answers = Interview(ask, asked.append).answers()
        assert set(answers["sites"]["pier"]) == {"wifi_bridge", "cable", "lte", "satellite", "gateway"}
        assert len(asked) > 50
        assert [prompt for prompt in asked if len(prompt) > 76] == []

    def test_every_question_and_refusal_is_portuguese(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(language, "_current_language", language.Language.PORTUGUESE)
        needed = {"Nome do piloto": ["Douro"], "País": ["portugal"], "Nomes curtos": ["O Cais", "cais"]}
        refused = {"Parceiros": ["9", "1,1", "!!", "1"], "Preço": ["1.234", "1.234,5", "\a", "1,5"]}
        waiting = {**needed, **refused}
        asked: list[str] = []
        told: list[str] = []

        def ask(prompt: str) -> str:
            asked.append(prompt)
            typed = next((texts for start, texts in waiting.items() if prompt.startswith(start)), [""])
            return "yes" if "(yes/no)" in prompt else typed.pop(0) if len(typed) > 1 else typed[0]

        Interview(ask, lambda words: told.append(language.translate(words))).answers()
        assert [prompt for prompt in asked if len(prompt) > 79] == []
        english = re.compile(r"\b(the|of|is|has|can|type|name|network|what|there|address|and)\b", re.IGNORECASE)
        assert [text for text in [*asked, *told] if english.search(text)] == []

    def test_a_site_needs_a_link(self) -> None:
        nothing = ["", "", "", "", ""]
        interview, _, told = self.interview([*nothing, *["no"] * 5, "no", "no", "no", "yes", "", "", "maybe", "no"])
        assert interview.site() == {"satellite": {}}
        assert told == ["A site needs a link: a bridge, a cable, 4G or a satellite.", "Type yes or no."]

    def test_names_must_be_valid_and_unique(self) -> None:
        interview, _, told = self.interview(["", "pier,pier", "scc", "The Pier", "pier, boat"])
        assert interview.names("Sites", "", other="scc") == ["pier", "boat"]
        assert len(told) == 4

    def test_numbers_and_lists_are_read_as_in_a_file(self) -> None:
        interview, _, _ = self.interview(["60 20000 10000", "10.0.0.1, 10.0.0.2", "0.5"])
        given = [interview.answer(LteAnswers, Question(key, key)) for key in ("rate", "canaries", "price_per_mb")]
        assert given == [{"rtt_ms": 60, "up_kbps": 20000, "down_kbps": 10000}, ["10.0.0.1", "10.0.0.2"], 0.5]
        assert validation_error(LteAnswers, "rate", "60 fast") is not None

    @pytest.mark.parametrize(
        ("key", "text", "value"),
        [
            ("price_per_mb", "2,5", 2.5),
            ("price_per_mb", "0,125", 0.125),
            ("price_per_mb", "1,1250", 1.125),
            ("rate", "9,5 20000 10000,25", {"rtt_ms": 9.5, "up_kbps": 20000, "down_kbps": 10000.25}),
            ("rate", "9,5, 20000, 10000", {"rtt_ms": 9.5, "up_kbps": 20000, "down_kbps": 10000}),
            ("rate", "60,20000,10000", {"rtt_ms": 60, "up_kbps": 20000, "down_kbps": 10000}),
        ],
    )
    def test_a_decimal_comma_is_understood(self, key: str, text: str, value: object) -> None:
        interview, _, told = self.interview([text])
        assert interview.answer(LteAnswers, Question(key, key)) == value
        assert told == []

    @pytest.mark.parametrize(
        ("model", "key", "text", "message"),
        [
            (LteAnswers, "price_per_mb", "1.125", "`1.125` can mean 1125 or 1.125: type 1125 or 1.1250"),
            (LteAnswers, "price_per_mb", "1.234,5", "`1.234,5` has a thousands separator: type 1234.5"),
            (LteAnswers, "price_per_mb", "1 234", "`1 234` has a thousands separator: type 1234"),
            (LteAnswers, "price_per_mb", "1,234,567", "`1,234,567` has a thousands separator: type 1234567"),
            (LteAnswers, "rate", "60 20.000 20000", "`20.000` can mean 20000 or 20.000: type 20000 or 20.0000"),
            (BridgeAnswers, "frequency_mhz", "5.500", "`5.500` has a thousands separator: type 5500"),
        ],
    )
    def test_a_thousands_separator_is_refused_with_what_to_type(
        self, model: type[BaseModel], key: str, text: str, message: str
    ) -> None:
        interview, _, told = self.interview([text, ""])
        assert interview.answer(model, Question(key, key)) is None
        assert told == [message]

    @pytest.mark.parametrize("text", ["inf", "nan", "1e999", "1_000", "9" * 5000, "٣", "2,5,1", "--1"])
    def test_a_text_that_is_no_number_is_refused(self, text: str) -> None:
        interview, _, told = self.interview([text, ""])
        assert interview.answer(LteAnswers, Question("price_per_mb", "Price")) is None
        assert len(told) == 1


def test_typed_answers_are_saved_when_the_inventory_is_invalid(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The command that is advised then reads the kept answers, once they are corrected."""
    typed: dict[str, Any] = yaml.safe_load(LEAST)
    typed["sites"]["pier"]["lan"] = "10.80.0.0/24"
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    monkeypatch.setattr("atlantis_netcfg.cli.inventory._source", lambda _: "questions")
    monkeypatch.setattr(
        "atlantis_netcfg.cli.inventory._ask_person", lambda _: (InventoryAnswers.model_validate(typed), typed)
    )
    monkeypatch.setattr("atlantis_netcfg.cli.inventory._encrypt", lambda **_: None)
    assert main(["inventory", "init", "douro"]) == ExitCode.USAGE
    (words,) = advised(capsys.readouterr().err.splitlines()[-1])
    assert words == ["inventory", "init", "douro", "--answers", "douro-answers.yml"]
    here = Path.cwd()
    monkeypatch.undo()
    monkeypatch.chdir(here)
    kept = Path("douro-answers.yml")
    kept.write_text(kept.read_text(encoding="utf-8").replace("10.80.0.0/24", "10.30.0.0/24"), encoding="utf-8")
    assert main(words) == ExitCode.DONE


@pytest.mark.parametrize(
    "value",
    [
        "plain",
        "802.11",
        "off",
        "yes",
        "null",
        "a: b",
        "it # says",
        "- x",
        "2026-11-25",
        "08",
        "'quoted'",
        "é",
        5,
        0.5,
        True,
        None,
    ],
)
def test_yaml_values_survive_a_round_trip(value: str | float | None) -> None:
    tree: dict[str, Tree] = {
        "a": {"b": [{"c": Value(value, is_example=True, comment="why")}, value]},
        "s": VaultSecret("x\ny"),
        "e": [],
        "m": {},
    }
    text = document(tree, ["# one"])

    read = yaml.load(text, Loader=EditorLoader)  # noqa: S506 - it is a SafeLoader
    assert read == {"a": {"b": [{"c": value}, value]}, "s": "x\ny\n", "e": [], "m": {}}
    assert "# why; EXAMPLE" in text
