"""Named numbers from the history of a rock test: moduli, strength, how quasi-static it was, where it broke."""

from __future__ import annotations

import math

import numpy as np

from bridge.run import Outcome
from studies.cracks import cracks
from studies.lab_model import elastic_constants
from studies.rock import Compression
from studies.rock_model import Specimen

ELASTIC = (0.1, 0.5)  # part of the peak load over which moduli are fitted
SPLIT = 0.1  # half-width of the band about the loaded diameter, in diameters

Results = dict[str, tuple[float, str]]


def results(model: Specimen, outcome: Outcome) -> Results:
    """Named numbers with their units."""
    p = model.parameters
    stress = outcome.column("plate_stress_Pa")
    peak = int(np.argmax(stress))
    elastic = _elastic(stress, peak)
    load = 0.5 * (outcome.column("top_force_N") + outcome.column("bottom_force_N"))
    apart = np.abs(outcome.column("top_force_N") - outcome.column("bottom_force_N"))
    count = outcome.column("cracks")
    half = int(np.argmax(stress >= 0.5 * stress[peak]))
    cracked = np.flatnonzero(count)
    found: Results = {
        "peak_force": (load[peak], "N"), "peak_strain": (outcome.column("strain")[peak], "1"),
        "first_crack_stress": (stress[cracked[0]] if cracked.size else math.nan, "Pa"),
        "cracks_at_peak": (count[peak], "1"), "cracks": (count[-1], "1"),
    }  # fmt: skip
    of_test = compression if isinstance(p, Compression) else brazilian
    return of_test(model, outcome, elastic, peak) | found | {
        "porosity": (model.porosity, "1"), "bonds_per_disc": (2.0 * len(model.bonds) / model.soil.count, "1"),
        "mean_square_radius_root": (model.radius, "m"),
        "plate_force_difference": (apart[elastic].mean() / load[peak] if elastic.size else math.nan, "1"),
        "kinetic_share": (outcome.column("kinetic_J")[half] / outcome.column("elastic_J")[half], "1"),
    }  # fmt: skip


def _elastic(stress: np.ndarray, peak: int) -> np.ndarray:
    """Rows (indices) before the peak over which the specimen counts as elastic."""
    rising = stress[: peak + 1]
    return np.flatnonzero((rising >= ELASTIC[0] * stress[peak]) & (rising <= ELASTIC[1] * stress[peak]))


def slope(x: np.ndarray, y: np.ndarray) -> float:
    """Of the straight line through points by least squares; NaN from fewer than three."""
    return float(np.polyfit(x, y, 1)[0]) if len(x) > 2 else math.nan


def compression(model: Specimen, outcome: Outcome, elastic: np.ndarray, peak: int) -> Results:
    """Moduli, strength and cracks of unconfined compression.

    Moduli are those of the plane; "plane_strain" are those of a solid that has them in plane strain, "affine" those of discs
    that follow a homogeneous strain without rotation of their own, a bound. "axial_cracks" is the mean square of the cracks'
    normals across the load: 1/2 where they have no direction, 1 where all are parallel to the load.
    """
    stress, averaged = outcome.column("plate_stress_Pa"), outcome.column("averaged_stress_axial_Pa")
    axial, lateral = outcome.column("inner_strain_axial")[elastic], outcome.column("inner_strain_lateral")[elastic]
    broken = cracks(model.soil)
    across = broken.normals[:, 0] ** 2
    early = across[broken.time <= outcome.column("time_s")[peak]]
    young, poisson = slope(axial, stress[elastic]), -slope(axial, lateral)
    d = model.affine
    bound = elastic_constants(0.5 * (d[0, 0, 0, 0] + d[1, 1, 1, 1]), 0.5 * (d[0, 0, 1, 1] + d[1, 1, 0, 0]), 2)
    in_solid = poisson / (1.0 + poisson)
    return {
        "young_modulus": (young, "Pa"), "poisson_ratio": (poisson, "1"),
        "young_modulus_plane_strain": (young * (1.0 - in_solid**2), "Pa"), "poisson_ratio_plane_strain": (in_solid, "1"),
        "young_modulus_affine": (bound[0], "Pa"), "poisson_ratio_affine": (bound[1], "1"),
        "compressive_strength": (stress[peak], "Pa"),
        "young_modulus_averaged": (slope(axial, averaged[elastic]), "Pa"),
        "young_modulus_plates": (slope(outcome.column("strain")[elastic], stress[elastic]), "Pa"),
        "averaged_over_plate_stress": (slope(stress[elastic], averaged[elastic]), "1"),
        "axial_cracks_at_peak": (float(early.mean()) if len(early) else math.nan, "1"),
        "axial_cracks": (float(across.mean()) if len(across) else math.nan, "1"),
    }  # fmt: skip


def brazilian(model: Specimen, outcome: Outcome, elastic: np.ndarray, peak: int) -> Results:
    """Tensile strength; stresses in the middle against those of an elastic disc; share of the cracks along the load."""
    p = model.parameters
    stress = outcome.column("plate_stress_Pa")
    axial, lateral = outcome.column("averaged_stress_axial_Pa")[elastic], outcome.column("averaged_stress_lateral_Pa")[elastic]
    expected = elastic_disc(p.inner)
    broken = cracks(model.soil)
    places, energies = broken.places, broken.energies
    near = np.abs(places[:, 0]) < SPLIT * p.size[0]
    return {
        "tensile_strength": (stress[peak], "Pa"),
        "lateral_over_elastic_disc": (-slope(stress[elastic], lateral) / expected[0], "1"),
        "axial_over_elastic_disc": (-slope(stress[elastic], axial) / expected[1], "1"),
        "cracks_near_diameter": (float(near.mean()) if len(near) else math.nan, "1"),
        "crack_energy": (float(energies.sum()), "J"),
    }


def elastic_disc(share: float) -> tuple[float, float]:
    """Mean lateral and axial stress in the middle square of an elastic disc, over 2 P / (pi D), tension positive.

    Two line loads on opposite ends of a diameter: sums of two radial fields and a uniform tension (Timoshenko & Goodier
    1970, section 41).

    Args:
        share: side of the square over the diameter.
    """
    ticks = 0.5 * share * (np.arange(200) + 0.5) / 200.0  # one quarter is enough
    x, y = np.meshgrid(ticks, ticks)
    lateral, axial = np.ones_like(x), np.ones_like(x)
    for side in (1.0, -1.0):
        below = 0.5 - side * y
        square = x**2 + below**2
        lateral -= x**2 * below / square**2
        axial -= below**3 / square**2
    return float(lateral.mean()), float(axial.mean())


def spread(values: list[float] | np.ndarray) -> tuple[float, float]:
    """Mean and standard deviation of a sample; the latter NaN of a single value."""
    array = np.array(values)
    return float(array.mean()), float(array.std(ddof=1)) if array.size > 1 else math.nan
