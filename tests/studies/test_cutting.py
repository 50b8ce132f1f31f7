"""Rock cutting: the motion of the pick, an elastic block by both methods, energy, the command and what it leaves."""

import dataclasses
import json

import numpy as np
import pytest
from click.testing import CliRunner

from bridge.run import run
from studies import cutting as scene
from studies.cracks import fragments
from studies.cutting import Parameters
from studies.cutting_command import command, compared
from studies.cutting_models import MODELS
from studies.cutting_run import LARGEST_ERROR, way

SMALL = {
    "block": "0.12x0.08", "depth": 0.003, "region": "0.1x0.045", "overlap": 0.015, "element_size": 0.005, "arm": 0.1, "rotation": 11.0,
    "porosity": 0.16,
}  # fmt: skip
P = Parameters(**SMALL)


def cut(p, samples=40):
    model = MODELS[p.method](p)
    return model, run(model, model.steps, samples=samples, progress=False)


@pytest.fixture(scope="module", params=["dem", "overlap"])
def done(request):
    return cut(dataclasses.replace(P, method=request.param, path=0.5))


def test_the_path_of_the_tip():
    """In at the surface, deepest in the middle, out as far on the other side; area and length against fine sums of a cycloid."""
    ends = np.array([scene.tip_at(P, time) for time in (0.0, 0.5 * P.duration, P.duration)])
    np.testing.assert_allclose(ends[:, 1], [scene.CLEARANCE, -0.003, scene.CLEARANCE], atol=1e-15)
    np.testing.assert_allclose(ends[:, 0], [-0.5 * P.path_length, 0.0, 0.5 * P.path_length], atol=1e-15)
    still = dataclasses.replace(P, swing=0.0)
    length, area = way(still, still.duration)
    half = np.arccos(1.0 - 0.003 / still.arm)  # segment of a circle below the surface
    assert length == pytest.approx(2.0 * still.arm * still.half_angle, rel=1e-6)
    assert area == pytest.approx(still.arm**2 * (half - np.sin(half) * np.cos(half)), rel=1e-4)


def test_the_wall_moves_as_the_path_says(done):
    model, _ = done
    np.testing.assert_allclose(model.pick.vertices[0], scene.tip_at(model.p, model.time), atol=1e-9 * model.p.arm)


def test_the_work_of_the_pick_is_accounted_for(done):
    """Bonds break and chips knock between two steps, which is booked to first order: below what the study warns of.

    Without such events it closes to 1e-5, see the elastic block.
    """
    model, outcome = done
    energies = model.energies()
    assert outcome.stable and len(model.soil.breaks) > 10
    assert energies["external_work"] == pytest.approx(model.pick.work, rel=1e-9)
    assert abs(energies["balance"]) < LARGEST_ERROR * energies["external_work"]
    force, time = outcome.column("cutting_force_N"), outcome.column("time_s")
    steps = [way(model.p, t)[0] for t in time]  # force times way is the work
    assert np.sum(force[1:] * np.diff(steps)) == pytest.approx(model.pick.work, rel=1e-3)


def test_what_comes_loose_was_held_by_bonds_that_broke(done):
    model, _ = done
    pieces, broken = fragments(model.soil), model.soil.breaks[:, 1:3].astype(int)
    whole = fragments(scene.bonded(model.p, slice(None) if model.body is None else scene.region(model.p).distance(scene.sites(model.p)[0]) <= 0.0))
    came = np.flatnonzero((pieces > 0) & (whole == 0))
    assert 0 < len(came) < 0.1 * model.soil.count
    for piece in np.unique(pieces[came]):
        assert np.isin(np.flatnonzero(pieces == piece), broken).any()


def test_an_elastic_block_resists_the_pick_as_particles_alone_do():
    """With bonds that do not break both methods give one force, but for the moduli: those of `ucs`, of a denser packing.

    The bound is the scatter of the stiffness of packings as small as this one and its lower number of bonds (docs/rock.md).
    """
    p = dataclasses.replace(P, strength=1e12, path=0.1)
    (one, alone), (other, both) = (cut(dataclasses.replace(p, method=method)) for method in ("dem", "overlap"))
    assert other.soil.count < 0.5 * one.soil.count
    for model in (one, other):
        assert abs(model.energies()["balance"]) < 1e-5 * model.pick.work
    assert both.column("work_J")[-1] == pytest.approx(alone.column("work_J")[-1], rel=0.1)
    force, expected = both.column("cutting_force_N"), alone.column("cutting_force_N")
    assert np.linalg.norm(force - expected) < 0.1 * np.linalg.norm(expected)


def test_the_command_compares_both_methods(tmp_path):
    options = [word for name, value in SMALL.items() for word in (f"--{name.replace('_', '-')}", str(value))]
    found = CliRunner().invoke(
        command, ["--compare", *options, "--path", "0.06", "--samples", "10", "--frames", "3", "--output", str(tmp_path / "cut"), "--quiet"],
        standalone_mode=False,
    )  # fmt: skip
    assert found.exception is None and found.return_value == 0
    comparison = json.loads((tmp_path / "cut/comparison.json").read_text())
    assert (tmp_path / "cut/comparison.txt").read_text() == compared(comparison)
    rows = {row["quantity"]: row for row in comparison["rows"]}
    assert rows["work"]["dem"] / rows["path"]["dem"] == pytest.approx(rows["mean_cutting_force"]["dem"])
    for method in ("dem", "overlap"):
        folder = tmp_path / "cut" / method
        written = {path.name for path in folder.iterdir()}
        assert {"summary.json", "history.csv", "cracks.csv", "force.png", "states.png", "stress.png", "fields"} <= written
        summary = json.loads((folder / "summary.json").read_text())
        assert summary["stable"] and summary["method"] == method
        assert summary["results"]["cracks"]["value"] == len((folder / "cracks.csv").read_text().splitlines()) - 1
        assert (folder / "fields/continuum.pvd").exists() == (method == "overlap")


@pytest.mark.parametrize(
    "options, words",
    [
        ({"method": "fem"}, "method=fem must be one of dem, overlap"),
        ({"depth": 0.02}, "too long for a block"),
        ({"depth": 0.045}, "below half the block's height"),
        ({"region": "0.07x0.045"}, "must hold the cut"),
        ({"region": "0.13x0.045"}, "must lie within the block"),
        ({"element_size": 0.007}, "must divide the block"),
        ({"rake": 50.0, "back": 50.0}, "less than 85 degrees together"),
        ({"block": "120x80"}, "are both lengths in metres"),
        ({"block": "wide"}, "must be WIDTHxDEPTH in metres"),
    ],
)
def test_bad_input_is_refused_in_one_sentence(options, words):
    with pytest.raises(ValueError, match=words):
        Parameters(**(SMALL | options))
