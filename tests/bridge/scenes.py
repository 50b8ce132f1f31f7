"""Small coupled scenes for the tests: a rectangle of Q4 cells, the particles of a part of it."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from bridge import BridgingScale, nested_layout
from continuum import Body, CosseratModuli
from meshes import Box, domains, packings
from particles import Assembly, LiChu, Plate
from particles.measures import moduli

ELASTIC = LiChu(2.5e8, 5.0e7, 1.0e6, 7.0e2, sliding_friction=1e6, rolling_friction=1e6, moment_friction=1e6)
GRANULAR = LiChu(2.5e8, 5.0e7, 1.0e6, 7.0e2, 4e3, 2e3, 1e3, 1.0, 0.5, 0.05, 0.5e-3)


def lattice(kind: str, box: Box, radius: float, anchor):
    return {"square": packings.square, "square_45": packings.square_45, "hexagonal": packings.hexagonal}[kind](
        box, radius, anchor=anchor
    )


def scene(
    kind="square_45",
    *,
    size=(6.0, 6.0),
    radius=0.25 / np.sqrt(2.0),  # two rows of the turned lattice in a metre
    region=((-1.0, 3.0), (7.0, 7.0)),
    anchor=(0.0, 3.0),
    law=ELASTIC,
    cell="quadrilateral",
    fixed=("bottom", "left", "right"),
    plate=None,
    micro_inertia="scaled",
    gravity=(0.0, 0.0),
    velocity=(0.0, 0.0),
    comm=MPI.COMM_WORLD,
    everywhere=False,
    **options,
):
    """A body of `size` (m, 1 m cells) whose part `region` is particles, on rank 0 or everywhere. Returns coupled system and layout."""
    domain = domains.rectangle((0.0, 0.0), size, cells=tuple(int(n) for n in size), cell=cell, comm=comm)
    region = Box(*region)
    sites = lattice(kind, Box((0.0, 0.0), size), radius, anchor)
    layout = nested_layout(sites, radius, region)
    mine = slice(None) if comm.rank == 0 or everywhere else slice(0)
    stiffness, couple = lattice_moduli(kind, radius, law)
    soil = Assembly(sites[layout.kept][mine], radius, 2600.0, law)
    density = 2600.0 * np.pi * radius**2 / cell_area(kind, radius)
    body = Body(domain, CosseratModuli(stiffness, couple, density), micro_inertia, radius, excluded=region)
    for side in fixed:
        body.fix(side, "r")
        body.prescribe(side, "x", velocity[0])
        body.prescribe(side, "y", velocity[1])
    body.gravity(gravity)
    if plate is not None:
        soil.add_wall(Plate.rectangle(*plate[:2], velocity=plate[2]))
    return BridgingScale(body, soil, layout.ghost[mine], layout.share[mine], everywhere=everywhere, **options), layout


def cell_area(kind: str, radius: float) -> float:
    """Area of the lattice for each particle, m2."""
    return 2.0 * np.sqrt(3.0) * radius**2 if kind == "hexagonal" else 4.0 * radius**2


def lattice_moduli(kind: str, radius: float, law: LiChu):
    """Moduli of the infinite lattice, from discs that have all their neighbours."""
    sites = lattice(kind, Box((-10 * radius, -10 * radius), (10 * radius, 10 * radius)), radius, (0.0, 0.0))
    inner = np.flatnonzero(np.all(np.abs(sites) < 6 * radius, axis=1))
    return moduli(Assembly(sites, radius, 2600.0, law), area=len(inner) * cell_area(kind, radius), ids=inner)
