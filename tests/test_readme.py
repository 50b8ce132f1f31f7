"""The scripts of the README and of the guides run as printed."""

import re
from pathlib import Path

ROOT = Path(__file__).parent.parent


def scripts(page):
    """Python blocks of a page."""
    return re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL)


def test_the_driver_script_presses_the_plate_in(capsys):
    (script,) = scripts("README.md")
    exec(compile(script.replace("0.06:", "0.02:"), "README.md", "exec"), {})
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    loads = [float(words[2]) for words in lines]
    assert len(loads) == 5 and float(lines[-1][0]) == 20.0
    assert all(after > before > 1000.0 for before, after in zip(loads, loads[1:]))  # it hardens until about 38 mm
    errors = [abs(float(words[6])) for words in lines]
    assert max(errors) < 0.01 * 1e3 * loads[-1] * 0.02  # J, against load times displacement


def test_the_scripts_on_particles_run_one_after_the_other(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scope = {"__name__": "guide"}
    for script in scripts("docs/particles.md"):
        exec(compile(script, "docs/particles.md", "exec"), scope)
    *impact, balance, walls, _, last, shear, settled = capsys.readouterr().out.splitlines()
    assert len(impact) == 2  # spins of two spheres, friction and energy balance
    assert abs(float(balance)) < 1e-3 * 0.5e6 * (0.5e-3) ** 2  # of what the overlap stored
    assert abs(float(walls.split()[0]) / 1e5 - 1.0) < 0.01  # the servo's load, 100 kPa on 1 m
    assert float(last.split()[-1]) > 0.0  # shear takes work
    pressed, dragged, across = map(float, shear.split())
    assert abs(pressed / (1e5 * 16 * 0.0498) - 1.0) < 0.05 and dragged < 0.0 < across  # held back by the layer
    _, ratio, stress = map(float, settled.split())
    # six spheres above it: 6 m g from above and 7 m g from below at arms of r: 13 m g r / V = 13 rho g r
    assert ratio <= 1e-3 and abs(stress / (-13.0 * 2600.0 * 9.81 * 0.05) - 1.0) < 0.02
    assert (tmp_path / "chains.vtu").exists()


def test_the_scripts_on_the_overlap_keep_their_energy(capsys):
    plane, space = scripts("docs/overlap.md")
    for script in (plane, space):
        exec(compile(script, "docs/overlap.md", "exec"), {"__name__": "guide"})
    (balance, step), (balance_in_space, step_in_space) = (map(float, line.split()) for line in capsys.readouterr().out.splitlines())
    # stored at the start: one bond of each of five rows stretched by 1e-7 m, in space of four
    assert abs(balance) < 1e-6 * 5 * 0.5 * 2.69e11 * (1e-7) ** 2
    assert abs(balance_in_space) < 1e-6 * 4 * 0.5 * 1e8 * (1e-7) ** 2
    assert 1.5e-7 < step < 3.4e-7  # at most that of the lattice alone, 2 / sqrt(4 k / m)
    assert 1e-7 < step_in_space < 3.3e-7


def test_the_script_on_release_tears_a_bar(capsys):
    (script,) = scripts("docs/release.md")
    exec(compile(script, "docs/release.md", "exec"), {"__name__": "guide"})
    released, broken, balance = map(float, capsys.readouterr().out.split())
    assert released > 0 and broken > 0 and abs(balance) < 0.05
