"""Kinematics of two particles: small functions, and how tangential vectors go with a pair."""

import numpy as np
from scipy.integrate import solve_ivp

from particles.kinematics import tangent_ratio, turning
from particles.laws.touch import carried


def test_accuracy_of_functions_of_small_angles():
    """For turns of up to 1 rad in a step; a particle that turns by more is taken for a runaway."""
    x = np.linspace(1e-9, 0.5, 200)
    np.testing.assert_allclose(tangent_ratio.py_func(x * x), np.tan(x) / x, rtol=2e-14)


def _normal(t):
    """Normal of a pair and its rate, 1/s."""
    along = np.array([np.cos(1.3 * t), np.sin(0.9 * t), 0.4 * np.cos(2.0 * t)])
    rate = np.array([-1.3 * np.sin(1.3 * t), 0.9 * np.cos(0.9 * t), -0.8 * np.sin(2.0 * t)])
    size = np.linalg.norm(along)
    n = along / size
    return n, (rate - (rate @ n) * n) / size


def _spins(t):
    """Spins of both bodies, with which the normal does not go, rad/s."""
    return np.array([[0.7, np.sin(t), -0.6], [np.cos(3.0 * t), -1.1, 0.8]])


def _carried(start, steps):
    """A tangential vector after one second in so many steps."""
    step, vector = 1.0 / steps, tuple(start)
    for k in range(steps):
        turns = step * _spins((k + 0.5) * step)
        sizes = np.linalg.norm(turns, axis=1)
        tangents = (2.0 * np.tan(0.5 * sizes) / sizes) @ turns
        before, after = (tuple(_normal(t)[0]) for t in (k * step, (k + 1) * step))
        vector = carried(turning.py_func(tuple(tangents), 1.0, before, after), vector)
    return np.array(vector)


def test_tangential_vectors_are_carried_to_the_second_order_with_their_length():
    """Against dF/dt = (n x dn/dt + n (n . mean spin)) x F: with the normal, and about it as both bodies do in the mean."""

    def rate(t, vector):
        n, change = _normal(t)
        return np.cross(np.cross(n, change) + (n @ _spins(t).mean(axis=0)) * n, vector)

    start = np.cross(_normal(0.0)[0], [0.3, -0.5, 0.8])
    exact = solve_ivp(rate, (0.0, 1.0), start, method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    found = [_carried(start, steps) for steps in (25, 50, 100)]
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), np.linalg.norm(start), rtol=1e-12)
    errors = np.linalg.norm(found - exact, axis=1)
    assert errors[0] < 1e-2 and np.all(np.log2(errors[:-1] / errors[1:]) > 1.9)
