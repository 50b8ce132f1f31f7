"""The driver script of the README runs as printed."""

import re
from pathlib import Path

README = Path(__file__).parent.parent / "README.md"


def test_the_driver_script_presses_the_plate_in(capsys):
    (script,) = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    exec(compile(script.replace("0.06:", "0.02:"), "README.md", "exec"), {})
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    loads = [float(words[2]) for words in lines]
    assert len(loads) == 5 and float(lines[-1][0]) == 20.0
    assert all(after > before > 1000.0 for before, after in zip(loads, loads[1:]))  # it hardens until about 38 mm
    errors = [abs(float(words[6])) for words in lines]
    assert max(errors) < 0.01 * 1e3 * loads[-1] * 0.02  # J, against load times displacement
