"""Bonded rock: equilibrium, scaling, units, elastic fields, cracks; the commands and what they leave."""

import dataclasses
import json
import math

import numpy as np
import pytest
from click.testing import CliRunner

from studies import rock_run
from studies.calibrate import Targets
from studies.calibrate_command import command as calibrate
from studies.cracks import cracks as cracks_of
from studies.cracks import fragments
from studies.options import shown_default
from studies.rock import Brazilian, Compression
from studies.rock_command import brazilian, ucs
from studies.rock_model import Specimen
from studies.rock_results import elastic_disc, slope

SMALL = {"porosity": 0.16, "size_exponent": 0.0, "speed": 0.1, "packings": 1, "strain": 0.03}
RECTANGLE = Compression(width=0.016, height=0.02, **SMALL)
DISC = Brazilian(diameter=0.025, inner=0.3, **SMALL)


def _run(p, samples=400):
    return rock_run.tested(p, p.seed, samples, progress=False)


@pytest.fixture(scope="module")
def compressed():
    return _run(RECTANGLE)


@pytest.fixture(scope="module")
def split():
    return _run(DISC)


def test_a_specimen_is_bonded_where_discs_nearly_touch_and_carries_no_force():
    soil = Specimen(RECTANGLE, 1).soil
    gap = np.linalg.norm(np.diff(soil.reference[soil.bonds], axis=1)[:, 0], axis=1) / soil.radii[soil.bonds].sum(axis=1) - 1.0
    assert len(soil.bonds) > 1.5 * soil.count and gap.max() <= RECTANGLE.bond_reach
    assert not soil.contacts().force.any()
    # the packing touches the plates to a millionth of a radius
    assert np.abs(soil.contacts(walls=True).force).max() < 2e-3 * RECTANGLE.tensile_strength


def test_in_equilibrium_the_stress_of_the_plates_is_the_averaged_stress():
    """The sum of V_p sigma_p over a body is that of boundary forces times places: F times the distance of the plates.

    No disc is accelerated, so this holds to the residual of equilibrium; smooth plates give no lateral stress.
    """
    from particles import measures
    from particles.driving import settle

    model = Specimen(RECTANGLE, 1)
    model.advance(math.ceil(0.0015 * RECTANGLE.height / (2.0 * RECTANGLE.speed * model.step)))
    for plate in model.plates:
        plate.velocity = (0.0, 0.0)
    settle(model.soil, 0.7 * model.step, 1e-8)
    top, bottom = (plate.force[1] for plate in model.plates)
    total = np.tensordot(math.pi * model.soil.radii**2, measures.particle_stress(model.soil), axes=1)
    apart = model.plates[0].centre[1] - model.plates[1].centre[1]
    assert top == pytest.approx(-bottom, rel=1e-6)
    assert -total[1, 1] == pytest.approx(top * apart, rel=1e-6)
    assert abs(total[0, 0]) < 1e-6 * total[1, 1] * -1.0


def test_stress_of_the_plates_and_of_the_inner_volume_agree_while_loading(compressed):
    assert compressed.results["averaged_over_plate_stress"][0] == pytest.approx(1.0, abs=0.1)
    assert compressed.results["plate_force_difference"][0] < 0.01


def test_young_modulus_is_below_and_poisson_ratio_above_those_of_affine_motion(compressed):
    found = {name: value for name, (value, _) in compressed.results.items()}
    assert 0.5 * found["young_modulus_affine"] < found["young_modulus"] < found["young_modulus_affine"]
    assert found["poisson_ratio_affine"] < found["poisson_ratio"] < found["poisson_ratio_affine"] + 0.25
    assert found["young_modulus_plates"] < found["young_modulus"]  # the contacts with the plates yield too


def test_results_without_units_do_not_depend_on_units(compressed):
    """Lengths by 2, stiffness by 4, density by 16: powers of two, so that even the rounding is the same.

    Bonds R_n ~ k_n r, speed ~ sqrt(k_n / rho).
    """
    p = RECTANGLE
    other = dataclasses.replace(
        p, width=2 * p.width, height=2 * p.height, smallest_radius=2 * p.smallest_radius, largest_radius=2 * p.largest_radius,
        normal_stiffness=4 * p.normal_stiffness, shear_stiffness=4 * p.shear_stiffness, tensile_strength=8 * p.tensile_strength,
        shear_strength=8 * p.shear_strength, density=16 * p.density, speed=p.speed / 2,
    )  # fmt: skip
    found = _run(other).results
    own = compressed.results
    for name, factor in (("young_modulus", 4.0), ("poisson_ratio", 1.0), ("compressive_strength", 4.0), ("peak_strain", 1.0)):
        assert found[name][0] == pytest.approx(factor * own[name][0], rel=1e-3), name


def test_moduli_and_strengths_scale_together(compressed):
    """Stiffnesses, strengths and density by 4, at the same speed: the same motion, stresses by 4."""
    p, own = RECTANGLE, compressed.results
    scaled = {name: 4 * getattr(p, name) for name in ("normal_stiffness", "shear_stiffness", "tensile_strength", "shear_strength", "density")}
    found = _run(dataclasses.replace(p, **scaled)).results
    for name, factor in (("young_modulus", 4.0), ("poisson_ratio", 1.0), ("compressive_strength", 4.0), ("cracks", 1.0)):
        assert found[name][0] == pytest.approx(factor * own[name][0], rel=1e-3), name


def test_young_modulus_grows_with_stiffness_and_strength_with_that_of_bonds(compressed):
    """The strain at failure has little effect: E ~ k_n whatever R_n (3 %: fewer gaps close), sigma_c ~ R_n whatever k_n.

    The latter to the scatter of one small specimen, whose cracks come in another order.
    """
    p, own = RECTANGLE, compressed.results
    stiff = _run(dataclasses.replace(p, normal_stiffness=2 * p.normal_stiffness, shear_stiffness=2 * p.shear_stiffness)).results
    weak = _run(dataclasses.replace(p, tensile_strength=0.5 * p.tensile_strength, shear_strength=0.5 * p.shear_strength)).results
    assert stiff["young_modulus"][0] == pytest.approx(2.0 * own["young_modulus"][0], rel=0.03)
    assert weak["young_modulus"][0] == pytest.approx(own["young_modulus"][0], rel=0.03)
    for found, factor in ((stiff, 1.0), (weak, 0.5)):
        assert found["poisson_ratio"][0] == pytest.approx(own["poisson_ratio"][0], abs=0.02)
        assert found["compressive_strength"][0] == pytest.approx(factor * own["compressive_strength"][0], rel=0.2)


def test_the_middle_of_an_elastic_disc_is_under_tension_and_three_times_the_compression():
    assert elastic_disc(1e-3) == pytest.approx((1.0, -3.0), abs=1e-4)
    lateral, axial = elastic_disc(0.2)
    assert 0.9 < lateral < 1.0 and -3.0 < axial < -2.8


def test_stresses_in_the_middle_of_the_disc_are_those_of_elasticity_and_it_splits_along_the_load(split):
    found = {name: value for name, (value, _) in split.results.items()}
    assert found["lateral_over_elastic_disc"] == pytest.approx(1.0, abs=0.3)
    assert found["axial_over_elastic_disc"] == pytest.approx(1.0, abs=0.3)
    assert found["cracks_near_diameter"] > 0.6
    soil = split.model.soil
    right = soil.reference[:, 0] > 0.0
    opened = soil.displacements[right, 0].mean() - soil.displacements[~right, 0].mean()
    assert opened > 10.0 * DISC.tensile_strength / DISC.normal_stiffness  # elongations at which bonds break


def test_fragments_are_what_bonds_hold_together(split):
    groups, held = fragments(split.model.soil), split.model.soil.bonds
    assert (groups[held[:, 0]] == groups[held[:, 1]]).all()
    sizes = np.bincount(groups)
    assert (np.diff(sizes) <= 0).all() and sizes.sum() == split.model.soil.count


@pytest.mark.parametrize("name", ["compressed", "split"])
def test_cracks_are_the_bonds_that_no_longer_hold(name, request):
    one = request.getfixturevalue(name)
    cracks = cracks_of(one.model.soil)
    assert len(cracks.time) == len(one.model.bonds) - len(one.model.soil.bonds)
    assert (np.diff(cracks.time) >= 0.0).all()
    assert cracks.energies.min() >= -1e-9 * cracks.energies.max()  # to rounding where only friction is lost
    assert cracks.energies.sum() == pytest.approx(one.model.soil.energies()["breaking"], rel=1e-9)
    assert one.balance_error < 0.02
    assert one.outcome.column("cracks")[-1] == len(cracks.time)


def test_a_slope_needs_three_points():
    assert slope(np.array([0.0, 1.0, 2.0]), np.array([1.0, 3.0, 5.0])) == pytest.approx(2.0)
    assert math.isnan(slope(np.arange(2.0), np.arange(2.0)))


@pytest.mark.parametrize("p", [RECTANGLE, DISC], ids=["ucs", "brazilian"])
def test_a_run_leaves_its_files(tmp_path, p):
    summary = rock_run.carry_out(dataclasses.replace(p, packings=2), tmp_path, samples=100, frames=10, progress=False)
    read = json.loads((tmp_path / "summary.json").read_text())
    assert read["study"] == p.study and read["stable"] and read["counts"]["packings"] == 2
    for name, published in p.published.items():
        entry = read["results"][name]
        assert entry["published"] == published and len(entry["each"]) == 2
        assert entry["value"] == pytest.approx(np.mean(entry["each"])) and entry["deviation"] == pytest.approx(np.std(entry["each"], ddof=1))
    rows = (tmp_path / "cracks.csv").read_text().splitlines()
    assert len(rows) == 1 + sum(summary["results"]["cracks"]["each"])
    assert (tmp_path / "history.csv").read_text().startswith("packing,time_s,strain,plate_stress_Pa")
    for name in (*rock_run.FIGURES, "fields/particles_2.pvd", "fields/cracks_1_0000.vtu"):
        assert (tmp_path / name).stat().st_size > 100


def test_what_a_run_has_against_itself_is_said():
    p = dataclasses.replace(RECTANGLE, porosity=0.13, strain=0.002)
    words = " ".join(rock_run.doubts(_run(p, samples=50)))
    assert "has a porosity of 0.1" in words and "instead of 0.13" in words
    assert "is not broken at strain=0.002" in words
    words = " ".join(rock_run.doubts(_run(dataclasses.replace(RECTANGLE, speed=50.0), samples=50)))
    assert "is not quasi-static" in words and "lower speed than 50 m/s" in words


@pytest.mark.parametrize(
    ("command", "arguments", "words"),
    [
        (ucs, ["--speed", "0"], "speed=0.0 must be positive"),
        (ucs, ["--smallest-radius", "1e-3"], "smallest_radius=0.001 must not be above largest_radius=0.000653"),
        (ucs, ["--width", "0.004"], "largest_radius=0.000653 must be at most an eighth of the specimen"),
        (ucs, ["--smallest-radius", "1e-6"], "smallest_radius=1e-06 would make millions of discs"),
        (ucs, ["--samples", "1"], "samples=1 must be between 10"),
        (brazilian, ["--inner", "0.9"], "inner=0.9 must be between 0.02 and 0.7"),
        (brazilian, ["--drop", "1"], "drop=1.0 must be between 0.001 and 0.99"),
        (calibrate, ["--stiffness-ratios", "0.2"], "stiffness_ratios=0.2 must be two or more"),
        (calibrate, ["--stiffness-ratios", "0.4,0.2"], "in ascending order"),
        (calibrate, ["--tensile-strength", "1e7"], "strength_ratios=1 must be two or more for a tensile strength"),
        (calibrate, ["--young-modulus", "1e8"], "compressive_strength=1.278e+08 must be below a tenth of young_modulus=1e+08"),
    ],
)
def test_bad_parameters_are_named(command, arguments, words):
    answer = CliRunner().invoke(command, arguments)
    assert isinstance(answer.exception, ValueError) and words in str(answer.exception)


@pytest.mark.parametrize(("command", "kind"), [(ucs, Compression), (brazilian, Brazilian), (calibrate, Targets)])
def test_help_names_every_parameter_with_its_default(command, kind):
    text = " ".join(CliRunner().invoke(command, ["--help"]).output.split())
    for field in dataclasses.fields(kind):
        assert f"--{field.name.replace('_', '-')} " in text
        assert f"[default: {shown_default(field)}]" in text, field.name


def test_an_inner_volume_with_too_few_discs_is_refused():
    with pytest.raises(ValueError, match="inner=0.02 must be larger"):
        Specimen(dataclasses.replace(RECTANGLE, inner=0.02), 1)
