"""Plain double loop over all pairs for the contact law: the reference of the fast loops (methods 2.2 and 2.3)."""

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
