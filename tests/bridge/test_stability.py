"""Growth and energy of the variants."""

import numpy as np
import pytest
import scipy.sparse as sparse

from bridge import BridgingScale, Growth, growth
from bridge.linear import LinearSystem
from tests.bridge.scenes import ELASTIC, GRANULAR, scene

RADIUS = 0.125 / np.sqrt(2.0)  # four rows of the turned lattice in a metre
SMALL = dict(size=(4.0, 3.0), radius=RADIUS, region=((1.0, 2.0), (3.0, 4.0)), anchor=(0.0, 2.0), law=ELASTIC)


@pytest.mark.parametrize("substeps", [1, 2, 4])
@pytest.mark.parametrize("variant", ["respa", "multiplier"])
def test_variants_with_coarse_unknowns_outside_only_do_not_grow(variant, substeps):
    coupled, _ = scene(**SMALL, step=1e-4 * substeps, substeps=substeps, variant=variant)
    assert not growth(coupled).grows


def test_multipliers_shorten_the_coarse_step_by_the_mass_that_ghosts_carry():
    """Nodes keep 0.3 of their mass at least, and the step sqrt(0.3) of its limit; what is above was NaN after some steps."""
    options = {**SMALL, "variant": "multiplier"}
    made, _ = scene(**options, step=1e-4)
    most, alone = made.critical_coarse_step(), made.body.critical_step("power")
    assert np.sqrt(0.3) * alone <= most < alone
    assert scene(**options, step=0.999 * most, substeps=8)[0].step < most
    with pytest.raises(ValueError, match="variant='multiplier'"):
        scene(**options, step=1.001 * most, substeps=8)


@pytest.mark.parametrize("substeps", [1, 2, 4, 8, 11])
def test_subcycling_does_not_grow_near_the_critical_steps(substeps):
    """Undamped, particle steps at 0.75 of their critical one and coarse steps at up to 0.7 of theirs (2.42 ms)."""
    step = min(3.5e-4 * substeps, 0.7 * 2.42e-3)
    coupled, _ = scene(**SMALL, step=step, substeps=substeps)
    assert coupled.substeps < 8 or 0.69 < coupled.step / coupled.body.critical_step() < 0.71
    assert not growth(coupled).grows


@pytest.mark.parametrize("substeps", [4, 8, 11])
def test_white_noise_in_a_free_body_does_not_grow(substeps):
    """1500 undamped coarse steps of 0.66 or 0.7 of the critical one, 2.5 s: what grows by 0.5 1/s would have become visible.

    (`respa` grows by 2 1/s here with 8 and 11 substeps, `multiplier` by 1.6 1/s with 4.)
    """
    step = min(4e-4 * substeps, 0.7 * 2.42e-3)
    coupled, _ = scene(**SMALL, fixed=(), step=step, substeps=substeps, variant="subcycling")
    body, soil = coupled.body, coupled.soil
    stiffness = soil.stiffness_matrix(contact_range=1e-6)
    stiffness = stiffness + 1e-4 * abs(stiffness).max() * sparse.identity(stiffness.shape[0])  # holds loose particles
    squares = []
    with LinearSystem(coupled, stiffness, scale=1e-3) as linear:
        linear.write(np.random.default_rng(1).standard_normal(len(linear.read())))
        for _ in range(1500):
            linear.step()
            nodes, particles = np.vdot(coupled.mass, body.velocity**2), np.vdot(soil.masses, soil.velocities[:, 0] ** 2)
            squares.append(nodes + particles)
    early, late = np.mean(squares[:300]), np.mean(squares[-300:])
    assert 0.2 * early < late < early


def test_the_published_scheme_flutters_without_damping_and_damping_cures_it():
    rates = []
    for damping in (0.0, 200.0):
        coupled, _ = scene(**SMALL, step=1e-4, substeps=1, variant="paper", mass_damping=damping)
        rates.append(growth(coupled).rate)
    assert rates[0] > 5.0 > 0.0 > rates[1]


@pytest.mark.parametrize("variant", ["multiplier", "subcycling"])
def test_the_test_leaves_the_run_as_it_was(variant):
    runs = []
    for tested in (False, True):
        plate = ((1.5, 3.0 + RADIUS), (2.5, 3.5), (0.0, -0.5))
        coupled, _ = scene(**SMALL, plate=plate, step=2e-4, substeps=2, variant=variant, mass_damping=20.0)
        coupled.soil.velocities = 1e-3 * np.random.default_rng(4).standard_normal((coupled.soil.count, 3))
        coupled.advance(5)
        if tested:
            growth(coupled)
        coupled.advance(20)
        runs.append((coupled.soil.displacements, coupled.body.displacement.copy(), coupled.energies()))
    for kept, plain in zip(*runs, strict=True):
        np.testing.assert_equal(kept, plain)


def test_growth_speaks_plainly():
    found = Growth(spectral_radius=1.01, rate=np.log(1.01) / 1e-3, step=1e-3)
    assert found.over(0.1) == pytest.approx(1.01**100)
    with pytest.warns(UserWarning, match="variant resync grows by 9.95 1/s, a factor 2.7 in this run"):
        found.warn(0.1, "variant resync")
    assert Growth(1.0, 0.0, 1e-3).warn(1.0, "anything") is None


def balance(variant, refinement, substeps=2):
    plate = ((1.5, 3.0 + RADIUS), (2.5, 3.5), (0.0, -0.5))
    step = 1e-4 / refinement
    coupled, _ = scene(
        **{**SMALL, "law": GRANULAR},
        plate=plate,
        step=step * substeps,
        substeps=substeps,
        variant=variant,
        mass_damping=100.0,
    )
    coupled.advance(int(round(0.02 / coupled.step)))
    return coupled.energies()


@pytest.mark.parametrize("variant", ["paper", "resync", "respa", "multiplier", "subcycling"])
def test_energy_balance_closes_and_the_error_falls_with_the_step(variant):
    coarse, fine = balance(variant, 1), balance(variant, 4)
    errors = [abs(e["balance"]) / e["external"] for e in (coarse, fine)]
    assert errors[0] < 1e-3
    assert errors[1] < 0.3 * errors[0]  # first order at least: a quarter of the step
    assert all(e[name] > 0.0 for e in (coarse, fine) for name in ("friction", "mass_damping", "strain", "elastic"))


def test_many_substeps_cost_no_energy():
    """The continuum's force acts evenly: 1e-4 of the work at 11 substeps as at one.

    In impulses at the coarse times (`respa`) it shakes the interface, friction there takes what the impulses bring: 3e-3.
    """
    for substeps in (1, 4, 11):
        energies = balance("subcycling", 1, substeps)
        assert abs(energies["balance"]) < 1e-4 * energies["external"]
        assert energies["interface"] == 0.0


def test_slaved_nodes_lose_nothing_at_the_interface():
    energies = balance("respa", 1, substeps=4)
    assert abs(energies["interface"]) < 1e-12 * energies["external"]


def test_particles_that_do_not_fit_the_body_are_refused():
    coupled, layout = scene(**SMALL, step=1e-4)
    body, soil, ghosts = coupled.body, coupled.soil, layout.ghost
    wrong = ghosts.copy()
    wrong[np.argmin(np.linalg.norm(soil.reference - [2.0, 2.5], axis=1))] = True
    for arguments, words in [
        ((wrong, 0.5), "is a ghost but lies inside the body's excluded region"),
        ((~ghosts, 0.5), "is no ghost but lies outside|is a ghost but lies inside"),
        ((ghosts[:-1], 0.5), "ghosts of shape"),
        ((ghosts, np.nan), "share of shape"),
        ((ghosts, 2.0), "share of shape"),
        ((ghosts, layout.share[:-1]), "share of shape"),
    ]:
        with pytest.raises(ValueError, match=words):
            BridgingScale(body, soil, *arguments, step=1e-4)
    with pytest.raises(ValueError, match="must be at most the particles'"):
        BridgingScale(body, soil, ghosts, step=2e-3)
    with pytest.raises(ValueError, match="must be at most the continuum's critical step"):
        BridgingScale(body, soil, ghosts, step=4e-3, substeps=40)


def test_changes_of_the_body_after_the_coupling_are_refused():
    coupled, _ = scene(**SMALL, step=1e-4)
    with pytest.raises(ValueError, match="steps=-1 must be"):
        coupled.advance(-1)
    coupled.body.traction("top", (0.0, -1e4))
    with pytest.raises(ValueError, match="must be set before BridgingScale is made"):
        coupled.advance(1)


@pytest.mark.parametrize("variant", ["paper", "resync", "respa", "multiplier", "subcycling"])
def test_gravity_counts_every_mass_once(variant):
    """Weight that the nodes feel at rest, and that of the particles: g times the mass of continuum, particles and shares."""
    coupled, layout = scene(**SMALL, gravity=(0.0, -10.0), step=1e-4, substeps=2, variant=variant)
    soil, ghosts = coupled.soil, layout.ghost
    particles = np.sum(soil.masses[~ghosts]) + np.sum(layout.share * soil.masses[ghosts])
    total = -10.0 * (coupled.body.mass[:, 1].sum() + particles)
    loads = coupled.rule.continuum_force[:, 1].sum()
    if variant == "multiplier":
        loads += coupled.soil.forces[:, 1].sum()  # tied ghosts carry all of their weight
    elif variant == "subcycling":
        loads += coupled.soil.forces[~ghosts, 1].sum()  # the nodes carry all of the ghosts' weight
    else:
        loads += coupled.soil.forces[~ghosts, 1].sum() + coupled.fine.reaction[:, 1].sum()
    assert loads == pytest.approx(total, rel=1e-12)


def test_bad_settings_are_named():
    for options, words in [
        (dict(variant="best"), "variant='best' must be one of paper, resync, respa, multiplier, subcycling"),
        (dict(substeps=0), "substeps=0 must be a whole number"),
        (dict(substeps=1.5), "substeps=1.5 must be a whole number"),
        (dict(step=-1.0), "step=-1.0 must be positive"),
        (dict(mass_damping=float("nan")), "mass_damping=nan must be zero or positive"),
    ]:
        with pytest.raises(ValueError, match=words):
            scene(**SMALL, **{"step": 1e-4, **options})
