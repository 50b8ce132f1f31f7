"""Calibration: the inverse of closed forms and of runs, uncertainty, what is out of reach."""

import json
import math

import numpy as np
import pytest

from bridge.run import Stopwatch
from studies import calibrate_run
from studies.calibrate import Targets, rock_test
from studies.calibration import Micro, Relations, refine, standard_errors
from studies.rock import Brazilian, Compression

RATIOS, RADIUS, PACKINGS = (0.1, 0.2, 0.4, 0.8), 5e-4, 3
SMALL = Compression(width=0.016, height=0.02, porosity=0.16, size_exponent=0.0, speed=0.1)


def hexagonal(micro):
    """Responses of the bonded hexagonal lattice of equal discs: E, nu exact; strengths R_n / r with made-up functions.

    E = 2 sqrt(3) k_n (k_n + k_t) / (3 k_n + k_t), nu = (k_n - k_t) / (3 k_n + k_t), from its moduli of affine motion.
    """
    k, ratio = micro.normal_stiffness, micro.stiffness_ratio
    young = 2.0 * math.sqrt(3.0) * k * (1.0 + ratio) / (3.0 + ratio)
    strength = micro.bond_strength / RADIUS
    compressive = strength * 1.2 * micro.strength_ratio**0.4 * ratio**-0.1
    return np.array([math.log(young), (1.0 - ratio) / (3.0 + ratio), math.log(compressive), math.log(0.2 * strength)])


def relations(strengths=(1.0,), responses=3):
    scatter = np.linspace(-0.02, 0.02, PACKINGS)[:, None]
    values = np.array([[hexagonal(Micro(1.0, a, RADIUS, b))[:responses] + scatter for b in strengths] for a in RATIOS])
    return Relations(RATIOS, strengths, values, RADIUS)


@pytest.mark.parametrize(("strengths", "count"), [((1.0,), 3), ((0.5, 1.0, 2.0, 4.0), 4)])
def test_parameters_of_a_lattice_are_found_again(strengths, count):
    """By the relations to the error of their interpolation, by the refinement to its tolerance."""
    known = Micro(2e10, 0.3, 4e4, 1.0 if count == 3 else 1.5)
    target = hexagonal(known)[:count]
    table = relations(strengths, count)
    start = table.inverse(target)
    assert table.micro(start) == pytest.approx(known, rel=0.03)

    def measure(micro):
        return hexagonal(micro)[:count] + np.array([[-0.01], [0.0], [0.01]])

    found = refine(table, target, start, measure, 6)
    assert found.micro == pytest.approx(known, rel=1e-3)
    assert found.rounds <= 5


def test_a_refinement_makes_good_what_the_relations_miss():
    known = Micro(2e10, 0.3, 4e4, 1.0)
    table = relations()

    def measure(micro):  # a strength that depends on the strain at failure, which the relations leave out
        y = hexagonal(micro)[:3]
        y[2] += 0.1 * math.log(1e3 * micro.bond_strength / (micro.normal_stiffness * RADIUS))
        return y[None] + np.zeros((2, 1))

    target = measure(known)[0]
    start = table.inverse(target)
    assert abs(start[2] - math.log(known.bond_strength)) > 0.1
    assert refine(table, target, start, measure, 8).micro == pytest.approx(known, rel=0.01)


def test_standard_errors_are_those_of_a_mean():
    """Two responses that are twice the unknowns, with independent scatter of 0.1: errors 0.1 / 2 / sqrt(n)."""
    rng = np.random.default_rng(1)
    measured = 0.1 * rng.standard_normal((4000, 2))
    assert standard_errors(2.0 * np.eye(2), measured) == pytest.approx([0.05 / math.sqrt(4000)] * 2, rel=0.05)
    assert np.isnan(standard_errors(np.eye(2), measured[:1])).all()


def test_the_jacobian_is_that_of_the_scaling_laws():
    x = np.log([2e10, 0.3, 4e4])
    jacobian = relations().jacobian(x)
    assert jacobian[:, 0] == pytest.approx([1.0, 0.0, 0.0], abs=1e-4)
    assert jacobian[:, 2] == pytest.approx([0.0, 0.0, 1.0], abs=1e-4)
    assert jacobian[1, 1] == pytest.approx(0.3 * -4.0 / 3.3**2, rel=0.1)  # d nu / d ln ratio


def test_targets_out_of_reach_are_named_with_what_can_be_reached():
    target = hexagonal(Micro(2e10, 0.3, 4e4, 1.0))
    with pytest.raises(ValueError, match=r"poisson_ratio=0.4 must be between 0.053 and 0.290.*--stiffness-ratios"):
        relations().inverse(np.array([target[0], 0.4, target[2]]))
    apart = target + [0.0, 0.0, 2.0, 0.0]
    with pytest.raises(ValueError, match="tensile_strength=.* cannot be reached"):
        relations((0.5, 1.0, 2.0), 4).inverse(apart)


def test_a_poisson_ratio_out_of_reach_is_refused_after_the_ends_of_the_grid():
    """Two of four stiffness ratios are run before the sentence."""

    class Lattice(calibrate_run.Laboratory):
        def measure(self, micro, seeds, phase):
            seen.append(micro.stiffness_ratio)
            return np.array([hexagonal(micro)[:3] for _ in seeds]), np.full(len(seeds), RADIUS)

    seen = []
    for wanted, runs in ((0.6, [0.1, 0.8]), (0.2, [0.1, 0.8, 0.2, 0.4])):
        seen.clear()
        laboratory = Lattice(Targets(poisson_ratio=wanted), SMALL, lambda row: None, Stopwatch())
        if wanted > 0.5:
            with pytest.raises(ValueError, match="poisson_ratio=0.6 must be between 0.053 and 0.290"):
                calibrate_run.tabulated(laboratory, range(1, 3))
        else:
            table = calibrate_run.tabulated(laboratory, range(1, 3))
            assert table.values[:, 0, 0, 1] == pytest.approx([(1.0 - a) / (3.0 + a) for a in RATIOS])
        assert seen == runs


def test_tests_have_the_micro_parameters_and_the_specimen():
    target = Targets(tensile_strength=1e7, strength_ratios="1,2")
    micro = Micro(2e10, 0.25, 4e4, 1.5)
    for kind in target.tests:
        p = rock_test(kind, micro, SMALL, target)
        assert (p.normal_stiffness, p.shear_stiffness) == (2e10, 5e9)
        assert (p.tensile_strength, p.shear_strength) == (4e4, 6e4)
        assert (p.porosity, p.speed) == (SMALL.porosity, SMALL.speed)
    assert rock_test(Brazilian, micro, SMALL, target).diameter == SMALL.width


def test_parameters_of_a_run_are_found_again(tmp_path):
    """What runs with known parameters measure, as the target of a calibration on the same packings."""
    known = Micro(1.6e10, 0.3, 3e4, 1.0)
    targets = Targets(stiffness_ratios="0.2,0.45", packings=2, check_packings=2)
    laboratory = calibrate_run.Laboratory(targets, SMALL, lambda row: None, Stopwatch(), samples=600, progress=False)
    young, poisson, strength = laboratory.measure(known, range(1, 3), 0)[0].mean(axis=0)
    wanted = Targets(
        young_modulus=math.exp(young), poisson_ratio=poisson, compressive_strength=math.exp(strength), stiffness_ratios="0.2,0.45",
        packings=2, check_packings=2,
    )  # fmt: skip
    summary = calibrate_run.carry_out(wanted, SMALL, tmp_path, progress=False)
    found = {name: entry["value"] for name, entry in summary["results"].items()}
    assert found["normal_stiffness"] == pytest.approx(known.normal_stiffness, rel=0.02)
    assert found["stiffness_ratio"] == pytest.approx(known.stiffness_ratio, rel=0.05)
    # strength is not smooth in the parameters: another order of cracks is another peak
    assert found["bond_strength"] == pytest.approx(known.bond_strength, rel=0.1)
    assert summary["check"]["young_modulus"]["calibrated"] == pytest.approx(wanted.young_modulus, rel=0.01)
    assert json.loads((tmp_path / "summary.json").read_text())["counts"]["table"] == 4
    assert len((tmp_path / "relations.csv").read_text().splitlines()) == 5
    assert len((tmp_path / "runs.csv").read_text().splitlines()) == 1 + 4 + 2 * summary["counts"]["rounds"] + 2
    assert (tmp_path / "relations.png").stat().st_size > 1000
