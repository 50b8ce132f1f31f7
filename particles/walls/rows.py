"""Columns of the rows that hold the rigid bodies and their walls (see `particles.system.Walls`).

Everything is held in three components, in the plane with zeros out of it, so that one code serves discs and spheres.
"""

from __future__ import annotations

# A body: a rigid motion shared by one or several walls
CENTRE = 0  # 3: reference position of its centre, m
PLACE = 3  # 6: displacement of the centre, m, and sum of the rotation increments, rad
FRAME = 9  # 9: rotation matrix from the reference to now, by rows
VELOCITY = 18  # 6: velocity of the centre and spin, of the middle of the step while it runs
PREDICTED = 24  # 6: the same at the end of the step
ACCELERATION = 30  # 6: zero where the motion is prescribed
INCREMENT = 36  # 6: displacement and rotation of the last step
CAYLEY = 42  # 3: that rotation as tan(angle / 2) times its axis
AGENT = 45  # 6: what acts on the body beside the contacts: its driver, loads, damping (last evaluation)
LOAD = 51  # 6: force and moment of the caller
LIGHTNESS = 57  # 3: one over the mass; zero where the motion is prescribed
INERTIA = 60  # 9: about the centre, reference axes; zero where the rotation is prescribed
NIMBLENESS = 69  # 9: its inverse, or zero
GAIN = 78  # 3: of the servo control; zero where there is none
STIFFNESS, DASHPOT, FASTEST = 81, 82, 83  # of one contact, for the servo control; its largest speed
DAMPING = 84  # 1/s
TOUCHING = 85  # contacts with overlap, last evaluation
GIVEN = 86  # kinetic energy by assigned velocities, J
LISTED = 87  # 12: displacement and frame when the list was built
EXTENT = 99  # distance of the farthest point of its walls from the centre, m
DRIVEN = 100  # 1 where the velocity is a function of time
BODY = 101

# A wall: the reaction on it (force, moment about the centre of its body), the work that it did on the particles
ACTION = 0  # 6
WORK = 6
SOLID = 7  # 1: facets have an inside; 0: both sides of them are touched
SMOOTH = 8  # cosine of the angle below which neighbouring faces count as one smooth surface
OWNER = 9  # its body
WALL = 10

# A listed pair of particle and facet, in the room for one particle and one wall
NORMAL = 0  # 3: from the particle to the facet, unit
DISTANCE = 3  # to the closest point, m; negative behind a face of a solid
EDGE = 4  # 3: unit vector of the edge where the closest point lies on one, else zero
PART = 7  # what the closest point lies on: FACE, or bits of the corners that make the edge or corner
POINT = 8  # 3: closest point in the reference position of the wall, m
LIVE = 11  # 1: a contact of its own, 0: counted with a neighbouring facet
FROM = 12  # 3: in a periodic cell the particle's image in the reference position of the wall, m
NEAR = 15
FACE = 7
