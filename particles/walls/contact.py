"""Contact of particles with the facets of walls: closest points, which of them count, forces and reactions.

A contact is a local minimum of the distance from the particle's centre to the wall's surface. So the closest point of a
facet on one of its edges or corners counts only if it is the closest point of every facet that shares that edge or corner
(and then once), and not where a neighbour sees the particle on its face; a concave corner gives one contact for each face.
"""

from __future__ import annotations

import math

from numba import njit

from particles.kinematics import tangent_ratio, turning
from particles.laws.touch import FLAT, Touch, respond, wall_law
from particles.ranks import sum_reactions, sum_together
from particles.system import INLINE, KERNEL, MASS, MERGED, OUTER, RADIUS, SPENT
from particles.vectors import cross, dot, load, minus, moved, plus, present, scaled, store
from particles.walls.motion import balance, book, rotated, rotated_back, row_vector, to_reference, turned_by
from particles.walls.rows import (
    ACTION,
    CAYLEY,
    CENTRE,
    DISTANCE,
    EDGE,
    FACE,
    FROM,
    INCREMENT,
    LIGHTNESS,
    LIVE,
    NORMAL,
    OWNER,
    PART,
    PLACE,
    POINT,
    PREDICTED,
    SMOOTH,
    SOLID,
    TOUCHING,
)  # fmt: skip

SAME_POINT = 1e-6  # closest points nearer to each other than this share of the radius are one


@njit(**INLINE)
def closest(vertices, corners, normals, facet, x):
    """Closest point of a facet to x (Ericson 2005, Real-Time Collision Detection, 5.1.5), reference position of the wall.

    Returns:
        The point, the part of the facet that it lies on (FACE or bits of corners), height of x over the facet's plane (m).
    """
    a, b, c = int(corners[facet, 0]), int(corners[facet, 1]), int(corners[facet, 2])
    first, normal = row_vector(vertices, a, 0), row_vector(normals, facet, 0)
    from_a = minus(x, first)
    height = dot(normal, from_a)
    foot = moved(x, -height, normal)
    if b < 0:  # a plane
        return foot, FACE, height
    second = row_vector(vertices, b, 0)
    ab = minus(second, first)
    a1 = dot(ab, from_a)
    if c < 0:  # a segment
        if a1 <= 0.0:
            return first, 1, height
        return (second, 2, height) if a1 >= dot(ab, ab) else (foot, FACE, height)
    third = row_vector(vertices, c, 0)
    ac, from_b, from_c = minus(third, first), minus(x, second), minus(x, third)
    a2, b1, b2, c1, c2 = dot(ac, from_a), dot(ab, from_b), dot(ac, from_b), dot(ab, from_c), dot(ac, from_c)
    if a1 <= 0.0 and a2 <= 0.0:
        return first, 1, height
    if b1 >= 0.0 and b2 <= b1:
        return second, 2, height
    if c2 >= 0.0 and c1 <= c2:
        return third, 4, height
    if a1 * b2 - b1 * a2 <= 0.0 and a1 >= 0.0 and b1 <= 0.0:
        return moved(first, a1 / (a1 - b1), ab), 3, height
    if c1 * a2 - a1 * c2 <= 0.0 and a2 >= 0.0 and c2 <= 0.0:
        return moved(first, a2 / (a2 - c2), ac), 5, height
    if b1 * c2 - c1 * b2 <= 0.0 and b2 >= b1 and c1 >= c2:
        return moved(second, (b2 - b1) / ((b2 - b1) + (c1 - c2)), minus(third, second)), 6, height
    return foot, FACE, height


@njit(**INLINE)
def image_shift(image, cell, pair):
    """From a particle to its image of a listed pair, m."""
    m, a, b, c = cell.matrix, image[pair, 0], image[pair, 1], image[pair, 2]
    return a * m[0, 0] + b * m[0, 1] + c * m[0, 2], b * m[1, 1] + c * m[1, 2], c * m[2, 2]


@njit(**INLINE)
def _at_image(image, cell, x, pair):
    """A place of the particle, moved to its image of a listed pair."""
    if image is None:
        return x
    return plus(x, image_shift(image, cell, pair))


@njit(**INLINE)
def _reference_of_image(image, cell, body, owner, place, pair):
    """Where that image was in the reference position of a body, for a particle that was at `place`."""
    if image is None:
        return place
    return plus(place, rotated_back(body, owner, image_shift(image, cell, pair)))


@njit(**INLINE)
def _between(image, near, k, m):
    """From the closest point of listed pair k to that of pair m, seen from the particle (reference axes of the wall)."""
    gap = minus(row_vector(near, m, POINT), row_vector(near, k, POINT))
    if image is None:
        return gap
    return minus(gap, minus(row_vector(near, m, FROM), row_vector(near, k, FROM)))


@njit(**INLINE)
def _shared(image, walls, facet, other, near, k, m, radius):
    """Bits of the corners of a facet (pair k) that another one (pair m) has as well.

    Among periodic images facets have what lies on both: a closest point on an edge or corner all its bits, a face one bit
    where a corner of one lies on the other.
    """
    bits = 0
    if image is None:
        for a in range(3):
            for b in range(3):
                if walls.corners[facet, a] == walls.corners[other, b] and walls.corners[facet, a] >= 0:
                    bits |= 1 << a
        return bits
    shift = minus(row_vector(near, m, FROM), row_vector(near, k, FROM))
    if near[k, PART] != FACE:
        return int(near[k, PART]) if _lies_on(walls, other, plus(row_vector(near, k, POINT), shift), radius) else 0
    for a in range(3):
        one, two = int(walls.corners[facet, a]), int(walls.corners[other, a])
        if one >= 0 and _lies_on(walls, other, plus(row_vector(walls.vertices, one, 0), shift), radius):
            bits = 1
        if two >= 0 and _lies_on(walls, facet, minus(row_vector(walls.vertices, two, 0), shift), radius):
            bits = 1
    return bits


@njit(**INLINE)
def _lies_on(walls, facet, x, radius):
    point, _, _ = closest(walls.vertices, walls.corners, walls.normals, facet, x)
    gap = minus(point, x)
    return dot(gap, gap) <= (SAME_POINT * radius) ** 2


@njit(**INLINE)
def _counts(image, walls, near, first, count, k, smooth, radius):
    """Whether listed pair k of a particle and a wall is a contact of its own."""
    part, size = near[k, PART], abs(near[k, DISTANCE])
    for m in range(count):
        if m == k:
            continue
        other = abs(near[m, DISTANCE])
        nearer = other < size or (other == size and m < k)
        if nearer and near[k, DISTANCE] < 0.0:
            return False  # behind a face of a solid only the nearest face pushes
        gap = _between(image, near, k, m)
        if dot(gap, gap) <= (SAME_POINT * radius) ** 2:
            if nearer:
                return False
            continue
        shared = _shared(image, walls, walls.facet[first + k], walls.facet[first + m], near, k, m, radius)
        if part != FACE:
            if shared & int(part) == int(part):
                return False
        elif nearer and shared != 0 and near[m, PART] == FACE:
            if dot(row_vector(near, k, NORMAL), row_vector(near, m, NORMAL)) >= smooth:
                return False
    return True


@njit(**KERNEL)
def look(image, walls, cell, body, owner, x, radius, first, count):
    """Geometry of the pairs first, first + 1, ... of one particle and one wall into the rows of `walls.near`.

    Args:
        image: that of the walls.
        cell: None or the periodic cell.
        owner: row of the wall's body in `body`.
        x: centre of the particle (3,), m.
    """
    near, corners = walls.near, walls.corners
    wall = int(corners[walls.facet[first], 3])
    solid = walls.wall[wall, SOLID] > 0.0
    at = to_reference(body, owner, x)
    for k in range(count):
        facet = int(walls.facet[first + k])
        place = _reference_of_image(image, cell, body, owner, at, first + k)
        if image is not None:
            store(near[k], FROM, 1, place)
        point, part, height = closest(walls.vertices, corners, walls.normals, facet, place)
        side = -1.0 if height < 0.0 and not solid else 1.0
        normal, distance, edge = scaled(-side, row_vector(walls.normals, facet, 0)), side * height, (0.0, 0.0, 0.0)
        if part != FACE:
            way = minus(point, place)
            distance = math.sqrt(dot(way, way))
            if distance > 0.0:
                normal = scaled(1.0 / distance, way)
            else:  # a centre right on an edge or corner is pushed as by the face
                part = FACE
            if part & (part - 1) != 0 and part != FACE:  # two corners: an edge
                a = int(corners[facet, 0 if part & 1 else 1])
                b = int(corners[facet, 2 if part & 4 else 1])
                way = minus(row_vector(walls.vertices, b, 0), row_vector(walls.vertices, a, 0))
                edge = rotated(body, owner, scaled(1.0 / math.sqrt(dot(way, way)), way))
        store(near[k], NORMAL, 1, rotated(body, owner, normal))
        store(near[k], EDGE, 1, edge)
        store(near[k], POINT, 1, point)
        near[k, DISTANCE], near[k, PART] = distance, part
    for k in range(count):
        near[k, LIVE] = 1.0 if _counts(image, walls, near, first, count, k, walls.wall[wall, SMOOTH], radius) else 0.0


@njit(**INLINE)
def _hand_over(image, history, near, first, count):
    """A new contact takes the history of the nearest one that is no contact any more; the last line says which were one."""
    flag = history.shape[0] - 1
    for k in range(count):
        if near[k, LIVE] == 0.0 or history[flag, first + k] != 0.0:
            continue
        best, least = -1, 1e300
        for m in range(count):
            if near[m, LIVE] == 0.0 and history[flag, first + m] != 0.0:
                gap = _between(image, near, k, m)
                if dot(gap, gap) < least:
                    best, least = m, dot(gap, gap)
        for line in range(flag + 1):
            history[line, first + k] = history[line, first + best] if best >= 0 else 0.0
            if best >= 0:
                history[line, first + best] = 0.0


@njit(**INLINE)
def _motion_of(translation, rotation, space, i):
    """Velocity and spin of row i, or their rates, in three components (`space`: None in the plane)."""
    if space is not None:
        return row_vector(translation, i, 0), row_vector(rotation, i, 0)
    return (translation[i, 0], translation[i, 1], 0.0), (0.0, 0.0, translation[i, 2])


@njit(**INLINE)
def _increments(near, k, body, owner, arm, shift, turn):
    """Kinematics of one contact in the step, seen from the wall, in the axes of the step's end.

    The closest point travels along the wall with the particle: on a face in both directions, on an edge along it, at a
    corner not at all; the rest of the motion turns the normal. A rigid motion of both of any size causes no increments.

    Args:
        arm: from the body's centre to the particle's, at the end of the step, m.
        shift, turn: of the particle in the step, m and rad.

    Returns:
        Sliding (3,) and mean lever arm, m; rolling and twisting together (3,), rad; old normal in the axes of the end.
    """
    normal, distance = row_vector(near, k, NORMAL), near[k, DISTANCE]
    relative = minus(shift, row_vector(body, owner, INCREMENT))
    seen = plus(relative, turned_by(row_vector(body, owner, CAYLEY), minus(relative, arm)))
    if near[k, PART] == FACE:
        height = dot(normal, seen)
        travel, before, old_normal = moved(seen, -height, normal), distance + height, normal
    else:
        edge = row_vector(near, k, EDGE)
        travel = scaled(dot(edge, seen), edge)
        old = minus(moved(seen, distance, normal), travel)
        before = math.sqrt(dot(old, old))
        old_normal = scaled(1.0 / before, old)
    mean = 0.5 * (distance + before)
    own = scaled(tangent_ratio(0.25 * dot(turn, turn)), turn)
    roll = moved(own, -2.0, row_vector(body, owner, CAYLEY))
    middle = scaled(0.5, plus(normal, old_normal))
    slide = minus(moved(scaled(mean, minus(normal, old_normal)), -mean, cross(roll, middle)), travel)
    return moved(slide, -dot(slide, normal), normal), mean, roll, old_normal


@njit(**INLINE)
def _rates(normal, distance, body, owner, arm, velocity, spin):
    """Opening and sliding velocity, relative spin at the end of the step."""
    wall_spin = row_vector(body, owner, PREDICTED + 3)
    point = moved(arm, distance, normal)
    rate = minus(plus(row_vector(body, owner, PREDICTED), cross(wall_spin, point)), velocity)
    opening = dot(rate, normal)
    return opening, moved(moved(rate, -opening, normal), -distance, cross(spin, normal)), minus(spin, wall_spin)


@njit(**INLINE)
def _carrying(normal, old_normal, turn, body, owner):
    """How tangential vectors turn in the step, as for a pair."""
    cayley = row_vector(body, owner, CAYLEY)
    before = plus(old_normal, turned_by(scaled(-1.0, cayley), old_normal))
    return turning(moved(scaled(tangent_ratio(0.25 * dot(turn, turn)), turn), 2.0, cayley), 1.0, before, normal)


@njit(**INLINE)
def _answer(space, law, near, k, body, owner, arm, shift, turn, velocity, spin, radius, mass, values, place, stride, blank):
    """The law's answer to one contact (`space`: None for discs): force and couple on the particle (3,), energies spent."""
    normal, distance = row_vector(near, k, NORMAL), near[k, DISTANCE]
    slide, mean, roll, old_normal = _increments(near, k, body, owner, arm, shift, turn)
    opening, slide_rate, roll_rate = _rates(normal, distance, body, owner, arm, velocity, spin)
    overlap = radius - distance if near[k, LIVE] != 0.0 else -radius  # a contact that is none any more opens
    if space is None:
        tangent = (-normal[1], normal[0], 0.0)
        touch = Touch(
            overlap, opening, (dot(slide, tangent),), (dot(slide_rate, tangent),), (roll[2],), (roll_rate[2],), 0.0, 0.0,
            mean, distance, (normal[0], normal[1]), distance, (radius, FLAT), mass, (),
        )  # fmt: skip
        response = respond(law, touch, load(values, place, stride, blank))
        tangential, couple = scaled(response.tangential[0], tangent), (0.0, 0.0, response.couple[0])
    else:
        twist, twist_rate = dot(roll, normal), dot(roll_rate, normal)
        touch = Touch(
            overlap, opening, slide, slide_rate, moved(roll, -twist, normal), moved(roll_rate, -twist_rate, normal),
            twist, twist_rate, mean, distance, normal, distance, (radius, FLAT), mass,
            _carrying(normal, old_normal, turn, body, owner),
        )  # fmt: skip
        response = respond(law, touch, load(values, place, stride, blank))
        tangential, couple = response.tangential, response.couple
    store(values, place, stride, response.history)
    return moved(tangential, -response.normal, normal), couple, response.spent, overlap


@njit(**INLINE)
def _add_to_row(force, torque, i, push, moment):
    if torque is None:
        force[i, 0] += push[0]
        force[i, 1] += push[1]
        force[i, 2] += moment[2]
    else:
        for c in range(3):
            force[i, c] += push[c]
            torque[i, c] += moment[c]


@njit(**INLINE)
def place_of(position, space, i):
    """Centre of row i in three components."""
    return position[i, 0], position[i, 1], 0.0 if space is None else position[i, 2]


@njit(**INLINE)
def _material_of(material, i):
    return 0 if material is None else material[i]


@njit(**MERGED)
def wall_forces(system, terms, step):
    """Add the wall contacts of this rank to the forces and to the reactions on walls; `end_wall_forces` must follow.

    Row velocities are those of the middle of the step, as for pairs; the increments of the bodies are in their rows (zero
    while they are held).
    """
    _wall_forces(system.walls, system.cell, system, terms, step)


@njit(**MERGED)
def end_wall_forces(system, terms, step, halo, values):
    """Sum the reactions over the ranks, and `values` (k, 3) or None with them (collective); set the accelerations of bodies, book works."""
    _end_wall_forces(system.walls, terms, step, halo, values, system.sums)


@njit(**INLINE)
def _end_wall_forces(walls, terms, step, halo, values, sums):
    if walls is None:
        if values is not None:
            sum_together(halo, values)
    else:
        sum_reactions(halo, walls, values)
        balance(walls.body, walls.wall, terms.gravity, step)
        book(walls.body, walls.wall, sums)


@njit(**INLINE)
def _wall_forces(walls, cell, system, terms, step):
    if walls is None:
        return
    body, wall, near, history, sums = walls.body, walls.wall, walls.near, walls.history, system.sums
    space = present(system.spin)
    stride = history.shape[1]
    values = history.reshape(history.size)
    book(body, wall, sums)
    for k in range(wall.shape[0]):
        for c in range(6):
            wall[k, ACTION + c] = 0.0
    for b in range(body.shape[0]):
        body[b, TOUCHING] = 0.0
    for group in range(walls.start.size - 1):
        first = int(walls.start[group])
        count = int(walls.start[group + 1]) - first
        i, which = int(walls.row[first]), int(walls.corners[walls.facet[first], 3])
        owner = int(wall[which, OWNER])
        x, radius = place_of(system.position, space, i), system.position[i, RADIUS]
        look(walls.image, walls, cell, body, owner, x, radius, first, count)
        _hand_over(walls.image, history, near, first, count)
        whole_arm = minus(x, plus(row_vector(body, owner, CENTRE), row_vector(body, owner, PLACE)))
        speed, rotation = _motion_of(system.velocity, system.spin, space, i)
        change, angular = _motion_of(system.acceleration, system.angular, space, i)
        velocity, spin = moved(speed, 0.5 * step, change), moved(rotation, 0.5 * step, angular)
        lightness = 1.0 / system.lightness[i, MASS] + max(
            body[owner, LIGHTNESS], body[owner, LIGHTNESS + 1], body[owner, LIGHTNESS + 2]
        )
        law = wall_law(terms.law, walls.laws[which, _material_of(system.material, i)])
        for k in range(count):
            flag = near[k, LIVE]
            if flag == 0.0 and history[-1, first + k] == 0.0:
                continue
            arm = _at_image(walls.image, cell, whole_arm, first + k)
            push, couple, spent, overlap = _answer(
                space, law, near, k, body, owner, arm, scaled(step, speed), scaled(step, rotation), velocity, spin, radius,
                1.0 / lightness, values, first + k, stride, terms.blank,
            )  # fmt: skip
            history[-1, first + k] = flag
            for entry in range(SPENT):
                sums[entry] += spent[entry]
            lever = scaled(near[k, DISTANCE], row_vector(near, k, NORMAL))
            _add_to_row(system.force, system.torque, i, push, plus(cross(lever, push), couple))
            moment = plus(cross(plus(arm, lever), push), couple)
            for c in range(3):
                wall[which, ACTION + c] -= push[c]
                wall[which, ACTION + 3 + c] -= moment[c]
            body[owner, TOUCHING] += 1.0 if overlap > 0.0 else 0.0


@njit(**OUTER)
def see_all(walls, cell, position, space, normal, distance, live):
    """Normals (listed, 3), distances (listed,) and which of the listed pairs are contacts (listed,), at present places."""
    for group in range(walls.start.size - 1):
        first = int(walls.start[group])
        count = int(walls.start[group + 1]) - first
        i, which = int(walls.row[first]), int(walls.corners[walls.facet[first], 3])
        x = place_of(position, space, i)
        look(walls.image, walls, cell, walls.body, int(walls.wall[which, OWNER]), x, position[i, RADIUS], first, count)
        for k in range(count):
            distance[first + k], live[first + k] = walls.near[k, DISTANCE], walls.near[k, LIVE]
            for c in range(3):
                normal[first + k, c] = walls.near[k, NORMAL + c]
