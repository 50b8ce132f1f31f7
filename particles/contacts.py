"""The loop over neighbouring pairs (the inner loop of the code), in batches that become vector instructions.

A batch of pairs goes through five stages: rows of the particles to columns, histories to columns, the law (one loop over
the batch with nothing but arithmetic), histories back, forces added to the rows. All listed pairs take part, those with a
gap as well: a law gives them zeros.
"""

from __future__ import annotations

from numba import njit

from particles.cell import image_in_plane, image_in_space
from particles.columns import BLOCK, STRIDE, WIDTH, gather, load_column, places_of, scatter, store_column
from particles.kinematics import PLANE, SPACE, frame_in_plane, frame_in_space, touch_in_plane, touch_in_space
from particles.laws.touch import NOTHING, law_at, respond
from particles.system import BREAKING, CELL_POWER, INLINE, INNER, KERNEL, MASS, MERGED, SPENT, TIME
from particles.vectors import cross, dot, load, moved, plus, present, scaled, store

# Places in the scratch array: differences of the rows of a pair (j minus i), each followed by what is needed of i alone
_PLACE, _RADIUS = 0, 4 * STRIDE
_MOTION = 5 * STRIDE
_TURN, _REDUCED = 9 * STRIDE, 10 * STRIDE
_CHANGE, _ANGULAR_OWN = 11 * STRIDE, 15 * STRIDE  # accelerations, where there are dashpots
_SPIN_MORE, _SPIN = 16 * STRIDE, 20 * STRIDE  # in space
_ANGULAR_MORE, _ANGULAR = 23 * STRIDE, 27 * STRIDE
_FRAME, _DRIFT = 30 * STRIDE, 44 * STRIDE  # `SPACE` or `PLANE` of the kinematics; velocity of the image of j
# In place of the frame: force on i, torque on i and on j (in the plane: force and torque, and minus those on j)
_FORCE, _TORQUE, _OTHER = _FRAME, _FRAME + 3 * STRIDE, _FRAME + 6 * STRIDE
_IMAGE = 47 * STRIDE  # power of the moving cell
_SPENT = 48 * STRIDE
_HISTORY = _SPENT + SPENT * STRIDE
HISTORIES, NUMBERS = 24, 40  # most columns of history, most numbers in a law
_NUMBERS = _HISTORY + HISTORIES * STRIDE
_SHARE = _NUMBERS + NUMBERS * STRIDE
SCRATCH = _SHARE + STRIDE


@njit(**KERNEL)
def _gather_pairs(scratch, position, velocity, acceleration, spin, angular, viscous, first, second, at, count):
    """Rows of a batch to columns; the last block may reach beyond the pairs, into the room that is left for it."""
    for c in range(0, count, BLOCK):
        i, j = places_of(first, at + c), places_of(second, at + c)
        if spin is None:
            gather(scratch, _PLACE + c, position, i, j, 0b1011, 0b1000)
            gather(scratch, _MOTION + c, velocity, i, j, 0b0111, 0b0100)
            if viscous is not None:
                gather(scratch, _CHANGE + c, acceleration, i, j, 0b0111, 0b0100)
        else:
            gather(scratch, _PLACE + c, position, i, j, 0b1111, 0b1000)
            gather(scratch, _MOTION + c, velocity, i, j, 0b0111, 0)
            gather(scratch, _SPIN_MORE + c, spin, i, j, 0b0111, 0b0111)
            if viscous is not None:
                gather(scratch, _CHANGE + c, acceleration, i, j, 0b0111, 0)
                gather(scratch, _ANGULAR_MORE + c, angular, i, j, 0b0111, 0b0111)


@njit(**INNER)
def _whole_mass(lightness, share, i):
    """Mass of a particle, whatever share of it the particle carries."""
    return lightness[i, MASS] if share is None else lightness[i, MASS] / share[i, 1]


@njit(**KERNEL)
def _gather_masses(scratch, massive, lightness, share, first, second, at, count):
    """Reduced mass of each pair, where the law asks for it."""
    if massive is None:
        return
    for c in range(count):
        one, other = _whole_mass(lightness, share, first[at + c]), _whole_mass(lightness, share, second[at + c])
        scratch[_REDUCED + c] = one * other / (one + other)


@njit(**KERNEL)
def _gather_shares(scratch, share, position, first, second, at, count):
    """Share of each contact: that of the particles, linear from centre to centre, at the contact point, and at most 1."""
    if share is None:
        return
    for c in range(count):
        i, j = first[at + c], second[at + c]
        a, b = position[i, 3], position[j, 3]
        scratch[_SHARE + c] = min(1.0, (share[i, 0] * b + share[j, 0] * a) / (a + b))


@njit(**INLINE)
def _share_of(shared, scratch, q):
    if shared is None:
        return 1.0
    return scratch[_SHARE + q]


@njit(**KERNEL)
def _gather_numbers(scratch, table, material, first, second, at, count):
    """Constants of the law of each pair, where there are several laws."""
    if table is None:
        return
    for c in range(count):
        numbers = table[material[first[at + c]], material[second[at + c]]]
        for k in range(numbers.size):
            scratch[_NUMBERS + k * STRIDE + c] = numbers[k]


@njit(**INLINE)
def _triple(scratch, place):
    return scratch[place], scratch[place + STRIDE], scratch[place + 2 * STRIDE]


@njit(**INLINE)
def _rates_in_plane(scratch, q, viscous, half):
    """Velocities at the end of the step, `half` of it (s) later than those of the rows: of j against i, spins of both."""
    if viscous is None:
        return 0.0, 0.0, 0.0, 0.0
    x, y, more = moved(_triple(scratch, _MOTION + q), half, _triple(scratch, _CHANGE + q))
    spin = scratch[_TURN + q] + half * scratch[_ANGULAR_OWN + q]
    return x, y, spin, spin + more


@njit(**INLINE)
def _rates_in_space(scratch, q, viscous, half):
    """The same; of j by how much its spin is more."""
    if viscous is None:
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    return (
        moved(_triple(scratch, _MOTION + q), half, _triple(scratch, _CHANGE + q)),
        moved(_triple(scratch, _SPIN + q), half, _triple(scratch, _ANGULAR + q)),
        moved(_triple(scratch, _SPIN_MORE + q), half, _triple(scratch, _ANGULAR_MORE + q)),
    )


@njit(**INLINE)
def _book_image(image, scratch, q, power):
    if image is not None:
        scratch[_IMAGE + q] += power


@njit(**INLINE)
def _drift_of(image, scratch, q):
    """Velocity of the image of j against j itself."""
    if image is None:
        return 0.0, 0.0, 0.0
    return _triple(scratch, _DRIFT + q)


@njit(**INLINE)
def _frame_in_plane(scratch, q, step, image):
    """Direction of one pair of discs and how it turned."""
    bx, by, _ = _triple(scratch, _PLACE + q)
    bx, by, wx, wy = image_in_plane(image, bx, by)
    if image is not None:
        store(scratch, _DRIFT + q, STRIDE, (wx, wy))
    dx, dy, _ = _triple(scratch, _MOTION + q)
    store(scratch, _FRAME + q, STRIDE, frame_in_plane(bx, by, step * (dx + wx), step * (dy + wy)))


@njit(**INLINE)
def _frame_in_space(scratch, q, step, image):
    """The same for a pair of spheres."""
    branch, drift = image_in_space(image, _triple(scratch, _PLACE + q))
    if image is not None:
        store(scratch, _DRIFT + q, STRIDE, drift)
    travel = scaled(step, plus(_triple(scratch, _MOTION + q), drift))
    frame = frame_in_space(branch, travel, _triple(scratch, _SPIN + q), _triple(scratch, _SPIN_MORE + q), step)
    store(scratch, _FRAME + q, STRIDE, frame)


@njit(**INLINE)
def _in_plane(scratch, q, step, viscous, law, blank, image, shared):
    """One pair of discs: its touch, the law's response, forces and torques to their columns."""
    more = scratch[_MOTION + 2 * STRIDE + q]
    wx, wy, _ = _drift_of(image, scratch, q)
    rx, ry, rate_i, rate_j = _rates_in_plane(scratch, q, viscous, 0.5 * step)
    radius, turn = scratch[_RADIUS + q], scratch[_TURN + q]
    touch = touch_in_plane(
        load(scratch, _FRAME + q, STRIDE, PLANE), step * turn, step * (turn + more), (rx + wx, ry + wy, rate_i, rate_j),
        radius, radius + scratch[_PLACE + 3 * STRIDE + q], scratch[_REDUCED + q],
    )  # fmt: skip
    response = respond(law, touch, load(scratch, _HISTORY + q, STRIDE, blank))
    part = _share_of(shared, scratch, q)
    (nx, ny), shear, couple = touch.normal, part * response.tangential[0], part * response.couple[0]
    normal = part * response.normal
    px = -normal * nx - shear * ny
    py = -normal * ny + shear * nx
    arm = 0.5 * (touch.distance + touch.radii[0] - touch.radii[1])
    store(scratch, _FORCE + q, STRIDE, (px, py, couple + arm * shear))
    store(scratch, _OTHER + q, STRIDE, (px, py, couple - (touch.distance - arm) * shear))
    _book_image(image, scratch, q, px * wx + py * wy)
    store(scratch, _SPENT + q, STRIDE, moved(load(scratch, _SPENT + q, STRIDE, NOTHING), part, response.spent))
    store(scratch, _HISTORY + q, STRIDE, response.history)


@njit(**INLINE)
def _in_space(scratch, q, step, viscous, law, blank, image, shared):
    """The same for a pair of spheres."""
    radius = scratch[_RADIUS + q]
    drift = _drift_of(image, scratch, q)
    rate, spin, faster = _rates_in_space(scratch, q, viscous, 0.5 * step)
    touch = touch_in_space(
        load(scratch, _FRAME + q, STRIDE, SPACE), _triple(scratch, _SPIN + q), _triple(scratch, _SPIN_MORE + q), plus(rate, drift),
        spin, faster, radius, radius + scratch[_PLACE + 3 * STRIDE + q], scratch[_REDUCED + q],
    )  # fmt: skip
    response = respond(law, touch, load(scratch, _HISTORY + q, STRIDE, blank))
    part = _share_of(shared, scratch, q)
    arm = 0.5 * (touch.distance + touch.radii[0] - touch.radii[1])
    tangential, couple = scaled(part, response.tangential), scaled(part, response.couple)
    moment = cross(touch.normal, tangential)
    force = moved(tangential, -part * response.normal, touch.normal)
    store(scratch, _FORCE + q, STRIDE, force)
    _book_image(image, scratch, q, dot(force, drift))
    store(scratch, _TORQUE + q, STRIDE, moved(couple, arm, moment))
    store(scratch, _OTHER + q, STRIDE, moved(scaled(-1.0, couple), touch.distance - arm, moment))
    store(scratch, _SPENT + q, STRIDE, moved(load(scratch, _SPENT + q, STRIDE, NOTHING), part, response.spent))
    store(scratch, _HISTORY + q, STRIDE, response.history)


@njit(**KERNEL)
def _frame_all(scratch, count, step, space, image):
    """Directions of all pairs of a batch (`space`: None or anything).

    A loop of its own: in one loop with the law a processor would wait for square roots and quotients that follow from each
    other, since less than the next pair's work fits into what it looks ahead.
    """
    for q in range(count):
        if space is None:
            _frame_in_plane(scratch, q, step, image)
        else:
            _frame_in_space(scratch, q, step, image)


@njit(**KERNEL)
def _respond_all(scratch, count, step, space, viscous, law, table, blank, image, shared):
    """The law for all pairs of a batch (`space`, `viscous`, `shared`: None or anything)."""
    for q in range(count):
        here = law_at(law, table, scratch, _NUMBERS + q)
        if space is None:
            _in_plane(scratch, q, step, viscous, here, blank, image, shared)
        else:
            _in_space(scratch, q, step, viscous, here, blank, image, shared)


@njit(**KERNEL)
def _scatter_pairs(scratch, force, torque, first, second, at, count):
    """Add forces and torques to the rows; the last pairs one by one."""
    whole = count - count % BLOCK
    for c in range(0, whole, BLOCK):
        ours, theirs = places_of(first, at + c), places_of(second, at + c)
        if torque is None:
            scatter(scratch, _FORCE + c, force, ours, None)
            scatter(scratch, _OTHER + c, force, None, theirs)
        else:
            scatter(scratch, _FORCE + c, force, ours, theirs)
            scatter(scratch, _TORQUE + c, torque, ours, None)
            scatter(scratch, _OTHER + c, torque, theirs, None)
    for c in range(whole, count):
        i, j = first[at + c], second[at + c]
        for k in range(3):
            place = k * STRIDE + c
            force[i, k] += scratch[_FORCE + place]
            if torque is None:
                force[j, k] -= scratch[_OTHER + place]
            else:
                force[j, k] -= scratch[_FORCE + place]
                torque[i, k] += scratch[_TORQUE + place]
                torque[j, k] += scratch[_OTHER + place]


@njit(**INNER)
def _log_breaks(breaks, scratch, history, sums, position, time, space, first, second, at, count):
    """Write down the bonds of a batch that broke in this step (first column of the history: 1 while a bond holds)."""
    if breaks is None:
        return
    broken = 0.0
    for c in range(count):
        broken += history[0, at + c] - scratch[_HISTORY + c]
    if broken < 0.5:
        return
    for c in range(count):
        if history[0, at + c] - scratch[_HISTORY + c] > 0.5:
            if breaks.count[0] < breaks.log.shape[0]:
                i, j = first[at + c], second[at + c]
                line = breaks.log[breaks.count[0]]
                line[0], line[1], line[2] = time, i, j
                share = position[i, 3] / (position[i, 3] + position[j, 3])
                for k in range(2 if space is None else 3):
                    line[3 + k] = position[i, k] + share * (position[j, k] - position[i, k])
                line[6] = scratch[_SPENT + BREAKING * STRIDE + c]
            breaks.count[0] += 1
    for c in range(WIDTH):
        sums[BREAKING] += scratch[_SPENT + BREAKING * STRIDE + c]
        scratch[_SPENT + BREAKING * STRIDE + c] = 0.0


@njit(**INNER)
def start_pairs(scratch):
    """Before the first batch of an evaluation."""
    for place in range(_IMAGE, _HISTORY):
        scratch[place] = 0.0


@njit(**MERGED)
def pair_batch(system, terms, step, image, at, count):
    """Add the contact forces of `count` pairs from `at` on to the rows' forces; histories follow, energies go to scratch.

    Increments come from the displacement of the step, h v of the half step, so that a rigid motion of any size causes
    none; dashpots use the predictor v + h a / 2. Contact is overlap > 0: the force is continuous there, so that pairs
    which just touch carry nothing, whatever the rounding.
    """
    scratch, history, first, second = system.scratch, system.history, system.first, system.second
    _gather_pairs(
        scratch, system.position, system.velocity, system.acceleration, system.spin, system.angular, terms.viscous, first,
        second, at, count,
    )  # fmt: skip
    _gather_masses(scratch, terms.massive, system.lightness, system.share, first, second, at, count)
    _gather_shares(scratch, system.share, system.position, first, second, at, count)
    _gather_numbers(scratch, terms.table, system.material, first, second, at, count)
    for k in range(history.shape[0]):
        load_column(scratch, _HISTORY + k * STRIDE, history, k, at)
    _frame_all(scratch, count, step, present(system.spin), image)
    _respond_all(
        scratch, count, step, present(system.spin), terms.viscous, terms.law, terms.table, terms.blank, image,
        present(system.share),
    )  # fmt: skip
    _log_breaks(
        system.breaks, scratch, history, system.sums, system.position, system.clock[TIME], present(system.spin), first,
        second, at, count,
    )  # fmt: skip
    for k in range(history.shape[0]):
        store_column(scratch, _HISTORY + k * STRIDE, history, k, at)
    _scatter_pairs(scratch, system.force, system.torque, first, second, at, count)


@njit(**KERNEL)
def end_pairs(scratch, sums):
    """After the last batch: book the energies."""
    for c in range(WIDTH):
        for k in range(SPENT):
            sums[k] += scratch[_SPENT + k * STRIDE + c]
        sums[CELL_POWER] += scratch[_IMAGE + c]
