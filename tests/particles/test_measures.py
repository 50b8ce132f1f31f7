"""Stress, strain, coordination, porosity of known states."""

import numpy as np
import pytest

from particles import Assembly, LiChu, measures
from tests.particles.scenes import PAPER, cloud, hexagonal_lattice, square_lattice


def test_stress_of_a_compressed_square_lattice():
    """Overlap delta in each contact: two opposite forces k delta at arm r - delta/2: p = 2 k delta arm / (pi r^2) inside."""
    delta, radius = 1e-4, 0.05
    positions = square_lattice(9, 9, radius - delta / 2)
    soil = Assembly(positions, radius, law=LiChu(1e8))
    inner = 40
    pressure = 2 * 1e8 * delta * (radius - delta / 2) / (np.pi * radius**2)
    np.testing.assert_allclose(measures.particle_stress(soil)[inner], -pressure * np.eye(2), rtol=1e-9, atol=1e-6 * pressure)
    # averaged over the body: -k delta / spacing; the plain average counts discs, the corrected one does not
    fraction = np.pi * radius**2 / (2 * radius - delta) ** 2
    average = measures.averaged_stress(soil, positions[inner], solid_fraction=fraction)[0]
    np.testing.assert_allclose(average, -1e8 * delta / (2 * radius - delta) * np.eye(2), rtol=1e-9, atol=1e-3)
    plain = measures.averaged_stress(soil, positions[inner])[0]
    assert plain[0, 0] == pytest.approx(average[0, 0], rel=0.1) and plain[0, 0] != average[0, 0]


def test_stress_turns_with_the_body():
    angle = 0.7
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    positions = hexagonal_lattice(4, 4, 0.0498) * [1.0, 0.999]
    plain = measures.particle_stress(Assembly(positions, 0.05, law=LiChu(1e8)))
    turned = measures.particle_stress(Assembly(positions @ rotation.T, 0.05, law=LiChu(1e8)))
    np.testing.assert_allclose(turned, rotation @ plain @ rotation.T, atol=1e-6 * np.abs(plain).max())


def test_equivalent_stresses_of_simple_states():
    shear = np.array([[0.0, 2.0], [2.0, 0.0]])
    assert measures.effective_stress(shear, 0.2) == pytest.approx(2 * np.sqrt(3))
    assert measures.volumetric_stress(-3.0 * np.eye(2), 0.5) == pytest.approx(-3.0)
    assert measures.effective_stress(-3.0 * np.eye(2), 0.5) == pytest.approx(0.0, abs=1e-12)


def test_nominal_strain_of_a_homogeneous_motion_is_exact_and_ignores_rotation():
    soil = Assembly(hexagonal_lattice(6, 6), 0.05, law=PAPER)
    stretch = np.array([[1.02, 0.01], [0.01, 0.97]])
    angle = 0.4
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    moved = soil.reference @ (rotation @ stretch).T
    soil.displacements = np.column_stack([moved - soil.reference, np.full(36, angle)])
    strain = measures.nominal_strain(soil)
    green = 0.5 * (stretch @ stretch - np.eye(2))
    deviator = np.sqrt(2 / 3 * (np.sum(green**2) - np.trace(green) ** 2 / 3))
    np.testing.assert_allclose(strain.volumetric, np.linalg.det(stretch) - 1, atol=1e-12)
    np.testing.assert_allclose(strain.effective, deviator, rtol=1e-10)


def test_nominal_strain_is_masked_with_too_few_neighbours():
    soil = Assembly([[0, 0], [0.1, 0], [0.2, 0]], 0.05, law=PAPER)
    assert np.isnan(measures.nominal_strain(soil).volumetric).all()


def test_coordination_porosity_fabric():
    soil = Assembly(np.vstack([square_lattice(3, 3), [[5.0, 5.0]]]), 0.05, law=PAPER)
    assert measures.coordination(soil, 1e-6) == pytest.approx(2 * 12 / 10)
    assert measures.coordination(soil, 1e-6, rattlers=False) == pytest.approx(2 * 12 / 9)
    np.testing.assert_allclose(measures.fabric(soil, 1e-6), 0.5 * np.eye(2))
    assert measures.porosity(soil, (-0.05, -0.05), (0.25, 0.25)) == pytest.approx(1 - np.pi / 4)
    # the box cuts discs in halves and quarters
    assert measures.porosity(soil, (0.0, 0.0), (0.2, 0.2)) == pytest.approx(1 - np.pi / 4, abs=1e-3)


def test_couple_stress_is_zero_where_couples_are_and_finite_where_they_act():
    soil = cloud(30)
    soil.advance(100, 1e-5)
    stress = measures.particle_couple_stress(soil)
    found = soil.contacts()
    # independent sum for one disc
    disc = found.first[np.argmax(np.abs(found.moment))]
    total = np.zeros(2)
    for i, j, n, a, b, m in zip(found.first, found.second, found.normal, found.first_arm, found.second_arm, found.moment):
        total += (i == disc) * a * n * m + (j == disc) * (-b * n) * (-m)
    np.testing.assert_allclose(stress[disc], total / (np.pi * soil.radii[disc] ** 2), rtol=1e-12)
    assert np.abs(total).max() > 0
