"""Options of the studies: rules are checked, help names units and defaults."""

import dataclasses
import math

import pytest
from click.testing import CliRunner

from studies.foundation import Parameters
from studies.foundation_command import command
from studies.options import shown_default, size_in_metres


@pytest.mark.parametrize("text", ["6", "6x", "x3", "6x3x1", "6 by 3", "-6x3", "6x0", "nanx3", "infx3"])
def test_a_size_that_is_none_is_refused(text):
    with pytest.raises(ValueError, match="region="):
        size_in_metres("region", text)


def test_a_size_is_width_and_depth():
    assert size_in_metres("region", "7x3.5") == (7.0, 3.5)


NUMBERS = [field.name for field in dataclasses.fields(Parameters) if field.metadata["rule"]]


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf])
def test_every_number_knows_its_rule(name, value):
    with pytest.raises(ValueError, match=f"^{name}={value} must be .*positive|^{name}={value} must be above 0"):
        Parameters(**{name: value})


@pytest.mark.parametrize(
    "bad, rule",
    [
        ({"method": "dem", "region": "abc"}, "WIDTHxDEPTH"),
        ({"method": "fem", "variant": "abc"}, "one of paper"),
        ({"method": "dem", "mesh": "abc"}, "existing"),
        ({"displacement": 4.6}, r"between 0 and 4.5 .m."),
        ({"density": 0.5}, r"between 1 and 100000 .kg/m3."),
        ({"density": 2e5}, r"between 1 and 100000 .kg/m3."),
        ({"normal_stiffness": 1.0}, r"between 1000 and 1e\+15 .N/m."),
        ({"normal_stiffness": 1e300}, r"between 1000 and 1e\+15 .N/m."),
        ({"sliding_stiffness": 1e16}, r"between 0 and 1e\+15"),
        ({"rolling_stiffness": 1e16}, r"between 0 and 1e\+15"),
        ({"moment_stiffness": 1e16}, r"between 0 and 1e\+15"),
        ({"damping": 2e5}, r"between 0 and 100000 .1/s."),
        ({"substeps": 10**400}, "a number of more than 25 digits must be between 1 and 1e[+]07"),
        ({"seed": 10**5000}, "a number of more than 25 digits"),
        ({"region": "9" * 400 + "x3"}, r"^region=.{5,60} must"),
        ({"substeps": 1.5}, "substeps=1.5 must be a whole number"),
        ({"substeps": True}, "must be a number"),
        ({"substeps": "2"}, "must be a number"),
        ({"region": None}, "region=None must be a word"),
        ({"region": 6}, "must be a word"),
        ({"variant": 1}, "must be a word"),
        ({"mesh": ["structured"]}, "must be a word"),
        ({"damping": None}, r"must be a number .1/s."),
        ({"damping": {}}, "must be a number"),
        ({"region": "30x3"}, "inside the mesh"),
        ({"region": "6x9"}, "inside the mesh"),
        ({"region": "1x3"}, "as wide as the plate"),
        ({"plate_position": 0.5}, "outside the soil"),
        ({"plate_position": math.nan}, "outside the soil"),
        ({"plate_width": 19.0}, "outside the soil"),
        ({"radius": 0.1, "assembly": "C"}, "for lattices"),
        ({"radius": 1e-6}, "between"),
        ({"element_size": 1e-9}, "between"),
        ({"mesh": "no-such-file.msh"}, "existing"),
        ({"mesh": "graded", "plate_position": 8.0}, "plate_position=8.0 must be 9 m"),
        ({"assembly": "D"}, "one of A, B, C"),
        ({"variant": "best"}, "one of paper"),
        ({"method": "both"}, "one of dem"),
        ({"moduli": "guessed"}, "one of packing, paper"),
    ],
)
def test_scenes_that_make_no_sense_are_refused_by_name(bad, rule):
    with pytest.raises(ValueError, match=rule) as refused:
        Parameters(**bad)
    assert any(str(refused.value).startswith(f"{name}=") for name in bad)


def test_help_names_every_parameter_with_its_unit_and_default():
    help_text = " ".join(CliRunner().invoke(command, ["--help"]).output.split())
    for field in dataclasses.fields(Parameters):
        assert f"--{field.name.replace('_', '-')} " in help_text
        assert f"[default: {shown_default(field)}]" in help_text, field.name
    assert "[default: 2.5e+08 N/m]" in help_text and "[default: 6x3]" in help_text and "[default: 0.5]" in help_text
