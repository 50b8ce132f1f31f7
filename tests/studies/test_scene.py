"""The foundation's scene: counts of the paper, supports, moduli, steps that end at the displacement."""

import dataclasses
import warnings

import numpy as np
import pytest

from bridge.run import Stopwatch
from particles import measures
from studies import foundation as scene
from studies.foundation import Parameters
from studies.foundation_coupled import MODELS
from studies.foundation_run import carry_out, frame_steps, set_up
from studies.snapshots import neighbourhood_average


@pytest.mark.parametrize("assembly, count", [("A", 2426), ("B", 6765)])
def test_the_extended_region_holds_the_papers_discs(assembly, count):
    """Li & Wan (2010), section 3: 2426 and 6765 discs, which fill 7 m x 3.5 m."""
    soil, ghosts, _ = scene.nested_particles(Parameters(assembly=assembly, region="7x3.5"))
    assert soil.count - ghosts.sum() == count


@pytest.mark.parametrize(
    "region, side", [("17.9x8.9", "left of"), ("17.9x3", "left of"), ("6x8.9", "below"), ("8x3", "right of")]
)
def test_a_region_that_its_ghosts_do_not_surround_is_refused(region, side):
    """The lattice of 0.1 m discs begins more than 0.1 m inside the soil: no site is left for ghosts beyond that."""
    place = 13.95 if side == "right of" else 9.0
    with pytest.raises(ValueError, match=f"region={region} leaves too few discs .ghosts. {side} the region"):
        scene.nested_particles(Parameters(radius=0.1, region=region, plate_position=place))


@pytest.mark.parametrize("region", ["6x3", "7x3.5", "5.3x2.1", "16x8"])
@pytest.mark.parametrize("radius", [0.05, 0.1, 0.2])
def test_usual_regions_are_surrounded_by_ghosts(region, radius):
    assert scene.nested_particles(Parameters(radius=radius, region=region))[1].any()


def test_region_and_whole_soil_hold_the_same_discs():
    p = Parameters(radius=0.2)
    whole = {tuple(site) for site in np.round(scene.sites(p)[0], 9)}
    nested = scene.nested_particles(p)[0].reference
    assert {tuple(site) for site in np.round(nested, 9)} <= whole


def test_moduli_of_the_lattice_are_the_closed_ones():
    """Two contacts a disc at +-45 degrees, cell area (2 r)^2: D_yyyy = (k_N + k_s) / 2, D_xxyy = 0, for any radius.

    eps_kl = u_l,k: sum over n = (1, +-1)/sqrt 2 of n_i n_k (k_N n_j n_l + k_s t_j t_l) l^2 / area with l^2 = area. For
    i = j = k = l = y: 2 x 1/4 (k_N + k_s). For xxyy: n_x n_y (k_N n_x n_y + k_s t_x t_y), 2 x 1/4 (k_N - k_s). B = (r^2
    k_r + k_w) per contact, both directions together the unit tensor.
    """
    p = Parameters(radius=0.2)
    material = scene.material(p)
    normal, sliding = p.normal_stiffness, p.sliding_stiffness
    assert material.stiffness[1, 1, 1, 1] == pytest.approx(0.5 * (normal + sliding), rel=1e-6)
    assert material.stiffness[0, 0, 1, 1] == pytest.approx(0.5 * (normal - sliding), rel=1e-6)
    rolling = 0.2**2 * p.rolling_stiffness + p.moment_stiffness
    assert np.allclose(material.couple, rolling * np.eye(2), rtol=1e-6, atol=1e-6 * rolling)
    assert material.density == pytest.approx(2600.0 * np.pi / 4.0)


def test_the_lowest_row_and_the_outermost_columns_are_held():
    p = Parameters(radius=0.2, method="dem")
    soil = scene.all_particles(p)
    soil.advance(20, 0.5 * soil.critical_step())
    soil.external_forces = np.tile([1e5, -1e5, 1e3], (soil.count, 1))
    soil.advance(20, 0.5 * soil.critical_step())
    x, y = soil.reference.T
    moved = np.abs(soil.displacements)
    lowest = y < y.min() + 0.1
    assert moved[lowest].max() == 0.0
    for side in (x < x.min() + 0.1, x > x.max() - 0.1):
        assert moved[side][:, [0, 2]].max() == 0.0
        assert moved[side & ~lowest][:, 1].min() > 0.0


@pytest.mark.parametrize("method", ["dem", "bridging", "overlap", "fem"])
@pytest.mark.parametrize("displacement", [0.002, 0.00777])
def test_steps_end_exactly_at_the_displacement(method, displacement):
    p = Parameters(method=method, radius=0.2, displacement=displacement, speed=0.7)
    model = MODELS[method](p, Stopwatch())
    assert model.steps * model.step * p.speed == pytest.approx(displacement, rel=1e-12)
    sizes = model.step_sizes
    for scale in {"dem": ["fine"], "bridging": ["fine", "coarse"], "overlap": ["fine", "coarse"], "fem": ["coarse"]}[method]:
        assert sizes[scale] <= 0.5 * sizes[f"{scale}_critical"] * (1.0 + 1e-9)


@pytest.mark.parametrize(
    "bad, sentence", [({"substeps": 100}, "substeps=100 makes"), ({"step": 0.1}, "step=0.1 must be")]
)
def test_steps_above_the_limit_are_refused(bad, sentence):
    with pytest.raises(ValueError, match=sentence):
        MODELS["bridging"](Parameters(radius=0.2, **bad), Stopwatch())


def test_a_sliver_of_an_element_shortens_the_particles_step():
    """An element of which a thousandth is left has a critical step below the particles' own."""
    p = Parameters(radius=0.1, region="5.999x3", displacement=0.01)
    with pytest.warns(UserWarning, match="region=5.999x3 .* sliver .* shortened"):
        model = MODELS["bridging"](p, Stopwatch())
    assert model.coupled.substeps == 1
    assert 0.49 < model.step / model.step_sizes["coarse_critical"] <= 0.5 * (1.0 + 1e-9)
    assert model.step < 0.5 * model.step_sizes["fine_critical"]
    with pytest.raises(ValueError, match="^step=0.0002 makes a coarse step"):
        MODELS["bridging"](dataclasses.replace(p, step=2e-4), Stopwatch())


def test_a_variant_that_may_grow_is_warned_of():
    with pytest.warns(UserWarning, match="damping=1 1/s may grow"):
        MODELS["bridging"](Parameters(radius=0.2, variant="resync", damping=1.0), Stopwatch())


@pytest.mark.parametrize("variant", ["subcycling", "respa", "multiplier"])
def test_the_sound_variants_are_warned_of_near_the_critical_step_alone(variant):
    """None needs damping up to 0.7 of the continuum's critical step."""
    p = Parameters(radius=0.2, variant=variant, damping=0.0, region="6x3")
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        sizes = MODELS["bridging"](p, Stopwatch()).step_sizes
    near = dataclasses.replace(p, step=0.9 * sizes["coarse_critical"] / 3, substeps=3)
    with pytest.warns(UserWarning, match=r"of 0\.\d+ of the continuum's critical step may grow; .*--growth-test"):
        MODELS["bridging"](near, Stopwatch())


def test_respa_keeps_the_energy_at_the_interface():
    """The multiplier loses energy there for more than one substep; respa does not (to rounding of the sums)."""
    done = carry_out(set_up(Parameters(radius=0.2, displacement=0.02, substeps=2, variant="respa")), figures=False, progress=False)
    energy = done.summary["energy"]
    assert abs(energy["interface"]) < 1e-6 * energy["external_work"]


def test_frames_hold_the_papers_states_and_the_ends():
    steps = frame_steps(Parameters(), 1e-4, 600, 8)
    assert {0, 150, 380, 600} <= set(steps)
    assert steps == sorted(set(steps))


def test_averages_around_discs_are_those_of_the_measures():
    """The averages over circles at all discs equal the point-wise ones of `particles.measures`."""
    p = Parameters(radius=0.2, method="dem")
    soil = scene.all_particles(p)
    soil.advance(30, 0.5 * soil.critical_step())
    size = 2.5 * soil.radii.max()
    stress = measures.particle_stress(soil)
    mine = neighbourhood_average(soil.positions, soil.radii, stress.reshape(-1, 4), size).reshape(-1, 2, 2)
    theirs = measures.averaged_stress(soil, soil.positions, size, solid_fraction=1.0)
    assert np.abs(theirs).max() > 1e4
    assert np.allclose(mine, theirs, rtol=1e-9, atol=1e-9 * np.abs(theirs).max())


@pytest.mark.parametrize("method", ["dem", "bridging", "fem"])
def test_the_external_work_is_that_of_the_load(method):
    """Only the plate does work; the trapezoidal rule over samples that are not every step is good to a few per cent."""
    done = carry_out(set_up(Parameters(method=method, radius=0.2, displacement=0.02)), figures=False, progress=False)
    load, moved = done.outcome.column("load_N"), done.outcome.column("displacement_m")
    work = np.sum(0.5 * (load[1:] + load[:-1]) * np.diff(moved))
    assert done.outcome.column("external_work_J")[-1] == pytest.approx(work, rel=0.05)
