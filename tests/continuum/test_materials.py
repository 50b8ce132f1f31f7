import numpy as np
import pytest

from continuum import Body, Cauchy, Cosserat
from meshes import domains

GOOD = dict(young_modulus=500e6, poisson_ratio=0.2, cosserat_shear=70e6, characteristic_length=0.05, density=2042.0)


def test_cosserat_moduli_are_those_of_li_and_wan_eq_20():
    material = Cosserat(**GOOD)
    shear = 500e6 / 2.4
    lame = 2 * shear * 0.2 / 0.6
    d = material.stiffness
    assert d[0, 0, 0, 0] == pytest.approx(lame + 2 * shear, rel=1e-14)
    assert d[0, 0, 1, 1] == pytest.approx(lame, rel=1e-14)
    assert d[0, 1, 0, 1] == pytest.approx(shear + 70e6, rel=1e-14)
    assert d[0, 1, 1, 0] == pytest.approx(shear - 70e6, rel=1e-14)
    assert material.couple[0, 0] == pytest.approx(shear * 0.05**2, rel=1e-14)
    assert Cosserat(**GOOD, couple_factor=2.0).couple[1, 1] == pytest.approx(2 * shear * 0.05**2, rel=1e-14)
    assert Cosserat(**GOOD, couple_modulus=3e5).couple[1, 1] == 3e5


def test_cauchy_stiffness_has_the_minor_symmetries_and_so_no_answer_to_rotation():
    d = Cauchy(1e9, 0.3, 2000.0).stiffness
    spin = np.array([[0.0, 1.0], [-1.0, 0.0]])
    assert np.abs(np.einsum("ijkl,kl->ij", d, spin)).max() < 1e-6  # Pa, of 1e9


def test_isotropic_stiffness_is_the_same_in_a_turned_frame():
    d = Cosserat(**GOOD).stiffness
    c, s = np.cos(0.7), np.sin(0.7)
    q = np.array([[c, -s], [s, c]])
    turned = np.einsum("ia,jb,kc,ld,abcd->ijkl", q, q, q, q, d)
    assert np.abs(turned - d).max() < 1e-14 * np.abs(d).max() * 10


def test_moduli_of_a_packing_give_back_the_isotropic_material():
    material = Cosserat(**GOOD)
    measured = Cosserat.from_moduli(material.stiffness, material.couple, density=2042.0)
    assert np.array_equal(measured.stiffness, material.stiffness)
    assert measured.poisson_ratio == pytest.approx(0.2, rel=1e-14)
    assert measured.turns


@pytest.mark.parametrize(
    "change, words",
    [
        (dict(young_modulus=-1.0), "young_modulus=-1.0 must be positive"),
        (dict(young_modulus=np.nan), "young_modulus=nan must be positive"),
        (dict(poisson_ratio=0.5), "poisson_ratio=0.5 must lie in"),
        (dict(poisson_ratio=np.nan), "poisson_ratio=nan must lie in"),
        (dict(cosserat_shear=0.0), "cosserat_shear=0.0 must be positive"),
        (dict(characteristic_length=-0.1), "characteristic_length=-0.1 must be zero or positive"),
        (dict(density=0.0), "density=0.0 must be positive"),
        (dict(couple_modulus=np.inf), "couple_modulus=inf must be"),
    ],
)
def test_bad_constants_are_named(change, words):
    with pytest.raises(ValueError, match=words):
        Cosserat(**{**GOOD, **change})


def test_bad_moduli_are_named():
    good = Cosserat(**GOOD)
    skew = good.stiffness.copy()
    skew[0, 0, 1, 1] *= 2
    with pytest.raises(ValueError, match="stiffness must be symmetric"):
        Cosserat.from_moduli(skew, good.couple, 2000.0)
    with pytest.raises(ValueError, match="negative eigenvalue"):
        Cosserat.from_moduli(-good.stiffness, good.couple, 2000.0)
    with pytest.raises(ValueError, match="shape"):
        Cosserat.from_moduli(np.eye(4), good.couple, 2000.0)


def test_bodies_of_something_else_are_refused_by_name():
    with pytest.raises(ValueError, match="^young_modulus=soft"):
        Cosserat("soft", 0.2, 2000.0, 1e6, 0.05)
    with pytest.raises(ValueError, match="^domain=None"):
        Body(None, None)
    with pytest.raises(ValueError, match="^material=None"):
        Body(domains.rectangle((0, 0), (1, 1), (1, 1)), None)
