"""What the declaration says of measured links, beside what is shipped for them."""

from __future__ import annotations

from atlantis_netcfg.declaration.model import KEY_OCTETS, LinkThresholds, Qualify, ThresholdsName
from atlantis_netcfg.qualify.judgement import QualifyProfile, profiles
from atlantis_netcfg.qualify.reflector.stamp import MIN_KEY_SIZE, PORT


def test_the_declaration_names_the_thresholds_that_are_shipped() -> None:
    assert [name.value for name in ThresholdsName] == list(profiles())


def test_each_threshold_can_be_declared() -> None:
    assert LinkThresholds.model_fields.keys() == {"profile", *QualifyProfile.model_fields}


def test_key_and_port_are_those_of_the_far_end() -> None:
    assert KEY_OCTETS == MIN_KEY_SIZE
    assert Qualify.model_fields["port"].default == PORT
