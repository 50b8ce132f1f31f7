"""Columns of the rows that hold the rigid bodies and their walls (see `particles.system.Walls`).

Everything is held in three components, in the plane with zeros out of it, so that one code serves discs and spheres.
"""

from __future__ import annotations

import numpy as np

# Numbers of a type of their own: whole numbers as they stand would have each function compiled once for every number.

# A body: a rigid motion shared by one or several walls
CENTRE = np.int64(0)  # 3: reference position of its centre, m
PLACE = np.int64(3)  # 6: displacement of the centre, m, and sum of the rotation increments, rad
FRAME = np.int64(9)  # 9: rotation matrix from the reference to now, by rows
VELOCITY = np.int64(18)  # 6: velocity of the centre and spin, of the middle of the step while it runs
PREDICTED = np.int64(24)  # 6: the same at the end of the step
ACCELERATION = np.int64(30)  # 6: zero where the motion is prescribed
INCREMENT = np.int64(36)  # 6: displacement and rotation of the last step
CAYLEY = np.int64(42)  # 3: that rotation as tan(angle / 2) times its axis
AGENT = np.int64(45)  # 6: what acts on the body beside the contacts: its driver, loads, damping (last evaluation)
LOAD = np.int64(51)  # 6: force and moment of the caller
LIGHTNESS = np.int64(57)  # 3: one over the mass; zero where the motion is prescribed
INERTIA = np.int64(60)  # 9: about the centre, reference axes; zero where the rotation is prescribed
NIMBLENESS = np.int64(69)  # 9: its inverse, or zero
GAIN = np.int64(78)  # 3: of the servo control; zero where there is none
STIFFNESS, DASHPOT, FASTEST = np.int64(81), np.int64(82), np.int64(83)  # of one contact, for the servo control; its largest speed
DAMPING = np.int64(84)  # 1/s
TOUCHING = np.int64(85)  # contacts with overlap, last evaluation
GIVEN = np.int64(86)  # kinetic energy by assigned velocities, J
LISTED = np.int64(87)  # 12: displacement and frame when the list was built
EXTENT = np.int64(99)  # distance of the farthest point of its walls from the centre, m
DRIVEN = np.int64(100)  # 1 where the velocity is a function of time
BODY = np.int64(101)

# A wall: the reaction on it (force, moment about the centre of its body), the work that it did on the particles
ACTION = np.int64(0)  # 6
WORK = np.int64(6)
SOLID = np.int64(7)  # 1: facets have an inside; 0: both sides of them are touched
SMOOTH = np.int64(8)  # cosine of the angle below which neighbouring faces count as one smooth surface
OWNER = np.int64(9)  # its body
WALL = np.int64(10)

# A listed pair of particle and facet, in the room for one particle and one wall
NORMAL = np.int64(0)  # 3: from the particle to the facet, unit
DISTANCE = np.int64(3)  # to the closest point, m; negative behind a face of a solid
EDGE = np.int64(4)  # 3: unit vector of the edge where the closest point lies on one, else zero
PART = np.int64(7)  # what the closest point lies on: FACE, or bits of the corners that make the edge or corner
POINT = np.int64(8)  # 3: closest point in the reference position of the wall, m
LIVE = np.int64(11)  # 1: a contact of its own, 0: counted with a neighbouring facet
FROM = np.int64(12)  # 3: in a periodic cell the particle's image in the reference position of the wall, m
NEAR = np.int64(15)
FACE = np.int64(7)
