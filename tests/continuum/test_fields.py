import numpy as np
import pytest

from continuum import Body
from meshes import Box


def test_uniform_state_gives_its_measures_everywhere(cell, make_domain, make_material):
    """Volumetric and effective measures against a 3D tensor worked out here; NaN in covered cells."""
    body = Body(make_domain(cell), make_material("cosserat"), excluded=Box((-1, -1), (0.7, 9)))
    gradient = np.array([[1.0e-3, 4.0e-4], [-2.0e-4, -7.0e-4]])
    body.displacement[:, :2] = body.coordinates @ gradient
    body.displacement[:, 2] = 1e-4
    strain = gradient - 1e-4 * np.array([[0, 1], [-1, 0]])
    stress = np.zeros((3, 3))
    stress[:2, :2] = np.einsum("ijkl,kl->ij", body.material.stiffness, strain)
    stress[2, 2] = 0.2 * (stress[0, 0] + stress[1, 1])
    deviator = 0.5 * (stress + stress.T) - np.trace(stress) / 3 * np.eye(3)
    tensor = np.zeros((3, 3))
    tensor[:2, :2] = 0.5 * (strain + strain.T)
    shape = tensor - np.trace(tensor) / 3 * np.eye(3)
    expected = {
        "stress_xx": stress[0, 0],
        "stress_xy": stress[0, 1],
        "stress_yx": stress[1, 0],
        "stress_yy": stress[1, 1],
        "volumetric_stress": np.trace(stress) / 3,
        "effective_stress": np.sqrt(1.5 * np.vdot(deviator, deviator)),
        "strain_yx": strain[1, 0],
        "volumetric_strain": np.trace(strain),
        "effective_strain": np.sqrt(2 / 3 * np.vdot(shape, shape)),
    }
    functions = body.stress_fields() | body.strain_fields()
    uncovered = body.cell_fractions > 0
    assert 0 < uncovered.sum() < len(uncovered)
    for name, value in expected.items():
        values = functions[name].x.array[: len(uncovered)]
        assert values[uncovered] == pytest.approx(np.full(uncovered.sum(), value), rel=1e-11)
        assert np.all(np.isnan(values[~uncovered]))


def test_couple_stress_of_a_uniform_curvature(cell, make_domain, make_material):
    body = Body(make_domain(cell), make_material("cosserat"))
    body.displacement[:, 2] = body.coordinates @ [0.3, -0.2]
    fields = body.stress_fields()
    for name, curvature in (("couple_stress_x", 0.3), ("couple_stress_y", -0.2)):
        expected = body.material.couple_modulus * curvature
        assert fields[name].x.array == pytest.approx(np.full(len(body.cell_fractions), expected), rel=1e-11)
