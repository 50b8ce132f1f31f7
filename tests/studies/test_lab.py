"""Element tests and falling columns: what a laboratory would check."""

import dataclasses
import json
import math

import numpy as np
import pytest
from click.testing import CliRunner

from bridge.run import run
from particles.driving import inertial_number
from studies import column_run, lab_run
from studies.column import Parameters as ColumnParameters
from studies.column import lube
from studies.column_model import Column
from studies.lab import Biaxial, Shear, Triaxial
from studies.lab_command import biaxial
from studies.lab_model import ElementTest, elastic_constants, fitted_moduli

SMALL = {"particles": 400, "inertial_number": 6e-4, "stiffness_level": 300.0}


class Loaded:
    """An element test after its loading, with its history and results."""

    def __init__(self, parameters, samples=200):
        self.p, self.model = parameters, ElementTest(parameters)
        self.outcome = run(self.model, self.model.steps, samples=samples, progress=False)
        self.results = lab_run.results(lab_run.Finished(parameters, self.model, {}, self.outcome, []))

    def __getitem__(self, name):
        return self.results[name][0]


@pytest.fixture(scope="module")
def compressed():
    return Loaded(Biaxial(strain=0.06, **SMALL), samples=2000)


@pytest.fixture(scope="module")
def spheres():
    return Loaded(Triaxial(strain=0.04, particles=300, inertial_number=1e-3, stiffness_level=300.0))


@pytest.fixture(scope="module")
def sheared():
    return Loaded(Shear(strain=0.15, **SMALL))


@pytest.mark.parametrize("name", ["compressed", "spheres", "sheared"])
def test_the_isotropic_state_has_its_stress(name, request):
    made = request.getfixturevalue(name)
    assert made.model.settled
    stresses = [value for key, value in made.model.isotropic.items() if key in (
        "axial_stress_Pa", "lateral_stress_Pa", "normal_stress_Pa")]  # fmt: skip
    assert len(stresses) == 2
    assert stresses == pytest.approx(2 * [made.p.pressure], rel=0.01)


@pytest.mark.parametrize("name", ["compressed", "spheres", "sheared"])
def test_the_servo_holds_its_stress_while_the_packing_is_sheared(name, request):
    made = request.getfixturevalue(name)
    held = made.outcome.column("normal_stress_Pa" if name == "sheared" else "lateral_stress_Pa")
    error = held / made.p.pressure - 1.0
    assert np.sqrt(np.mean(error**2)) < 0.02
    assert abs(error.mean()) < 0.005  # the integral part leaves no bias


@pytest.mark.parametrize("name", ["compressed", "spheres", "sheared"])
def test_energy_is_accounted_for_and_kinetic_energy_negligible(name, request):
    made = request.getfixturevalue(name)
    energy = made.model.energies()
    assert abs(energy["balance"]) < 0.01 * energy["external_work"]
    assert made.outcome.column("kinetic_J").mean() < 0.02 * made.outcome.column("elastic_J").mean()


def test_the_rate_is_that_of_the_inertial_number(compressed, spheres):
    for made in (compressed, spheres):
        found = inertial_number(made.model.soil, made.p.rate, made.p.pressure)
        assert found == pytest.approx(made.p.inertial_number, rel=0.05)  # the mean diameter is that of the drawn radii


def test_work_of_the_cell_is_stress_times_strain(compressed):
    """Work is the integral of -sigma_ij L_ij V dt; stresses without dampers, rows every few steps."""
    column = compressed.outcome.column
    strain, area = column("axial_strain"), np.exp(column("volumetric_strain")) * np.linalg.det(compressed.model.start)
    across = column("volumetric_strain") + strain
    power = column("axial_stress_Pa"), column("lateral_stress_Pa")
    middle = [0.5 * (a[1:] * area[1:] + a[:-1] * area[:-1]) for a in power]
    work = np.sum(middle[0] * np.diff(strain)) - np.sum(middle[1] * np.diff(across))
    assert work == pytest.approx(column("cell_work_J")[-1] - column("cell_work_J")[0], rel=0.01)


def test_a_dense_packing_dilates_and_peaks(compressed, spheres, sheared):
    for made in (compressed, spheres, sheared):
        assert made["volumetric_strain_end"] > 0.01
        assert made["dilatancy_angle"] > 5.0
        assert made["porosity_end"] > made["porosity_isotropic"]
    # end of the shear with the packing still dilating: what remains is strength at constant volume and more
    assert compressed["stress_ratio_peak"] > 1.15 * compressed["stress_ratio_end"]
    assert 0.0 < compressed["strain_peak"] < 0.04


def test_friction_angles_lie_where_they_were_published(compressed, spheres):
    """Discs with mu = 0.5: 23 to 32 degrees at the peak of dense packings (Kruyt & Rothenburg 2006; Combe & Roux 2003).
    Dense spheres: 28 to 38 degrees at the peak (Thornton 2000; Suiker & Fleck 2004)."""
    assert 22.0 < compressed["friction_angle_peak"] < 34.0
    assert 25.0 < spheres["friction_angle_peak"] < 40.0


def test_without_friction_a_packing_has_next_to_no_strength(compressed):
    """Frictionless discs and spheres hold about 5 to 6 degrees and do not dilate (Peyneau & Roux 2008)."""
    slippery = Loaded(Biaxial(strain=0.03, friction=0.0, **SMALL))
    assert 1.0 < slippery["friction_angle_end"] < 9.0
    assert slippery["friction_angle_end"] < 0.5 * compressed["friction_angle_end"]
    assert abs(slippery["volumetric_strain_end"]) < 0.01


def test_rolling_friction_adds_strength(compressed):
    rolling = Loaded(dataclasses.replace(compressed.p, rolling_friction=0.5))
    assert rolling["friction_angle_end"] > compressed["friction_angle_end"] + 2.0


def test_young_modulus_is_below_the_bound_of_affine_motion(compressed, spheres):
    for made in (compressed, spheres):
        young, poisson = fitted_moduli(made.model.probe)
        assert 0.4 * made.model.voigt[0] < young < made.model.voigt[0]
        assert made.model.voigt[1] < poisson < 0.5


@pytest.mark.parametrize("axes", [2, 3])
def test_constants_of_an_isotropic_body(axes):
    """D_1111 = lambda + 2 mu and D_1122 = lambda give back E and nu; in space by the textbook, in the plane with no strain
    energy across: E = 4 mu (lambda + mu) / (lambda + 2 mu), nu = lambda / (lambda + 2 mu)."""
    lame, shear = 3.0, 2.0
    young, poisson = elastic_constants(lame + 2.0 * shear, lame, axes)
    if axes == 2:
        assert (young, poisson) == pytest.approx((4 * shear * (lame + shear) / (lame + 2 * shear), lame / (lame + 2 * shear)))
    else:
        assert (young, poisson) == pytest.approx((shear * (3 * lame + 2 * shear) / (lame + shear), lame / 2 / (lame + shear)))


def test_shear_gives_symmetric_stress_on_the_average(sheared):
    stress = sheared.model.soil.cell_stress()
    assert stress[0, 1] == pytest.approx(stress[1, 0], abs=0.02 * sheared.p.pressure)
    assert 0.2 < sheared["stress_ratio_end"] < 0.7


def test_a_looser_packing_has_no_peak_and_dilates_less(compressed):
    loose = Loaded(dataclasses.replace(compressed.p, preparation_friction=0.5))
    assert loose["porosity_isotropic"] > compressed["porosity_isotropic"] + 0.01
    assert loose["friction_angle_peak"] < compressed["friction_angle_peak"] - 2.0
    assert loose["volumetric_strain_end"] < compressed["volumetric_strain_end"]


# Columns ----------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def fallen():
    parameters = ColumnParameters(particles=150)
    made = []
    for aspect in (0.5, 3.0):
        column = Column(parameters, aspect)
        made.append((column, run(column, column.steps, samples=50, progress=False)))
    return made


def test_taller_columns_run_further_and_between_sand_and_free_discs(fallen):
    runouts = [outcome.history[-1]["runout"] for _, outcome in fallen]
    assert runouts[1] > 2.0 * runouts[0] > 0.5
    for (column, _), runout in zip(fallen, runouts):
        assert 0.5 * lube(np.array(column.aspect)) < runout < 3.0 * lube(np.array(column.aspect))


def test_columns_come_to_rest(fallen):
    for column, outcome in fallen:
        assert column_run.Fallen(column, outcome, []).at_rest
        momentum = (column.soil.masses[:, None] * column.soil.velocities[:, :2])[column.heap].sum(axis=0)
        assert np.hypot(*momentum) < 1e-2 * column.soil.masses.sum() * math.sqrt(9.81 * column.height)
        assert column.soil.plates[0].force[1] == pytest.approx(-9.81 * column.soil.masses.sum(), rel=0.05)
        assert column_run.balance_error(column_run.Fallen(column, outcome, [])) < 0.01


# Command ----------------------------------------------------------------------------------------------------------------


def test_a_run_leaves_its_files(tmp_path):
    p = Biaxial(particles=100, strain=0.005, inertial_number=1e-3, stiffness_level=100.0)
    lab_run.carry_out(p, tmp_path, samples=10, frames=1, progress=False)
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["study"] == "biaxial" and summary["stable"]
    assert {"versions", "counts", "steps", "seconds", "results", "energy", "warnings"} <= set(summary)
    rows = (tmp_path / "history.csv").read_text().splitlines()
    assert len(rows) == 12 and rows[0].startswith("time_s,axial_strain")
    for name in (*lab_run.FIGURES, "fields/particles.pvd", "fields/contacts_0001.vtu"):
        assert (tmp_path / name).stat().st_size > 100


@pytest.mark.parametrize(
    ("arguments", "words"),
    [(["--pressure", "-1"], "pressure=-1.0 must be positive"), (["--particles", "3"], "particles=3 must be between 50")],
)
def test_bad_parameters_are_named(arguments, words):
    answer = CliRunner().invoke(biaxial, arguments)
    assert isinstance(answer.exception, ValueError) and words in str(answer.exception)


@pytest.mark.parametrize("aspects", ["", "a", "2,1", "0.5,1e9", "nan"])
def test_bad_aspect_ratios_are_named(aspects):
    with pytest.raises(ValueError, match="aspects="):
        ColumnParameters(aspects=aspects)
