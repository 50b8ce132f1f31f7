"""The foundation end to end: files of the contract, physics of the three methods, one-sentence refusals."""

import csv
import json
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import meshio
import numpy as np
import pytest

from meshes._gmsh import session
from studies.accuracy import _case as accuracy_case
from studies.accuracy import read_settings
from studies.foundation import Parameters
from studies.foundation_run import doubts

ROOT = Path(__file__).resolve().parent.parent.parent
SMALL = ["--radius", "0.2", "--displacement", "0.004"]
KEYS = {
    "study", "method", "parameters", "seed", "versions", "ranks", "threads", "counts", "steps", "seconds",
    "particle_steps_per_second", "results", "energy", "stable", "warnings",
}  # fmt: skip
PARTS = {"dem": {"particles", "contacts"}, "bridging": {"particles", "contacts", "continuum"}, "fem": {"continuum"}}
FIGURES = {
    "load_displacement",
    "volumetric_stress",
    "effective_stress",
    "volumetric_strain",
    "effective_strain",
    "velocities",
}


def studies(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "studies", *map(str, arguments)], cwd=ROOT, capture_output=True, text=True,
        stdin=subprocess.DEVNULL,
    )  # fmt: skip


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    folder = tmp_path_factory.mktemp("compared")
    answer = studies("foundation", "--compare", *SMALL, "--output", folder)
    assert answer.returncode == 0, answer.stderr
    assert not answer.stderr  # no progress bar where it is not a terminal
    return folder, answer.stdout


def history(folder):
    with (folder / "history.csv").open() as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


@pytest.mark.parametrize("method", ["dem", "bridging", "fem"])
def test_a_run_leaves_behind_what_the_contract_says(compared, method):
    folder = compared[0] / method
    summary = json.loads((folder / "summary.json").read_text())
    assert KEYS <= set(summary)
    assert summary["method"] == method and summary["stable"] and summary["parameters"]["radius"] == 0.2
    assert {"setup", "compile", "stepping", "coupling", "output", "total"} == set(summary["seconds"])
    assert all({"value", "unit", "published"} == set(entry) for entry in summary["results"].values())
    assert set(summary["energy"]) >= {"external_work", "kinetic", "elastic", "friction", "balance_error"}
    assert summary["energy"]["balance_error"] < 0.01  # the limit
    columns = history(folder)
    assert columns["time_s"][0] == 0.0 and np.all(np.diff(columns["time_s"]) > 0.0)
    assert columns["displacement_m"][-1] == pytest.approx(0.004)
    assert columns["load_N"].max() == pytest.approx(summary["results"]["peak_load"]["value"])
    expected = FIGURES | ({"contact_forces"} if method != "fem" else set())
    assert {picture.stem for picture in folder.glob("*.png")} == expected


@pytest.mark.parametrize("method", ["dem", "bridging", "fem"])
def test_fields_are_series_on_one_time_axis(compared, method):
    folder = compared[0] / method / "fields"
    axes = {}
    for series in folder.glob("*.pvd"):
        entries = ElementTree.parse(series).getroot().findall("Collection/DataSet")
        axes[series.stem] = [float(entry.get("timestep")) for entry in entries]
        last = meshio.read(folder / entries[-1].get("file"))
        assert len(last.points) > 0
    assert set(axes) == PARTS[method]
    assert len({tuple(axis) for axis in axes.values()}) == 1
    times = next(iter(axes.values()))
    assert times[0] == 0.0 and times[-1] == pytest.approx(0.004)


def test_a_scene_is_computed_by_overlap_with_one_argument_changed(compared, tmp_path):
    """The same soil; its rim is shared: peak near that of particles alone, energy accounted for."""
    answer = studies("foundation", "--method", "overlap", *SMALL, "--output", tmp_path)
    assert answer.returncode == 0 and not answer.stderr, answer.stderr
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["method"] == "overlap" and summary["energy"]["balance_error"] < 0.01
    assert {file.stem for file in (tmp_path / "fields").glob("*.pvd")} == PARTS["bridging"]
    alone = json.loads((compared[0] / "dem" / "summary.json").read_text())
    loads = [one["results"]["peak_load"]["value"] for one in (summary, alone)]
    assert loads[0] == pytest.approx(loads[1], rel=0.3)


def test_a_run_clears_away_every_kind_of_file_that_it_writes(compared):
    """Else an old file would pass for a new one: the names are a list of their own."""
    from studies import foundation_compare, foundation_run

    for method in ("dem", "bridging", "fem"):
        folder = compared[0] / method
        assert {file.name for file in folder.iterdir() if file.is_file()} <= set(foundation_run.FILES)
        assert {file.name.split("_")[0] for file in (folder / "fields").glob("*.vtu")} <= set(foundation_run.SERIES)
    assert {file.name for file in compared[0].iterdir() if file.is_file()} <= set(foundation_compare.FILES)


def test_the_continuum_in_the_files_covers_the_soil_without_the_particles_elements(compared):
    mesh = meshio.read(sorted((compared[0] / "bridging/fields").glob("continuum_*.vtu"))[-1])
    corners = mesh.points[mesh.cells[0].data][:, :, :2]
    following = np.roll(corners, -1, axis=1)
    area = 0.5 * np.sum(corners[:, :, 0] * following[:, :, 1] - corners[:, :, 1] * following[:, :, 0], axis=1)
    assert np.allclose(area, 1.0)  # counter-clockwise squares of 1 m
    assert area.sum() == pytest.approx(18.0 * 9.0 - 6.0 * 3.0)


def test_bridging_and_particles_coincide_until_the_wave_reaches_the_interface(compared):
    """The fastest wave in the lattice covers 2 m to the region's side in about 6 ms; the run ends at 4 ms."""
    particles, bridging = (history(compared[0] / method) for method in ("dem", "bridging"))
    expected = np.interp(bridging["time_s"], particles["time_s"], particles["load_N"])
    assert np.allclose(bridging["load_N"], expected, rtol=1e-9)


def test_the_first_load_is_that_of_a_plane_wave(compared):
    """Impedance: a plate of width b at speed v feels at first b v sqrt(rho C), C the modulus along the motion.

    Wave in the lattice with contacts at +-45 degrees along y: C = D_yyyy = (k_N + k_s)/2. Corners and the lattice's coarseness
    make it rough: within 10 per cent.
    """
    columns = history(compared[0] / "dem")
    impedance = 2.0 * np.sqrt(2600.0 * np.pi / 4.0 * 0.5 * 3.0e8)
    early = np.interp(0.0012, columns["time_s"], columns["load_N"])
    assert early == pytest.approx(impedance, rel=0.1)


def test_the_comparison_has_the_papers_rows(compared):
    folder, printed = compared
    assert printed.startswith((folder / "comparison.txt").read_text())
    content = json.loads((folder / "comparison.json").read_text())
    names = [row["quantity"] for row in content["rows"]]
    with (folder / "comparison.csv").open() as file:
        assert [row["quantity"] for row in csv.DictReader(file)] == names
    table_2 = ["load", "min_volumetric_stress", "max_effective_stress", "min_volumetric_strain", "max_effective_strain"]
    assert {*table_2, "total_time", "peak_load", "peak_displacement"} == set(names)
    by_name = {row["quantity"]: row for row in content["rows"]}
    assert by_name["min_volumetric_stress"]["dem"] < 0.0 < by_name["max_effective_stress"]["dem"]  # compression
    assert by_name["load"]["published_dem"] is None  # another scene than the paper's
    assert (folder / "load_displacement.png").exists()


def test_published_numbers_stand_beside_the_papers_scene(tmp_path):
    answer = studies("foundation", "--method", "fem", "--output", tmp_path, "--no-fields", "--no-figures")
    assert answer.returncode == 0, answer.stderr
    assert Parameters().is_papers_scene and not Parameters(assembly="B").is_papers_scene
    assert not Parameters(speed=0.5).is_papers_scene


@pytest.mark.parametrize("cell", ["triangle", "quad"])
def test_a_users_own_mesh_is_taken(tmp_path, cell):
    with session() as gmsh:
        gmsh.model.occ.addRectangle(0.0, 0.0, 0.0, 18.0, 9.0)
        gmsh.model.occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMax", 1.0)
        gmsh.option.setNumber("Mesh.RecombineAll", 1 if cell == "quad" else 0)
        gmsh.option.setNumber("Mesh.RecombinationAlgorithm", 3)
        gmsh.model.mesh.generate(2)
        gmsh.write(str(tmp_path / "own.msh"))
    answer = studies("foundation", *SMALL, "--mesh", tmp_path / "own.msh", "--output", tmp_path / "out", "--no-figures")
    assert answer.returncode == 0, answer.stderr
    assert meshio.read(tmp_path / "out/fields/continuum_0001.vtu").cells[0].type == cell


REFUSED = {
    "foundation --normal-stiffness -1": "normal_stiffness=-1.0",
    "foundation --region 30x3": "region=30x3",
    "foundation --substeps 1000": "substeps=1000",
    "foundation --method overlap --overlap 3": "overlap=3",
    "foundation --method overlap --substeps 1000": "substeps=1000",
    "foundation --step 0.1": "step=0.1",
    "foundation --method dem --speed 1000": "speed=1000.0",
    "foundation --mesh {bad}": "bad.msh",
    "foundation --compare --mesh {bad}": "bad.msh",
    "foundation --radius 0.5 --region 2x0.4": "region=2x0.4 holds no particle",
    "foundation --method fem --step 1": "step=1.0 must be at most the continuum",
    "foundation --output {bad}/below": "output=",
    "foundation --output=": "output= is empty",
    "accuracy foundation --output=": "output= is empty",
    "accuracy foundation --step 0.1": "step=0.1",
    "foundation --method dem --region abc": "region=abc",
    "foundation --method dem --speed 1e-7": "10000000 steps",
    "foundation --method fem --step-ratio 0.5 --speed 1e-300": "10000000 steps",
    f"foundation --seed {10**400}": "seed=a number of more than 25 digits",
    f"foundation --substeps {10**400}.5": "--substeps",
    "foundation --colour red": "--colour",
    "foundation --substeps many": "--substeps",
    "accuracy foundation --settings {bad}": "settings=",
    "footing": "footing",
}


@pytest.mark.parametrize("line", REFUSED)
def test_bad_input_is_one_sentence_and_status_2(tmp_path, line):
    bad = tmp_path / "bad.msh"
    bad.write_text("no mesh\n")
    output = [] if "--output" in line or line == "footing" else ["--output", tmp_path / "out"]
    answer = studies(*line.format(bad=bad).split(), *output)
    assert answer.returncode == 2 and not answer.stdout
    assert len(answer.stderr.splitlines()) == 1 and REFUSED[line] in answer.stderr and len(answer.stderr) < 500
    assert list(tmp_path.iterdir()) == [bad]  # a refused run leaves nothing, not even a folder


@pytest.mark.parametrize(
    "setting", [{"region": None}, {"region": 6}, {"substeps": 1.5}, {"damping": "much"}, {"mesh": []}, {"radius": True}]
)
def test_settings_of_a_wrong_kind_are_refused_before_any_work(tmp_path, setting):
    file = tmp_path / "settings.json"
    file.write_text(json.dumps([{"region": "6x3"}, setting]))
    with pytest.raises(ValueError, match=f"^{next(iter(setting))}=.* must be a (word|number|whole number)"):
        [accuracy_case(Parameters(method="dem"), one) for one in read_settings(file)]


def test_settings_are_measured_against_particles_everywhere(tmp_path):
    settings = [{"region": "6x3"}, {"region": "8x4", "substeps": 1}, {"substeps": 1000}]
    (tmp_path / "settings.json").write_text(json.dumps(settings))
    answer = studies(
        "accuracy", "foundation", *SMALL, "--settings", tmp_path / "settings.json", "--output", tmp_path / "out"
    )
    assert answer.returncode == 0, answer.stderr
    assert "substeps 1000 is left out" in answer.stderr
    rows = json.loads((tmp_path / "out/accuracy.json").read_text())["rows"]
    assert [row["settings"] for row in rows] == [{}, *settings[:2]]
    assert rows[0]["peak_error"] == 0.0 and rows[0]["speed_up"] == 1.0
    assert all(abs(row["peak_error"]) < 1e-6 for row in rows)  # no wave has reached an interface yet
    assert (tmp_path / "out/accuracy.csv").exists() and (tmp_path / "out/accuracy.png").exists()


def test_a_blow_up_is_named_and_leaves_what_was_written(tmp_path):
    """The paper's variant without damping, with many substeps: grows (Methods: see `bridge.growth`) until a node outruns waves."""
    grows = "--variant paper --damping 0 --radius 0.1 --displacement 0.3 --step-ratio 1 --substeps 5".split()
    answer = studies("foundation", *grows, "--output", tmp_path, "--frames", 4)
    assert answer.returncode == 3
    *warned, error = answer.stderr.splitlines()
    assert all(line.startswith("Warning: variant=paper") for line in warned) and len(warned) == 2
    assert error.startswith("Error: the continuum became unstable by t=") and "node at" in error
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert not summary["stable"] and summary["message"] in error and len(summary["warnings"]) == 2
    assert len(history(tmp_path)["time_s"]) > 10
    assert (tmp_path / "fields/particles.pvd").exists()


def test_energies_that_do_not_close_are_doubted():
    good = {"external_work": 100.0, "interface": 5.0, "balance": 0.5}
    assert not doubts(good)
    assert "energy balance is off by 2.0 %" in doubts(good | {"balance": -2.0})[0]
    assert "interface has put 20.0 %" in doubts(good | {"interface": -20.0})[0]
