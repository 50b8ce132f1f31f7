"""Plain double loops over all pairs for the contact law: the reference of the fast loops (Assembly; Li-Chu law)."""

import numpy as np


def advance(positions, radii, masses, velocities, law, step, steps):
    """Central differences with a dictionary of histories; positions, rotations and velocities after `steps`."""
    x, angle = positions.copy(), np.zeros(len(radii))
    v, spin = velocities[:, :2].copy(), velocities[:, 2].copy()
    inertias = 0.5 * masses * radii**2
    history = {}

    def forces(old, v_end, spin_end, turned):
        total = np.zeros((len(radii), 3))
        for i in range(len(radii)):
            for j in range(i + 1, len(radii)):
                b = x[j] - x[i]
                d = np.hypot(*b)
                overlap = radii[i] + radii[j] - d
                if overlap <= 0:
                    history.pop((i, j), None)
                    continue
                n, t = b / d, np.array([-b[1], b[0]]) / d
                b0 = old[j] - old[i]
                d0 = np.hypot(*b0)
                arms = np.array([radii[i] - overlap / 2, radii[j] - overlap / 2])
                arms0 = np.array([radii[i], radii[j]]) - (radii[i] + radii[j] - d0) / 2
                mean = (arms + arms0) / 2
                beta = np.arctan2(b0[0] * b[1] - b0[1] * b[0], b0 @ b)
                du = mean[0] * (beta - turned[i]) + mean[1] * (beta - turned[j])
                dphi = turned[i] - turned[j]
                rate = v_end[j] - v_end[i]
                radius, mean_radius = arms.prod() / arms.sum(), mean.prod() / mean.sum()
                normal = max(0.0, law.normal_stiffness * overlap - law.normal_damping * rate @ n)
                slide = rate @ t - arms[0] * spin_end[i] - arms[1] * spin_end[j]
                roll = spin_end[i] - spin_end[j]
                channels = [
                    (law.sliding_stiffness, law.sliding_friction, law.sliding_damping, du, slide),
                    (law.rolling_stiffness, law.rolling_friction, law.rolling_damping, mean_radius * dphi, radius * roll),
                    (law.moment_stiffness, law.moment_friction, law.moment_damping, dphi, roll),
                ]
                kept, acting = [], []
                for (k, mu, c, increment, speed), stored in zip(channels, history.get((i, j), np.zeros(3))):
                    limit, trial = mu * normal, stored + k * increment
                    value = np.clip(trial, -limit, limit)
                    kept.append(value)
                    acting.append(value if value != trial else np.clip(value + c * speed, -limit, limit))
                history[i, j] = np.array(kept)
                force = -normal * n + acting[0] * t
                couple = radius * acting[1] + acting[2]
                total[i] += [*force, arms[0] * acting[0] - couple]
                total[j] += [*-force, arms[1] * acting[0] + couple]
        return total / np.column_stack([masses, masses, inertias])

    a = forces(x.copy(), v, spin, np.zeros(len(radii)))
    for _ in range(steps):
        old, turned = x.copy(), step * spin + 0.5 * step**2 * a[:, 2]
        x += step * v + 0.5 * step**2 * a[:, :2]
        angle += turned
        new = forces(old, v + step * a[:, :2], spin + step * a[:, 2], turned)
        v += 0.5 * step * (a + new)[:, :2]
        spin += 0.5 * step * (a + new)[:, 2]
        a = new
    return x, angle, np.column_stack([v, spin])


def _rotation(vector):
    """Rotation matrix of a rotation vector (Rodrigues)."""
    angle = np.linalg.norm(vector)
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector / angle
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * k @ k


def _carry(vector, n0, n, turn_i, turn_j):
    """Turn a tangential vector about the old normal as both bodies do in the mean, then by the smallest rotation to the new one."""
    mean = 0.5 * (_tangent(turn_i) + _tangent(turn_j)) @ (0.5 * (n0 + n))
    swing = np.cross(n0, n)
    size = np.linalg.norm(swing)
    smallest = np.arctan2(size, n0 @ n) / size * swing if size > 0.0 else swing
    return _rotation(smallest) @ _rotation(2.0 * np.arctan(0.5 * mean) * n0) @ vector


def _tangent(turn):
    """2 tan(|turn| / 2) / |turn| turn."""
    angle = np.linalg.norm(turn)
    return turn if angle == 0.0 else 2.0 * np.tan(angle / 2.0) / angle * turn


def _limited(trial, damping, rate, limit):
    """Elastic and total value of a channel: back to the limit, or as much of the dashpot as the limit allows."""
    size = np.linalg.norm(trial)
    if size > limit:
        return limit / size * trial, limit / size * trial
    part = damping * rate
    if np.linalg.norm(trial + part) <= limit:
        return trial, trial + part
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if np.linalg.norm(trial + middle * part) <= limit else (low, middle)
    return trial, trial + low * part


def advance_spheres(positions, radii, masses, velocities, law, step, steps):
    """The same for spheres (with torsion): positions and velocities (n, 6) after `steps`."""
    x, v, spin = positions.copy(), velocities[:, :3].copy(), velocities[:, 3:].copy()
    inertias = 0.4 * masses * radii**2
    history = {}

    def accelerations(old, v_end, spin_end, turns):
        force, torque = np.zeros_like(x), np.zeros_like(x)
        for i in range(len(radii)):
            for j in range(i + 1, len(radii)):
                d, d0 = np.linalg.norm(x[j] - x[i]), np.linalg.norm(old[j] - old[i])
                if d >= radii[i] + radii[j]:
                    history.pop((i, j), None)
                    continue
                n, n0 = (x[j] - x[i]) / d, (old[j] - old[i]) / d0
                difference = radii[i] - radii[j]
                arms, arms0 = np.array([d + difference, d - difference]) / 2, np.array([d0 + difference, d0 - difference]) / 2
                mean = (arms + arms0) / 2
                radius, mean_radius = arms.prod() / d, mean.prod() / mean.sum()
                tau_i, tau_j = _tangent(turns[i]), _tangent(turns[j])
                slide = mean.sum() * (n - n0) - np.cross(mean[0] * tau_i + mean[1] * tau_j, (n + n0) / 2)
                slide -= (slide @ n) * n
                twist, roll = (tau_i - tau_j) @ n, (tau_i - tau_j) - ((tau_i - tau_j) @ n) * n
                rate = v_end[j] - v_end[i]
                slide_rate = rate - (rate @ n) * n - np.cross(arms[0] * spin_end[i] + arms[1] * spin_end[j], n)
                relative = spin_end[i] - spin_end[j]
                twist_rate, roll_rate = relative @ n, relative - (relative @ n) * n
                normal = max(0.0, law.normal_stiffness * (radii[i] + radii[j] - d) - law.normal_damping * rate @ n)
                driven = {
                    "sliding": (slide, slide_rate), "rolling": (mean_radius * roll, radius * roll_rate),
                    "moment": (roll, roll_rate), "torsion": (np.array([twist]), np.array([twist_rate])),
                }  # fmt: skip
                kept, acting = {}, {}
                for name, (increment, speed) in driven.items():
                    k, c, mu = (getattr(law, f"{name}_{kind}") for kind in ("stiffness", "damping", "friction"))
                    stored = history.get((i, j), {}).get(name, np.zeros(increment.size))
                    stored = stored if name == "torsion" else _carry(stored, n0, n, turns[i], turns[j])
                    kept[name], acting[name] = _limited(stored + k * increment, c, speed, mu * normal)
                history[i, j] = kept
                on_i = -normal * n + acting["sliding"]
                couple = -radius * acting["rolling"] - acting["moment"] - acting["torsion"][0] * n
                force[i] += on_i
                force[j] -= on_i
                torque[i] += arms[0] * np.cross(n, acting["sliding"]) + couple
                torque[j] += arms[1] * np.cross(n, acting["sliding"]) - couple
        return force / masses[:, None], torque / inertias[:, None]

    a, b = accelerations(x.copy(), v, spin, np.zeros_like(x))
    for _ in range(steps):
        old, turns = x.copy(), step * spin + 0.5 * step**2 * b
        x += step * v + 0.5 * step**2 * a
        new_a, new_b = accelerations(old, v + step * a, spin + step * b, turns)
        v += 0.5 * step * (a + new_a)
        spin += 0.5 * step * (b + new_b)
        a, b = new_a, new_b
    return x, np.hstack([v, spin])
