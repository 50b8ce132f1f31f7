"""What a newcomer meets first: ./run, the command line's list of studies, each half without the other."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
COMMANDS = ["setup", "demo", "test", "bench", "validate"]


def call(*command, **options):
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, stdin=subprocess.DEVNULL, **options)


@pytest.mark.parametrize("arguments", [[], ["help"], ["--help"]])
def test_run_explains_its_commands(arguments):
    answer = call("./run", *arguments)
    assert answer.returncode == 0 and not answer.stderr
    for command in COMMANDS:
        assert re.search(rf"^  {command} +\w", answer.stdout, re.MULTILINE), f"{command} is not explained"


def test_an_unknown_command_is_named_in_one_sentence():
    answer = call("./run", "demmo")
    assert answer.returncode == 2 and not answer.stdout
    assert len(answer.stderr.splitlines()) == 1
    for word in ["'demmo'", *COMMANDS]:
        assert word in answer.stderr


@pytest.fixture
def bare_machine(tmp_path):
    """Runs ./run with only the commands that are given (name: shell text) and nothing installed."""

    def run(command, **commands):
        for name in ["awk", "cat", "dirname", "env"]:
            (tmp_path / name).symlink_to(shutil.which(name))
        commands = {"dpkg-query": "exit 1", "id": "echo 1000"} | commands
        for name, text in commands.items():
            (tmp_path / name.replace("_", "-")).write_text(f"#!/bin/sh\n{text}\n")
            (tmp_path / name.replace("_", "-")).chmod(0o755)
        return call("/bin/sh", "./run", command, env={"PATH": str(tmp_path)})

    return run


@pytest.mark.parametrize("command", COMMANDS)
def test_without_apt_it_says_what_to_install(bare_machine, command):
    answer = bare_machine(command)
    assert answer.returncode == 1
    assert len(answer.stderr.splitlines()) == 1
    assert "apt-get is not here" in answer.stderr and "dolfinx" in answer.stderr


def test_without_sudo_it_gives_the_line_for_the_administrator(bare_machine):
    installed = "echo 'installed python3'; echo 'config-files python3-scipy'; exit 1"
    answer = bare_machine("demo", apt_get="exit 0", dpkg_query=installed)
    assert answer.returncode == 1
    assert len(answer.stderr.splitlines()) == 1
    packages = answer.stderr.partition("apt-get install --no-install-recommends ")[2].split()
    assert "python3-dolfinx" in packages and "python3-scipy" in packages  # removed but not purged: missing
    assert "python3" not in packages


@pytest.mark.parametrize("user, sudo", [("0", "exit 9"), ("1000", 'exec "$@"')])
def test_a_failing_installation_is_tried_again_with_fresh_lists(bare_machine, tmp_path, user, sudo):
    log = tmp_path / "log"
    answer = bare_machine("setup", id=f"echo {user}", sudo=sudo, apt_get=f'echo "$1" >>{log}; [ "$1" = update ]')
    assert answer.returncode == 1
    assert "could not be installed" in answer.stderr
    assert log.read_text().split()[-3:] == ["install", "update", "install"]


IMPORT_WITHOUT = """
import importlib, pkgutil, sys
class Wall:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {blocked}:
            raise ModuleNotFoundError(name + " is blocked")
sys.meta_path.insert(0, Wall())
for name in {modules}:
    module = importlib.import_module(name)
    for part in pkgutil.walk_packages(getattr(module, "__path__", []) if {whole} else [], name + "."):
        importlib.import_module(part.name)
"""


@pytest.mark.parametrize(
    "modules, whole, blocked",
    [
        (["particles"], True, ["basix", "bridge", "continuum", "dolfinx", "ffcx", "gmsh", "meshes", "petsc4py", "ufl"]),
        (["continuum"], True, ["bridge", "llvmlite", "meshes", "numba", "particles"]),
        (
            ["meshes.regions", "meshes.packings"],
            False,
            ["bridge", "continuum", "dolfinx", "gmsh", "numba", "particles"],
        ),
    ],
)
def test_each_half_is_imported_without_the_other(modules, whole, blocked):
    answer = call(sys.executable, "-c", IMPORT_WITHOUT.format(modules=modules, whole=whole, blocked=blocked))
    assert answer.returncode == 0, answer.stderr


def test_studies_are_listed_a_line_each():
    answer = call(sys.executable, "-m", "studies")
    assert answer.returncode == 0, answer.stderr
    assert re.search(r"^ *foundation\s+\w", answer.stdout, re.MULTILINE)


def test_no_committed_file_knows_the_machine_it_was_written_on():
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        pytest.skip("not a git checkout")
    # Written in pieces: this file is committed too.
    places = ["/" + name + "/" for name in ["home", "work", "Users", "root"]]
    hosts = [".".join(name) for name in [("pypi", "org"), ("deb", "debian", "org")]]
    found = call("git", "grep", "--line-number", "-I", "--fixed-strings", *[f"-e{text}" for text in places + hosts])
    assert found.returncode == 1 and not found.stdout, f"committed files name machine paths or hosts:\n{found.stdout}"
