"""Cosserat bodies in space: patch tests, rigid motions, moduli, plane waves in closed form, critical step."""

from dataclasses import replace

import numpy as np
import pytest

from continuum import Body, Cauchy, Cosserat, CosseratModuli
from meshes import Box, domains
from tests.continuum.conftest import LI_WAN
from tests.continuum.space import (
    GRAINS,
    SIZE,
    check_energy_account,
    dense_stiffness,
    distorted_body,
    distorted_box,
    every_damping,
    solve,
    within,
)

GRADIENT = 1e-3 * np.array([[1.0, 0.4, -0.3], [-0.2, -0.7, 0.6], [0.5, 0.1, 0.8]])  # u_j,i
ROTATION = 1e-3 * np.array([0.3, -0.5, 0.7])
CURVATURE = 1e-3 * np.array([[0.2, -0.6, 0.3], [0.9, 0.5, -0.1], [-0.4, 0.7, -0.8]])  # phi_j,i
EVERYWHERE = Box((-9, -9, -9), (99, 99, 99))
VOLUME = np.prod(SIZE)
SIDES = (("left", "right"), ("front", "back"), ("bottom", "top"))


@pytest.fixture(params=["tetrahedron", "hexahedron"])
def cell(request):
    return request.param


def permuted(vector):
    """e_ijk a_k."""
    x, y, z = vector
    return np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])


def stress_of(strain, material=GRAINS):
    """lambda tr(eps) 1 + (G + Gc) eps + (G - Gc) eps^T."""
    g, gc = material.shear_modulus, material.cosserat_shear
    return material.lame_modulus * np.trace(strain) * np.eye(3) + (g + gc) * strain + (g - gc) * strain.T


def couple_of(curvature, material=GRAINS):
    """alpha tr(kappa) 1 + beta kappa^T + gamma kappa."""
    spread, cross, modulus = material.couple_alpha, material.couple_beta, material.couple_modulus
    return spread * np.trace(curvature) * np.eye(3) + cross * curvature.T + modulus * curvature


def pull(body, stress, couple):
    """Tractions and couples of uniform stresses on all sides."""
    for axis, (low, high) in enumerate(SIDES):
        body.traction(high, stress[axis], couple[axis])
        body.traction(low, -stress[axis], -couple[axis])


def volumes(body):
    """Integral of the shape function of each node (n, 1), m3."""
    return body.mass[:, :1] / body.material.density


def test_uniform_strain_and_rotation(cell):
    """Patch test on a distorted mesh: tractions on the sides, in every node the couple -e_jkl sigma_kl of the unlike shear stresses."""
    body = distorted_body(cell, GRAINS)
    body.displacement[:] = np.hstack([body.coordinates @ GRADIENT, np.broadcast_to(ROTATION, (body.count, 3))])
    strain = GRADIENT - permuted(ROTATION)
    stress, force = stress_of(strain), body.internal_force()
    pull(body, stress, np.zeros((3, 3)))
    scale = np.abs(stress).max()
    np.testing.assert_allclose(force[:, :3], body.external_force()[:, :3], rtol=0.0, atol=1e-12 * scale)
    couple = -np.array([stress[1, 2] - stress[2, 1], stress[2, 0] - stress[0, 2], stress[0, 1] - stress[1, 0]])
    np.testing.assert_allclose(force[:, 3:], volumes(body) * couple, rtol=0.0, atol=1e-12 * scale)
    assert body.strain_energy() == pytest.approx(0.5 * np.vdot(stress, strain) * VOLUME, rel=1e-12)
    fields = body.stress_fields() | body.strain_fields()
    assert len(fields) == 40
    for name, value in (("stress_xy", stress[0, 1]), ("stress_zy", stress[2, 1]), ("strain_zx", strain[2, 0])):
        np.testing.assert_allclose(fields[name].x.array, value, rtol=1e-11)


def test_strain_that_the_rotation_follows_is_in_equilibrium(cell):
    """Surface held at u = E x and half its curl: so it is inside."""
    body = distorted_body(cell, GRAINS)
    spin = 0.5 * np.array([GRADIENT[1, 2] - GRADIENT[2, 1], GRADIENT[2, 0] - GRADIENT[0, 2], GRADIENT[0, 1] - GRADIENT[1, 0]])
    wanted = np.hstack([body.coordinates @ GRADIENT, np.broadcast_to(spin, (body.count, 3))])
    body.fix(lambda points: ~within(points), "xyzr")
    solve(body, np.where(body.fixed, wanted, 0.0))
    np.testing.assert_allclose(body.displacement, wanted, rtol=0.0, atol=1e-12 * np.abs(wanted).max())


def test_uniform_curvature_without_the_resistance_to_relative_rotation(cell):
    """Couples of the sides alone hold phi = K x where nothing ties it to the displacements, whatever alpha, beta and gamma."""
    body = distorted_body(cell, replace(GRAINS, cosserat_shear=1e-30))
    couple = couple_of(CURVATURE)
    pull(body, np.zeros((3, 3)), couple)
    body.displacement[:, 3:] = body.coordinates @ CURVATURE
    scale = np.abs(couple).max()
    np.testing.assert_allclose(body.internal_force(), body.external_force(), rtol=0.0, atol=1e-12 * scale)
    assert body.strain_energy() == pytest.approx(0.5 * np.vdot(couple, CURVATURE) * VOLUME, rel=1e-12)
    fields = body.stress_fields() | body.strain_fields()
    np.testing.assert_allclose(fields["couple_stress_xy"].x.array, couple[0, 1], rtol=1e-11)
    np.testing.assert_allclose(fields["curvature_zx"].x.array, CURVATURE[2, 0], rtol=1e-11)


def test_a_linear_rotation_field(cell):
    """phi = r + K x, u = 0: energy 2 Gc phi^2 + kappa:m/2, forces of the antisymmetric stress -2 Gc e_klm phi_m inside."""
    domain = distorted_box(cell) if cell == "tetrahedron" else domains.box((0, 0, 0), SIZE, (4, 3, 3), cell)
    body = Body(domain, GRAINS)
    body.displacement[:, 3:] = ROTATION + body.coordinates @ CURVATURE
    middle = ROTATION + 0.5 * SIZE @ CURVATURE
    square = middle @ middle + np.sum((SIZE[:, None] * CURVATURE) ** 2) / 12.0  # mean of phi^2
    energy = 2.0 * GRAINS.cosserat_shear * square + 0.5 * np.vdot(couple_of(CURVATURE), CURVATURE)
    assert body.strain_energy() == pytest.approx(energy * VOLUME, rel=1e-12)
    inner = within(body.coordinates)
    force = 2.0 * GRAINS.cosserat_shear * np.einsum("klm,km->l", permutation(), CURVATURE)  # -sigma_kl,k
    np.testing.assert_allclose(body.internal_force()[inner, :3], volumes(body)[inner] * force, rtol=1e-10)


def permutation():
    return np.stack([permuted(unit) for unit in np.eye(3)], axis=2)


@pytest.mark.parametrize("counts", [(1, 1, 1), (4, 3, 3)])
@pytest.mark.parametrize("material", [GRAINS, replace(GRAINS, couple_alpha=-2.88e8 / 4, couple_beta=-2.88e8 / 4)])
def test_six_motions_are_free_of_energy(cell, counts, material):
    """Translations, and rotations that micro-rotations share; also where uniform twist has no couple (3 alpha + beta + gamma = 0)."""
    body = Body(distorted_box(cell) if counts[0] > 1 else domains.box((0, 0, 0), (1, 1, 1), counts, cell), material)
    stiffness = dense_stiffness(body)
    values = np.linalg.eigvalsh(stiffness)
    assert np.count_nonzero(np.abs(values) < 1e-12 * values[-1]) == 6 and values[6] > 1e-5 * values[-1]
    rigid = np.hstack([np.cross(ROTATION, body.coordinates) + GRADIENT[0], np.broadcast_to(ROTATION, (body.count, 3))])
    assert np.abs(body.internal_force(rigid)).max() < 1e-13 * values[-1] * np.abs(rigid).max()
    trial = np.random.default_rng(1).standard_normal(body.mass.shape)
    by_matrix, by_form = body.internal_force(trial), body.internal_force(trial, method="form")
    assert np.abs(by_matrix - by_form).max() < 1e-13 * np.abs(by_matrix).max()


def test_moduli_are_isotropic_and_those_of_any_symmetry_go_the_same_way():
    """The tensors in a turned frame are the same; given as measured moduli they give the same forces."""
    turn = np.linalg.qr(np.random.default_rng(2).standard_normal((3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    tensors = GRAINS.stiffness_in(3), GRAINS.couple_in(3)
    for tensor in tensors:
        turned = np.einsum("ia,jb,kc,ld,abcd->ijkl", turn, turn, turn, turn, tensor)
        np.testing.assert_allclose(turned, tensor, rtol=0.0, atol=1e-14 * np.abs(tensor).max())
    one, other = (distorted_body("tetrahedron", material) for material in (GRAINS, CosseratModuli(*tensors, 2600.0)))
    trial = np.random.default_rng(1).standard_normal(one.mass.shape)
    np.testing.assert_array_equal(one.internal_force(trial), other.internal_force(trial))
    with pytest.raises(ValueError, match=r"stiffness of shape \(3, 3, 3, 3\) must have the shape \(2, 2, 2, 2\)"):
        Body(domains.rectangle((0, 0), (1, 1), (1, 1)), CosseratModuli(*tensors, 2600.0))


def test_lame_moduli_and_bad_couples():
    again = Cosserat.from_lame(
        GRAINS.lame_modulus, GRAINS.shear_modulus, cosserat_shear=2.4e9, characteristic_length=0.2, density=2600.0
    )
    assert again.young_modulus == pytest.approx(18e9, rel=1e-14) and again.poisson_ratio == pytest.approx(0.25, rel=1e-14)
    with pytest.raises(ValueError, match="lame_modulus=-1000000.0 must be greater than -2/3"):
        Cauchy.from_lame(-1e6, 1e6, density=2000.0)
    for words, change in (
        ("couple_beta=300000000.0 must lie between", {"couple_beta": 3e8}),
        (r"couple_alpha=-130000000.0 must be at least .*-1.26e\+08 N", {"couple_alpha": -1.3e8}),
    ):
        with pytest.raises(ValueError, match=words):
            replace(GRAINS, **change)


def test_plane_strain_is_that_of_a_plane_body():
    """One layer of hexahedra, alike in z: forces on both faces together are those of quadrilaterals, times the thickness."""
    material, thickness = Cosserat(cosserat_shear=70e6, characteristic_length=0.3, couple_alpha=1e6, couple_beta=-5e6, **LI_WAN), 0.7
    flat = Body(domains.rectangle((0, 0), (2.0, 1.5), (4, 3)), material, 100.0)
    deep = Body(domains.box((0, 0, 0), (2.0, 1.5, thickness), (4, 3, 1)), material, 100.0)
    upon = np.abs(deep.coordinates[:, None, :2] - flat.coordinates).max(axis=2).argmin(axis=1)
    motion, trial = np.random.default_rng(3).standard_normal(flat.mass.shape), np.zeros(deep.mass.shape)
    plane = [0, 1, 5]  # x, y, rotation about z
    trial[:, plane] = motion[upon]
    for found, wanted in ((deep.internal_force(trial), flat.internal_force(motion)), (deep.mass, flat.mass)):
        total = np.zeros_like(wanted)
        np.add.at(total, upon, found[:, plane])
        np.testing.assert_allclose(total, thickness * wanted, rtol=0.0, atol=1e-12 * np.abs(wanted).max())


def test_loads_and_reactions_count_micro_rotations(cell):
    """Everything held under weight, tractions and couples: reactions are minus the loads, moments about the origin."""
    body = distorted_body(cell, GRAINS, micro_inertia=50.0)
    assert body.mass.sum(axis=0) == pytest.approx(VOLUME * np.repeat([2600.0, 50.0], 3), rel=1e-13)
    body.gravity((1.0, 2.0, -9.81))
    body.traction("top", (3e3, 0.0, -2e3), couple=(1e3, -2e3, 5e2))
    weight, push = 2600.0 * VOLUME * np.array([1.0, 2.0, -9.81]), np.array([3e3, 0.0, -2e3]) * 3.0
    moment = np.cross(0.5 * SIZE, weight) + np.cross([*0.5 * SIZE[:2], SIZE[2]], push) + 3.0 * np.array([1e3, -2e3, 5e2])
    body.fix(EVERYWHERE, "xyzabc")
    assert body.reaction(EVERYWHERE) == pytest.approx(-np.concatenate((weight + push, moment)), rel=1e-11)
    flat = Body(domains.rectangle((0, 0), (2, 1), (3, 2)), GRAINS)
    flat.traction("top", (0.0, 0.0), couple=1.5)
    assert flat.external_force().sum(axis=0) == pytest.approx([0.0, 0.0, 3.0], rel=1e-14)
    with pytest.raises(ValueError, match="couple=.* needs a Cosserat material"):
        distorted_body(cell).traction("top", (0.0, 0.0, 0.0), couple=(1.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="couple=.* must be three finite numbers"):
        body.traction("top", (0.0, 0.0, 0.0), couple=1.0)


def test_micro_inertia_of_cells_and_spheres():
    """Six tetrahedra count as the cube that they make; spheres of radius r have 2/5 rho r^2."""
    for cell in ("hexahedron", "tetrahedron"):
        domain = domains.box((0, 0, 0), (1, 1, 1), (2, 2, 2), cell)
        assert Body(domain, GRAINS).mass[:, 3:].sum(axis=0) == pytest.approx([2600.0 * 0.25 / 12.0] * 3, rel=1e-12)
        spheres = Body(domain, GRAINS, "physical", particle_radius=0.1)
        assert spheres.mass[:, 3:].sum(axis=0) == pytest.approx([0.4 * 2600.0 * 0.01] * 3, rel=1e-12)


# Plane waves along x: components, and where they swing as a cosine (else a sine)
WAVES = {"rotation": ("a",), "coupled y": ("y", "c"), "coupled z": ("z", "b")}
INERTIA, LENGTH = 100.0, 20.0  # kg/m, m


def wave_matrix(wave, squares, cross, rotation, material=GRAINS):
    """Dynamic stiffness (Pa, N/m, ...) of the amplitudes and the inertias; with k^2, k and 1 that of the continuum.

    rho w^2 = (lambda + 2 G) k^2 and Theta w^2 = (alpha + beta + gamma) k^2 + 4 Gc along the axis; coupled across it,
    (rho w^2 - (G + Gc) k^2) (Theta w^2 - gamma k^2 - 4 Gc) = 4 Gc^2 k^2 (Eringen 1999, chapter 5).

    Args:
        squares, cross, rotation: k^2, k and 1; (2 - 2 cos kh)/h^2, sin(kh)/h and (2 + cos kh)/3 of two-node elements.
    """
    gc, gamma = material.cosserat_shear, material.couple_modulus
    if wave == "rotation":
        whole = material.couple_alpha + material.couple_beta + gamma
        return np.array([[whole * squares + 4.0 * gc * rotation]]), np.array([INERTIA])
    link = {"y": 2.0, "z": -2.0}[wave[-1]] * gc * cross
    matrix = [[(material.shear_modulus + gc) * squares, link], [link, gamma * squares + 4.0 * gc * rotation]]
    return np.array(matrix), np.array([material.density, INERTIA])


def branches(wave, *numbers):
    """Squares of the frequencies (1/s2) and amplitudes (components, branches)."""
    matrix, inertia = wave_matrix(wave, *numbers)
    root = 1.0 / np.sqrt(inertia)
    squares, vectors = np.linalg.eigh(matrix * np.outer(root, root))
    return squares, root[:, None] * vectors


def bar(cell, count, wave):
    """Bar along x in which only the components of a wave move, alike over its cross-section."""
    body = Body(domains.box((0, 0, 0), (LENGTH, 1, 1), (count, 1, 1), cell), GRAINS, INERTIA)
    moving = WAVES[wave]
    body.fix(EVERYWHERE, "".join(letter for letter in "xyzabc" if letter not in moving))
    for side in ("left", "right"):
        if len(moving) > 1:
            body.fix(side, moving[1])
    return body


def mode(body, wave, amplitudes, k):
    """Standing wave of given amplitudes: the first component as cos(k x), the second as sin(k x)."""
    shape = np.zeros_like(body.mass)
    for letter, amplitude, along in zip(WAVES[wave], amplitudes, (np.cos, np.sin)):
        shape[:, "xyzabc".index(letter)] = amplitude * along(k * body.coordinates[:, 0])
    return shape


@pytest.mark.parametrize("wave", WAVES)
def test_standing_waves_of_hexahedra_have_the_frequencies_of_a_bar(wave):
    """Every branch of the lumped two-node bar, by its closed form, over 40 steps: sin(w dt/2) = (dt/2) omega."""
    k, h = 3.0 * np.pi / LENGTH, 1.0
    numbers = (2.0 - 2.0 * np.cos(k * h)) / h**2, np.sin(k * h) / h, (2.0 + np.cos(k * h)) / 3.0
    squares, amplitudes = branches(wave, *numbers)
    for square, amplitude in zip(squares, amplitudes.T):
        body = bar("hexahedron", 20, wave)
        step = 0.5 * body.critical_step("power")
        start = mode(body, wave, 1e-4 * amplitude / np.abs(amplitude).max(), k)
        body.displacement[:] = start
        body.advance(40, step)
        turned = 40 * 2.0 * np.arcsin(0.5 * step * np.sqrt(square))
        np.testing.assert_allclose(body.displacement, start * np.cos(turned), rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("wave", WAVES)
def test_dispersion_converges_at_second_order(wave, cell):
    """Frequencies of all branches against the continuum's: Rayleigh's quotients of its waves with 10, 20 and 40 cells."""
    k = 2.0 * np.pi / LENGTH
    squares, amplitudes = branches(wave, k**2, k, 1.0)
    for square, amplitude in zip(squares, amplitudes.T):
        errors = []
        for count in (10, 20, 40):
            body = bar(cell, count, wave)
            shape = mode(body, wave, amplitude, k)
            found = np.vdot(shape, body.internal_force(shape)) / np.vdot(shape, body.mass * shape)
            errors.append(abs(np.sqrt(found / square) - 1.0))
        assert errors[-1] < 1e-2
        assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx([2.0, 2.0], abs=0.15), errors


def shaken(cell, **options):
    """A body with everything that does work: supports, a moving and turning side, traction, couples, weight."""
    body = distorted_body(cell, GRAINS, **options)
    body.fix("bottom", "xyzr")
    body.prescribe("top", "zb", lambda t: -0.1 * np.sin(2e4 * t))
    body.traction("right", (-1e5, 2e4, 1e4), couple=(1e3, 2e3, -3e3))
    body.gravity((0.0, 1.0, -9.81))
    return body


@every_damping
def test_energy_account_closes(damping, cell):
    check_energy_account(shaken(cell), damping)


def test_impulse_is_momentum(cell):
    """A free body under a constant traction and couple: M v = F t, M (x cross v) + Theta w = moment t about the origin."""
    body = distorted_body(cell, GRAINS)
    force, couple = np.array([2e4, -1e4, 5e3]), np.array([1e4, 3e3, -2e3])
    body.traction("right", force, couple)
    step = 0.5 * body.critical_step("power")
    body.advance(300, step)
    impulse, turn = force * 1.5 * 300 * step, couple * 1.5 * 300 * step
    momentum = body.mass * body.velocity
    np.testing.assert_allclose(momentum[:, :3].sum(axis=0), impulse, rtol=1e-11)
    spin = np.cross(body.coordinates, momentum[:, :3]).sum(axis=0) + momentum[:, 3:].sum(axis=0)
    np.testing.assert_allclose(spin, np.cross([2.0, 0.75, 0.5], impulse) + turn, rtol=0.0, atol=1e-10 * np.abs(impulse).max())


@pytest.mark.parametrize("inertia", [5.0, 500.0])
def test_the_critical_step_counts_rotations(inertia, cell):
    """Largest eigenvalue by numpy; uniform micro-rotation swings at 4 Gc / Theta exactly; growth 1 % above, none 1 % below."""
    body = distorted_body(cell, GRAINS, micro_inertia=inertia)
    uniform = np.hstack([np.zeros((body.count, 3)), np.broadcast_to(ROTATION, (body.count, 3))])
    couple = body.internal_force(uniform)[:, 3:]
    np.testing.assert_allclose(couple, 4.0 * GRAINS.cosserat_shear / inertia * body.mass[:, 3:] * ROTATION, rtol=1e-10)
    root = 1.0 / np.sqrt(body.mass.ravel())
    exact = 2.0 / np.sqrt(np.linalg.eigvalsh(dense_stiffness(body) * np.outer(root, root))[-1])
    power = body.critical_step("power")
    assert power == pytest.approx(exact, rel=1e-6) and power <= exact * (1 + 1e-12)
    assert 0.3 * exact < body.critical_step() <= exact < 1.0 / np.sqrt(GRAINS.cosserat_shear / inertia)
    still = distorted_body(cell, Cauchy(18e9, 0.25, 2600.0)).critical_step("power")
    assert (exact < 0.5 * still) == (inertia == 5.0)
    grown = []
    for factor in (0.99, 1.01):
        body = distorted_body(cell, GRAINS, micro_inertia=inertia)
        body.displacement[:] = 1e-270 * np.random.default_rng(0).standard_normal(body.mass.shape)
        start = np.abs(body.displacement).max()
        body.advance(2000, factor * power)
        grown.append(np.abs(body.displacement).max() / start)
    assert grown[0] < 1e5 and grown[1] > 1e200


def test_a_share_weighs_couples_and_inertia(cell):
    """Share linear in the cells, from 0 at x = 1 to 1 at x = 4: 14 m3 of 24 of inertia and of the energy of a uniform curvature."""
    material = replace(GRAINS, cosserat_shear=1e-30)
    share = lambda points: np.clip((points[:, 0] - 1.0) / 3.0, 0.0, 1.0)  # noqa: E731
    body = Body(domains.box((0, 0, 0), (6, 2, 2), (6, 2, 2), cell), material, INERTIA, share=share)
    assert body.mass[:, 3:].sum(axis=0) == pytest.approx([14.0 * INERTIA] * 3, rel=1e-12)
    body.displacement[:, 3:] = body.coordinates @ CURVATURE
    assert body.strain_energy() == pytest.approx(0.5 * np.vdot(couple_of(CURVATURE), CURVATURE) * 14.0, rel=1e-11)
