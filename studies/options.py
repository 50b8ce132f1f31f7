"""Parameters of a study: a dataclass whose fields know their unit, rule and help, and so make the command line."""

from __future__ import annotations

import dataclasses
import math
import numbers
import os
import re
from collections.abc import Callable
from typing import Any, get_args, get_type_hints

import click
from click.core import ParameterSource

POSITIVE, NOT_NEGATIVE, SHARE = "positive", "zero or positive", "above 0 and at most 1"
_RULES: dict[str, Callable[[Any], bool]] = {
    POSITIVE: lambda value: value > 0,
    NOT_NEGATIVE: lambda value: value >= 0,
    SHARE: lambda value: 0 < value <= 1,
}


LONGEST = 25  # digits of a number in a message
_KINDS = {str: "WORD", int: "NUMBER", float: "NUMBER"}


def parameter(
    default: Any,
    text: str,
    unit: str = "",
    rule: str = "",
    choices: tuple[str, ...] = (),
    shown: str = "",
    limits: tuple[float, float] = (-math.inf, math.inf),
) -> Any:
    """A dataclass field that is an option: default, help, unit, rule for numbers or allowed words.

    Args:
        default: Its default.
        text: Its help.
        unit: Its unit.
        rule: `POSITIVE`, `NOT_NEGATIVE` or `SHARE`.
        choices: Allowed words.
        shown: default as the help shows it, where None stands for something found later.
        limits: Smallest and largest number that make sense.
    """
    metadata = {"text": text, "unit": unit, "rule": rule, "choices": choices, "shown": shown, "limits": limits}
    return dataclasses.field(default=default, metadata=metadata)


def check(parameters: Any) -> None:
    """Check all fields against their kinds, rules and limits.

    Raises:
        ValueError: names field, value, rule and unit.
    """
    hints = get_type_hints(type(parameters))
    for field in dataclasses.fields(parameters):
        value: Any = getattr(parameters, field.name)
        about = field.metadata
        kinds = get_args(hints[field.name]) or (hints[field.name],)
        if value is None and type(None) in kinds:
            continue
        name = f"{field.name}={brief(value)}"
        if str in kinds:
            if not isinstance(value, str):
                raise ValueError(f"{name} must be a word")
            if about["choices"] and value not in about["choices"]:
                raise ValueError(f"{name} must be one of {', '.join(about['choices'])}")
            continue
        unit = f" ({about['unit']})" if about["unit"].strip("-") else ""
        if isinstance(value, bool) or not isinstance(value, numbers.Real):
            raise ValueError(f"{name} must be a number{unit}")
        rule, (least, most) = about["rule"], about["limits"]
        finite = isinstance(value, numbers.Integral) or math.isfinite(float(value))
        if rule and not (finite and _RULES[rule](value)):
            raise ValueError(f"{name} must be {rule}{unit}")
        if int in kinds and not isinstance(value, numbers.Integral):
            raise ValueError(f"{name} must be a whole number{unit}")
        if not least <= value <= most and rule:
            words = f"at most {most:g}" if least == -math.inf else f"between {least:g} and {most:g}"
            raise ValueError(f"{name} must be {words}{unit}")


def brief(value: Any) -> str:
    """A value as a message shows it, without hundreds of digits."""
    if isinstance(value, numbers.Integral) and abs(value) >= 10**LONGEST:
        return f"a number of more than {LONGEST} digits"
    text = str(value)
    return text if len(text) <= 3 * LONGEST or not re.search(rf"\d{{{LONGEST}}}", text) else text[:LONGEST] + "..."


def shown_default(field: dataclasses.Field) -> str:
    """A field's default as the help shows it, with its unit."""
    if field.metadata["shown"]:
        return field.metadata["shown"]
    if isinstance(field.default, (bool, str)):
        return str(field.default)
    return f"{field.default:g} {field.metadata['unit'].replace('-', '')}".strip()


def click_options(kind: type, without: tuple[str, ...] = ()) -> Callable[[Any], Any]:
    """Decorator that gives a click command one option a field, with unit and default in the help."""
    hints = get_type_hints(kind)

    def decorate(command: Any) -> Any:
        for field in reversed([one for one in dataclasses.fields(kind) if one.name not in without]):
            about, hint = field.metadata, hints[field.name]
            types = [part for part in get_args(hint) if part is not type(None)] or [hint]
            flag = types[0] is bool
            words = f" [{'|'.join(about['choices'])}]" if about["choices"] else ""
            command = click.option(
                "--" + field.name.replace("_", "-"), field.name, default=field.default, is_flag=flag,
                type=None if flag else types[0], metavar=None if flag else about["unit"].replace("-", "") or _KINDS[types[0]],
                help=f"{about['text']}{words}  [default: {shown_default(field)}]",
            )(command)  # fmt: skip
        return command

    return decorate


def output_option(study: str) -> Callable[[Any], Any]:
    """The option for the folder of the results."""
    return click.option("--output", default=f"out/{study}", metavar="FOLDER", help=f"Folder for the results.  [default: out/{study}]")


no_fields_option = click.option("--no-fields", is_flag=True, help="Write no field files.")
no_figures_option = click.option("--no-figures", is_flag=True, help="Draw no figures.")
checkpoint_option = click.option(
    "--checkpoint-every", default=600.0, type=float, metavar="s",
    help="Wall time between checkpoints, 0 for none; Ctrl-C and SIGTERM write one, too.  [default: 600 s]",
)
resume_option = click.option(
    "--resume", default=None, metavar="FOLDER",
    help="Go on with the run that was stopped in this folder, with its parameters, from checkpoint.h5.",
)
quiet_option = click.option("--quiet", is_flag=True, help="No progress bar and no report; warnings and errors are still shown.")


def check_resume(context: click.Context, resume: str | None, checkpoint_every: float) -> None:
    """Refuse what does not go with checkpoints.

    Raises:
        ValueError: a time that makes no sense, or options beside those that a resumed run can be given.
    """
    if not 0.0 <= checkpoint_every < math.inf:
        raise ValueError(f"checkpoint_every={checkpoint_every} must be zero or positive (s)")
    if resume is None:
        return
    given = [name for name in context.params if context.get_parameter_source(name) is ParameterSource.COMMANDLINE]
    others = sorted(set(given) - {"resume", "checkpoint_every", "quiet"})
    if others:
        raise ValueError(
            f"{others[0]}= does not go with resume={resume}: a resumed run keeps its parameters; leave the option out"
        )


def size_in_metres(name: str, text: str) -> tuple[float, float]:
    """Width and depth (m) of a text such as "6x3".

    Raises:
        ValueError: the text is not two positive numbers with an x between.
    """
    try:
        width, depth = (float(part) for part in text.split("x"))
    except ValueError:
        raise ValueError(f"{name}={brief(text)} must be WIDTHxDEPTH in metres, for instance 6x3") from None
    if not (math.isfinite(width) and math.isfinite(depth) and width > 0 and depth > 0):
        raise ValueError(f"{name}={brief(text)} must have positive width and depth (m)")
    return width, depth


def check_cores() -> None:
    """Refuse more threads than there are cores, on several ranks; by default a rank has one thread.

    Raises:
        ValueError: the ranks on this machine, each with its threads, want more cores than it has.
    """
    from mpi4py import MPI

    threads = max(int(os.environ.get(name) or 1) for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS"))
    if MPI.COMM_WORLD.size == 1 or threads == 1:
        return
    ranks, cores = MPI.COMM_WORLD.Split_type(MPI.COMM_TYPE_SHARED).size, os.cpu_count() or 1
    if ranks * threads > cores:
        raise ValueError(
            f"threads={threads} (OMP_NUM_THREADS or NUMBA_NUM_THREADS) on each of {ranks} ranks make {ranks * threads}, above "
            f"the {cores} cores here: take one thread a rank, or fewer ranks"
        )
